"""Noise of the vehicle's own thrusters: level, lines, direction and speed."""

import math
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.sim.hydrophones import HydrophoneSource
from uw_acoustic_loc.sim.scenario import Hydrophones, Scenario, Thruster, Vehicle, Waypoint

RATE = 200_000.0
THRUSTER = Thruster(position=(-0.5, 0.3, 0.1), level=110.0, line_level=0.0, modulation=0.0)
VEHICLE = Vehicle(waypoints=(Waypoint(0, 0), Waypoint(100, 0)), speed=1.0, thrusters=(THRUSTER,))
ARRAY = Hydrophones(spacing=0.3, sample_rate=RATE, format="float32", full_scale=1e6, noise_std=0.0)
SCENARIO = Scenario(vehicle=VEHICLE, hydrophones=ARRAY)
FAR = np.linalg.norm(np.array([[-0.15, 0, 0], [0.15, 0, 0]]) - THRUSTER.position, axis=1)


def heard(frames=10, speed=1.0, **changes):
    """(2, N) Pa."""
    vehicle = replace(VEHICLE, speed=speed, thrusters=(replace(THRUSTER, **changes),))
    source = HydrophoneSource(replace(SCENARIO, vehicle=vehicle))
    return np.concatenate([[f.h0, f.h1] for f in map(source.frame, range(frames))], axis=1)


def test_the_broad_band_noise_has_its_level_and_comes_from_the_thruster():
    """Averages of 500 windows of 2 ms in bands of 20 bins: 5 sigma are 8 %. The cross-spectrum turns with the TDOA."""
    parts = heard().reshape(2, -1, 400) * np.hanning(400)
    spectrum, freq = np.fft.rfft(parts), np.fft.rfftfreq(400, 1 / RATE)
    density = np.mean(np.abs(spectrum) ** 2, axis=1) * 2 / (RATE * np.square(np.hanning(400)).sum())
    for centre in (20e3, 50e3, 80e3):
        inside = np.abs(freq - centre) < 5e3
        expected = np.mean(1e-12 * 10 ** ((110 - 20 * np.log10(freq[inside] / 1e3)) / 10))
        assert density[:, inside].mean(axis=1) == pytest.approx(expected / FAR**2, rel=0.08)
        turned = np.exp(2j * np.pi * freq * (FAR[0] - FAR[1]) / 1500.0)
        cross = np.mean(spectrum[0] * spectrum[1].conj(), axis=0) * turned
        assert abs(np.angle(cross[inside].sum())) < 0.05
        assert abs(cross[inside].sum()) > 0.8 * np.sqrt(np.prod((np.abs(spectrum[..., inside]) ** 2).mean(1).sum(1)))


@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
def test_lines_stand_at_multiples_of_the_blade_rate_and_grow_with_speed(speed):
    """3 blades, 20 turns per metre: 60 Hz at 1 m/s. Each line is 6 dB below the one before."""
    sound = heard(10, speed, level=0.0, line_level=120.0)
    time = np.arange(sound.shape[1]) / RATE
    for h, fall in ((1, 0.0), (2, 6.0), (4, 18.0)):
        line = 2 * np.abs(np.mean(sound * np.exp(-2j * np.pi * 60.0 * speed * h * time), axis=1))
        level = 20 * np.log10(line * FAR / 1e-6)
        assert level == pytest.approx([120.0 - fall + 50 * math.log10(speed)] * 2, abs=0.1)  # it begins late


def test_lines_run_on_across_frames():
    long = heard(3, level=0.0, line_level=120.0)
    vehicle = replace(VEHICLE, thrusters=(replace(THRUSTER, level=0.0, line_level=120.0),))
    array = replace(ARRAY, frame_length=0.3)
    whole = HydrophoneSource(replace(SCENARIO, vehicle=vehicle, hydrophones=array)).frame(0)
    assert long[0] == pytest.approx(whole.h0, abs=5e-3 * float(np.abs(long).max()))  # with noise of 0 dB


def test_the_broad_band_noise_swings_at_the_blade_rate():
    """A modulation m of the strength: the power's component at the blade rate is 2 m / (1 + m^2 / 2) of its mean."""
    power = np.square(heard(20, modulation=0.5)[0])
    time = np.arange(power.size) / RATE
    depth = 2 * np.abs(np.mean(power * np.exp(-2j * np.pi * 60.0 * time))) / power.mean()
    assert depth == pytest.approx(1.0 / 1.125, abs=0.06)


def test_a_vehicle_that_has_arrived_is_silent():
    vehicle = replace(VEHICLE, waypoints=(Waypoint(0, 0), Waypoint(0.1, 0)))
    source = HydrophoneSource(replace(SCENARIO, vehicle=vehicle))
    assert np.abs(source.frame(0).h0).max() > 1e-3
    assert not source.frame(3).h0.any()


def test_a_frame_is_the_same_whichever_were_made_before():
    source = HydrophoneSource(SCENARIO)
    source.frame(0)
    assert np.array_equal(source.frame(5).h1, HydrophoneSource(SCENARIO).frame(5).h1)
