import math
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.sim.noise import GaussianNoise, add_snaps, ambient_density, snap
from uw_acoustic_loc.sim.scenario import Environment, Hydrophones

RATE = 100_000.0
QUIET = Hydrophones(noise_std=0.0)


def periodogram(noise, runs, rng):
    """(runs, 2, n) Pa^2/Hz, one-sided, of windowed draws, and the frequencies."""
    window = np.hanning(4096)
    x = np.stack([noise.draw(rng)[:, :4096] for _ in range(runs)])
    power = np.abs(np.fft.rfft(x * window)) ** 2 * 2 / (RATE * np.square(window).sum())
    return power, np.fft.rfftfreq(4096, 1 / RATE)


@pytest.mark.parametrize(("level", "std"), [(0.0, 0.2), (65.0, 0.0), (90.0, 0.005)])
def test_the_spectrum_is_white_plus_ambient(level, std):
    """Band averages of many periodograms, each an exponential variable, against the density: 5 sigma."""
    env, rng = Environment(ambient_level=level), np.random.default_rng(2)
    power, freq = periodogram(GaussianNoise(env, Hydrophones(noise_std=std), 10_007), 100, rng)
    for low, high in ((300, 900), (2e3, 4e3), (1e4, 1.2e4), (3e4, 3.5e4)):
        inside = (freq > low) & (freq < high)
        expected = np.mean(2 * std**2 / RATE + ambient_density(freq[inside], env))
        averages = power[:, :, inside].size / 2  # Hann bins: about every other is independent
        assert power[:, :, inside].mean() == pytest.approx(expected, rel=5 / math.sqrt(averages) + 0.02)


def test_ambient_noise_is_flat_to_1_khz_and_falls_by_its_slope():
    env = Environment(ambient_level=65.0, ambient_slope=-17.0)
    level = 10 * np.log10(ambient_density(np.array([0.0, 100.0, 1e3, 1e4]), env) / 1e-12)
    assert level == pytest.approx([65.0, 65.0, 65.0, 48.0])
    assert not ambient_density(np.array([1e3]), Environment()).any()


def test_white_noise_has_its_std_and_the_hydrophones_share_nothing():
    x = GaussianNoise(Environment(), Hydrophones(noise_std=0.3), 10_000).draw(np.random.default_rng(4))
    assert x.shape == (2, 10_000)
    assert x.dtype == np.float32
    assert x.std() == pytest.approx(0.3, rel=5 / math.sqrt(2 * x.size))
    assert abs(np.corrcoef(x)[0, 1]) < 5 / math.sqrt(10_000)
    assert abs(np.corrcoef(x[0, 1:], x[0, :-1])[0, 1]) < 5 / math.sqrt(10_000)


def snaps(env, array, runs, size=100_000):
    """(n, 2) times in s and (n, 2) peaks of the snaps of all draws that hold exactly one, 1 MHz sampling."""
    times, peaks = [], []
    for seed in range(runs):
        pressure = np.zeros((2, size))
        add_snaps(pressure, env, replace(array, sample_rate=1e6), np.random.default_rng(seed))
        k = np.abs(pressure).argmax(axis=1)
        heard = [np.flatnonzero(x) for x in pressure]
        if all(h.size and h[0] > 0 and h[-1] < size - 1 and np.ptp(h) <= 100 for h in heard):
            times.append(k / 1e6)
            peaks.append(np.take_along_axis(pressure, k[:, None], axis=1)[:, 0])
    return np.array(times), np.array(peaks)


def test_a_snap_is_heard_by_both_hydrophones_from_one_direction():
    """Isotropic directions: the TDOA is uniform in +- d / c, with variance (d / c)^2 / 3; the delay shifts it."""
    delay = 5e-5
    array = Hydrophones(spacing=0.6, channel_delay=delay)
    times, peaks = snaps(Environment(snap_rate=10.0), array, 400)
    tdoa, reach = times[:, 0] - times[:, 1], 0.6 / 1500.0
    n = tdoa.size
    assert n > 100
    assert peaks[:, 0] == pytest.approx(peaks[:, 1], rel=0.01)
    assert np.abs(tdoa + delay).max() <= reach + 2e-6
    assert tdoa.mean() == pytest.approx(-delay, abs=5 * reach / math.sqrt(3 * n))
    assert tdoa.std() == pytest.approx(reach / math.sqrt(3), rel=5 / math.sqrt(5 * n))  # kurtosis 9/5


def test_amplitudes_follow_the_stable_law():
    """alpha = 1 is Cauchy: half of the amplitudes are beyond the scale, a quarter beyond 1 + sqrt(2) scales."""
    _, peaks = snaps(Environment(snap_rate=10.0, snap_alpha=1.0, snap_scale=3.0), QUIET, 400)
    n, size = len(peaks), np.abs(peaks[:, 0])
    assert np.mean(size > 3.0) == pytest.approx(0.5, abs=4 * math.sqrt(0.25 / n))
    assert np.mean(size > 3.0 * (1 + math.sqrt(2))) == pytest.approx(0.25, abs=4 * math.sqrt(0.19 / n))
    assert np.mean(peaks[:, 0] > 0) == pytest.approx(0.5, abs=4 * math.sqrt(0.25 / n))


def test_snaps_come_at_their_rate():
    env, array, pressure = Environment(snap_rate=200.0), replace(QUIET, sample_rate=1e6), np.zeros((2, 2_000_000))
    add_snaps(pressure, env, array, np.random.default_rng(8))
    begins = np.flatnonzero((pressure[0, 1:] != 0) & (pressure[0, :-1] == 0)).size
    merged = 400.0 * math.exp(-200.0 * 1e-4)  # a snap is 0.1 ms long and may run into the next
    assert begins == pytest.approx(merged, abs=5 * math.sqrt(merged))
    silent = np.zeros((2, 1000))
    add_snaps(silent, Environment(), QUIET, np.random.default_rng(8))
    assert not silent.any()


def test_a_snap_is_broad_and_short():
    t = np.arange(-512, 512) * 1e-6
    power = np.abs(np.fft.rfft(snap(t))) ** 2
    freq = np.fft.rfftfreq(t.size, 1e-6)
    assert freq[power.argmax()] == pytest.approx(20e3, abs=1e3)
    wide = freq[power > power.max() / 2]
    assert wide.max() / wide.min() > 2
    assert snap(np.zeros(1))[0] == 1.0
    assert abs(snap(np.array([50e-6]))[0]) < 1e-3
