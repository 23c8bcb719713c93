import math

import numpy as np
import pytest

from uw_acoustic_loc.core.bearing.gcc import BandSplitter, Correlation, Correlator, Piece
from uw_acoustic_loc.core.bearing.weighting import WEIGHTINGS

RATE, PULSE, MAX_LAG = 100_000.0, 0.01, 0.6 / 1500.0
LOW, HIGH = 20_000.0, 30_000.0


def chirp(t):
    phase = LOW * t + (HIGH - LOW) / (2 * PULSE) * t**2
    return np.where((t >= 0) & (t < PULSE), np.cos(2 * np.pi * phase), 0.0)


def pair(tdoa, start=0.004, n=2000):
    """Hydrophone 0 hears the pulse `tdoa` later than hydrophone 1."""
    t = np.arange(n) / RATE - start
    return chirp(t - tdoa / 2), chirp(t + tdoa / 2)


class Chain:
    def __init__(self, n=2000):
        self.splitter = BandSplitter(RATE, [LOW], [HIGH], n)
        self.noise = 2 / (RATE / 2)  # density in an envelope per variance of a sample
        length = math.ceil(n / RATE * self.splitter.rate)
        self.correlator = Correlator(self.splitter, length, MAX_LAG)

    def __call__(self, h0, h1, noise_density=1e-16, weighting="cc", part=slice(None)) -> Correlation:
        envelopes = self.splitter.split(h0, h1).values[0]
        return self.correlator.correlate([Piece(0, envelopes[:, part], noise_density)], weighting, 4)[0]


@pytest.mark.parametrize("tdoa", [-3.9e-4, -1.2345e-4, -2.5e-6, 0.0, 1e-7, 2.1e-4, 3.9e-4])
def test_a_known_delay_is_found_with_its_sign_and_without_group_delay(tdoa):
    found = Chain()(*pair(tdoa))
    assert found.tdoas[0] == pytest.approx(tdoa, abs=2e-9)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_every_weighting_finds_the_delay_in_noise(weighting):
    rng = np.random.default_rng(0)
    h0, h1 = (h + 0.1 * rng.standard_normal(h.size) for h in pair(1.7e-4))
    chain = Chain()
    found = chain(h0, h1, chain.noise * 0.1**2, weighting)
    assert abs(found.tdoas[0] - 1.7e-4) < 5 * found.std < 1e-6


def test_the_correlation_equals_the_direct_sum_over_all_samples():
    rng = np.random.default_rng(1)
    common = rng.standard_normal(2000)
    h0, h1 = common + rng.standard_normal(2000), np.roll(common, 7) + rng.standard_normal(2000)
    chain = Chain()
    found = chain(h0, h1)
    fade = 0.5 - 0.5 * np.cos(np.pi * np.arange(32) / 32)
    window = np.concatenate([fade, np.ones(2000 - 64), fade[::-1]])
    freq = np.fft.rfftfreq(2000, 1 / RATE)
    cross = np.fft.rfft(h0 * window) * np.fft.rfft(h1 * window).conj()
    cross[(freq < LOW) | (freq > HIGH)] = 0.0
    direct = np.array([np.real(cross @ np.exp(2j * np.pi * freq * lag)) for lag in chain.correlator.lags])
    assert np.corrcoef(direct, found.values)[0, 1] > 0.999
    assert found.tdoas[0] == pytest.approx(-7 / RATE, abs=2e-6)


def test_rmse_is_near_the_cramer_rao_bound_and_the_std_is_honest():
    """200 trials know an RMSE to 1 / sqrt(400) = 5 %, so 1.15 lies three standard deviations above 1."""
    n, start, tdoa = 2000, 0.004, MAX_LAG * math.cos(math.radians(95))
    h0, h1 = pair(tdoa)
    chain, rng = Chain(n), np.random.default_rng(2)
    part = slice(round((start - 1e-3) * chain.splitter.rate), round((start + PULSE + 1e-3) * chain.splitter.rate))
    omega_2 = np.mean((2 * np.pi * np.linspace(LOW, HIGH, 1000)) ** 2)
    for snr_db in (10, 20, 30):
        snr = 10 ** (snr_db / 10)
        bound = math.sqrt((1 + 2 * snr) / (2 * snr**2 * (HIGH - LOW) * PULSE * omega_2))
        sigma = math.sqrt(0.5 / snr * (RATE / 2) / (HIGH - LOW))
        density = chain.noise * sigma**2
        noise = sigma * rng.standard_normal((200, 2, n))
        trials = [chain(h0 + w[0], h1 + w[1], density, part=part) for w in noise]
        errors = np.array([f.tdoas[0] - tdoa for f in trials])
        assert np.sqrt(np.mean(errors**2)) < 1.15 * bound
        normalised = np.mean((errors / np.array([f.std for f in trials])) ** 2)
        assert 1 - 4 * math.sqrt(2 / 200) < normalised < 1 + 4 * math.sqrt(2 / 200)  # 4 sigma of a chi-square mean


def test_maxima_come_in_order_and_at_the_sums_own_maxima():
    """Each within half a grid step of the grid's own maximum."""
    rng = np.random.default_rng(3)
    h0, h1 = (h + 0.05 * rng.standard_normal(h.size) for h in pair(1.1e-4))
    found = Chain()(h0, h1)
    assert np.all(np.diff(found.heights) <= 0)
    assert found.heights[0] == 1.0
    for tdoa in found.tdoas:
        near = np.abs(found.lags - tdoa) < 1e-5
        grid = found.lags[near][np.argmax(found.values[near])]
        assert abs(tdoa - grid) <= 0.51 * (found.lags[1] - found.lags[0])


def test_wrong_cycles_are_rare_from_5_db_up():
    """Each of 400 trials may be a cycle off; 1 % of the frames is the goal, and 5 dB gives almost none."""
    n, tdoa, rng = 2000, 3e-5, np.random.default_rng(4)
    h0, h1 = pair(tdoa)
    chain = Chain(n)
    part = slice(round(3e-3 * chain.splitter.rate), round((5e-3 + PULSE) * chain.splitter.rate))
    sigma = math.sqrt(0.5 / 10**0.5 * (RATE / 2) / (HIGH - LOW))
    noise = sigma * rng.standard_normal((400, 2, n))
    errors = np.array([chain(h0 + w[0], h1 + w[1], chain.noise * sigma**2, part=part).tdoas[0] - tdoa for w in noise])
    assert np.mean(np.abs(errors) > 2e-5) <= 0.01


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_silence_gives_finite_numbers(weighting):
    found = Chain()(np.zeros(2000), np.zeros(2000), 1e-30, weighting)
    for value in (found.values, found.tdoas, found.heights, found.std, found.snr, found.curvature):
        assert np.all(np.isfinite(value))
    assert found.std > 0.5 * MAX_LAG / math.sqrt(3)


def test_error_sentences():
    with pytest.raises(ValueError, match="band must be 0 < low < high < 50000 Hz, got 40000 to 60000 Hz"):
        BandSplitter(RATE, [40e3], [60e3], 2000)
    with pytest.raises(ValueError, match="band must be at least 100 Hz wide for this block, got 50"):
        BandSplitter(RATE, [40e3], [40.05e3], 2000)
    with pytest.raises(ValueError, match="weighting must be one of cc, phat, scot, roth, eckart, ml, got 'best'"):
        Chain()(*pair(0.0), weighting="best")
