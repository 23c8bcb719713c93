import numpy as np
import pytest

from uw_acoustic_loc.sim.acoustics import arrival_times, emissions, images, pulse
from uw_acoustic_loc.sim.scenario import Environment, Pinger

PINGER = Pinger(id="a", x=0, y=0, z=-5, band_low=20e3, band_high=30e3, pulse_length=0.01, period=0.1, offset=0.03)


def test_images_mirror_the_source_at_surface_and_seabed():
    positions, gains = images(np.array([1.0, 2.0, -5.0]), Environment(depth=20.0))
    assert positions.T.tolist() == [[1.0, 2.0, -5.0], [1.0, 2.0, 5.0], [1.0, 2.0, -35.0]]
    assert gains.tolist() == [1.0, -0.7, 0.4]
    assert images(np.zeros(3), Environment(bottom_reflection=0.0))[1].tolist() == [1.0, -0.7]


def test_the_light_time_equation_is_solved():
    def receiver(t):
        return np.stack([20.0 - 15.0 * t, 3.0 * np.sin(t), 0.0 * t])

    sources = np.array([[100.0, -40.0], [0.0, 30.0], [-10.0, -3.0]])
    emission, speed = np.array([1.0, 2.5]), np.array([1500.0, 1490.0])
    arrival = arrival_times(sources, emission, receiver, speed)
    travelled = np.linalg.norm(receiver(arrival) - sources, axis=0)
    assert speed * (arrival - emission) == pytest.approx(travelled, abs=1e-7)  # far below a wavelength


def test_an_approaching_receiver_hears_a_shorter_pulse():
    def receiver(t):
        return np.stack([-100.0 + 2.0 * t, 0.0 * t, 0.0 * t])

    first, last = arrival_times(np.zeros((3, 2)), np.array([0.0, 0.01]), receiver, np.full(2, 1500.0))
    assert (last - first) / 0.01 == pytest.approx(1500.0 / 1502.0, rel=1e-9)


def test_the_pulse_sweeps_its_band_with_soft_edges():
    age = np.linspace(0.0, 0.01, 10_001)
    wave = pulse(PINGER, age)
    assert np.abs(wave[[0, -1]]).max() < 1e-6
    assert np.abs(wave).max() == pytest.approx(100.0, rel=1e-3)
    power = np.abs(np.fft.rfft(wave)) ** 2
    freq = np.fft.rfftfreq(wave.size, 1e-6)
    assert power[(freq > 20e3) & (freq < 30e3)].sum() > 0.99 * power.sum()


def test_emissions_keep_to_the_period():
    assert emissions(PINGER, -5.0, 0.25) == pytest.approx([0.03, 0.13, 0.23])
    assert emissions(PINGER, 0.13, 0.23) == pytest.approx([0.13])
    assert emissions(PINGER, 0.14, 0.22).size == 0
