from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from uw_acoustic_loc.sim.acoustics import absorption, images, pings, pulse, sounding, tone_phases
from uw_acoustic_loc.sim.scenario import Environment, Pinger

PINGER = Pinger(id="a", x=0, y=0, z=-5, band_low=20e3, band_high=30e3, pulse_length=0.01, period=0.1, offset=0.03)
NOISE = replace(PINGER, pulse="noise")
AGE = np.arange(10_000) * 1e-6


def power_inside(wave, low, high):
    power = np.abs(np.fft.rfft(wave, 8 * wave.size)) ** 2
    freq = np.fft.rfftfreq(8 * wave.size, 1e-6)
    return power[(freq > low) & (freq < high)].sum() / power.sum()


def test_images_mirror_the_source_at_surface_and_seabed():
    positions, gains = images(np.array([1.0, 2.0, -5.0]), Environment(depth=20.0))
    assert positions.T.tolist() == [[1.0, 2.0, -5.0], [1.0, 2.0, 5.0], [1.0, 2.0, -35.0]]
    assert gains.tolist() == [1.0, -0.7, 0.4]
    assert images(np.zeros(3), Environment(bottom_reflection=0.0))[1].tolist() == [1.0, -0.7]
    assert images(np.zeros(3), Environment(reflections=0))[1].tolist() == [1.0]


def test_higher_orders_alternate_between_the_boundaries():
    """Every image is as far from a receiver as a ray that is folded at the boundaries, bounce by bounce, is long."""
    depth, z, receiver = 20.0, -5.0, -12.0
    env = Environment(depth=depth, reflections=3)
    positions, gains = images(np.array([0.0, 0.0, z]), env)
    found = sorted(zip(np.abs(positions[2] - receiver).tolist(), gains.tolist(), strict=True))
    up, down, s, b = -z, z + depth, -0.7, 0.4  # first leg towards the surface, towards the seabed
    up_end, down_end = -receiver, receiver + depth  # last leg from the surface, from the seabed
    rays = [
        (abs(z - receiver), 1.0),
        (up + up_end, s),
        (down + down_end, b),
        (up + depth + down_end, s * b),
        (down + depth + up_end, b * s),
        (up + 2 * depth + up_end, s * b * s),
        (down + 2 * depth + down_end, b * s * b),
    ]
    assert np.array(found) == pytest.approx(np.array(sorted(rays)))


def test_absorption_agrees_with_published_values():
    """arlpy's worked example for 10 m; Ainslie & McColm (1998), who fit the same data within 10 % here."""
    warm = Environment(temperature=27.0, ph=8.1, depth=20.0)
    assert absorption(50e3, warm) == pytest.approx(10.71e-3, abs=0.005e-3)
    for temperature in (4.0, 12.0, 25.0):
        env = Environment(temperature=temperature, depth=1.0)
        for f in (2.0, 25.0, 100.0):
            f1, f2 = 0.78 * np.exp(temperature / 26), 42 * np.exp(temperature / 17)
            boric, water = 0.106 * f1 / (f1**2 + f**2), 0.00049 * np.exp(-temperature / 27)
            magnesium = 0.52 * (1 + temperature / 43) * f2 / (f2**2 + f**2)
            assert absorption(f * 1e3, env) == pytest.approx(1e-3 * f**2 * (boric + magnesium + water), rel=0.1)


def test_absorption_is_continuous_where_the_formula_changes():
    below, above = (absorption(400e3, Environment(temperature=20.0 + d)) for d in (0.0, 1e-9))
    assert below == pytest.approx(above, rel=2e-3)


@pytest.mark.parametrize("kind", ["chirp", "tone", "noise"])
def test_pulses_start_and_end_softly_and_have_the_level_of_the_source(kind):
    pinger = replace(PINGER, pulse=kind)
    phases = tone_phases(pinger, np.random.default_rng(3))
    wave = pulse(pinger, AGE, phases)
    assert np.abs(pulse(pinger, np.array([-1e-3, -1e-9, 0.0, 0.01, 0.011]), phases)).max() < 1e-6
    middle = wave[1000:9000]
    assert np.sqrt(2 * np.mean(middle**2)) == pytest.approx(100.0, rel=0.1 if kind == "noise" else 0.01)
    assert power_inside(wave, 19.8e3, 30.2e3) > 0.99


def test_the_chirp_sweeps_up_and_the_tone_stays():
    for kind, early, late in (("chirp", 22e3, 28e3), ("tone", 25e3, 25e3)):
        wave = pulse(replace(PINGER, pulse=kind), AGE)
        rises = AGE[1:][(wave[:-1] < 0) & (wave[1:] >= 0)]
        for instant, expected in ((2e-3, early), (8e-3, late)):
            near = rises[np.abs(rises - instant) < 5e-4]
            assert (near.size - 1) / (near[-1] - near[0]) == pytest.approx(expected, rel=0.01)


def test_a_noise_pulse_is_the_sum_of_its_tones_at_any_instant():
    phases = tone_phases(NOISE, np.random.default_rng(5))
    assert phases.size == 100
    age = np.random.default_rng(6).uniform(0.002, 0.008, 50)  # where the edges are 1
    freq = 20e3 + 100.0 * (np.arange(100) + 0.5)
    expected = 100.0 * np.sin(2 * np.pi * np.outer(age, freq) + phases).sum(axis=1) / 10.0
    assert pulse(NOISE, age, phases) == pytest.approx(expected, abs=1e-6)


def test_a_noise_pulse_needs_its_phases():
    with pytest.raises(ValueError, match="phases must be \\(K,\\) for a noise pulse, got None"):
        pulse(NOISE, AGE)


@pytest.mark.parametrize(("q", "length"), [(0.8, 2e-3), (5.0, 1.313e-3), (30.0, 3e-3)])
def test_a_resonator_shapes_a_tone_as_its_transfer_function_says(q, length):
    """Against scipy's simulation of H(s) = (w / Q) s / (s^2 + (w / Q) s + w^2); its gate is 0.1 us wide."""
    pinger = replace(PINGER, pulse="tone", pulse_length=length, q_factor=q, source_level=2.0)
    t, w = np.arange(70_000) / 1e7, 2 * np.pi * 25e3
    _, expected, _ = signal.lsim(([w / q, 0], [1, w / q, w * w]), 2.0 * np.sin(w * t) * (t < length), t)
    end = sounding(pinger)
    assert pulse(pinger, t)[t < end] == pytest.approx(expected[t < end], abs=0.1 * w / q * 1e-6 + 1e-6)
    assert np.abs(expected[t > end]).max() < 2.0 * 1e-4 * 1.3  # w / v is 1.28 where Q is 0.8
    assert not pulse(pinger, t)[t > end].any()
    assert not pulse(pinger, -t[:9]).any()


def test_a_pulse_without_resonator_is_as_long_as_it_says():
    assert sounding(PINGER) == PINGER.pulse_length


@pytest.mark.parametrize(("q", "kind"), [(0.4, "tone"), (12.0, "chirp"), (12.0, "noise")])
def test_only_a_tone_resonates(q, kind):
    with pytest.raises(ValueError, match=f"q_factor must be 0, or above 0.5 with a tone, got {q:g} with a {kind}"):
        replace(PINGER, pulse=kind, q_factor=q)


def test_pings_keep_to_the_period():
    assert list(pings(PINGER, -5.0, 0.25)) == [0, 1, 2]
    assert list(pings(PINGER, 0.13, 0.23)) == [1]
    assert list(pings(PINGER, 0.14, 0.22)) == []
