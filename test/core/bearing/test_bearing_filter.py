import math

import numpy as np
import pytest

from uw_acoustic_loc.core.bearing.config import BearingConfig
from uw_acoustic_loc.core.bearing.estimator import BearingEstimator
from uw_acoustic_loc.core.bearing.filters import HistogramFilter, LastPeak, ParticleFilter
from uw_acoustic_loc.core.bearing.gcc import Correlation
from uw_acoustic_loc.core.bearing.tdoa_likelihood import PeakLikelihood
from uw_acoustic_loc.studies.bearing.ping_scene import PingScene

SPACING, SPEED = 0.6, 1500.0
MAX_LAG = SPACING / SPEED
STILL = (0.0, 0.0)


def peaks(tdoas, weights, std=1e-6):
    order = np.argsort(tdoas)
    return PeakLikelihood(np.asarray(tdoas)[order], np.asarray(weights)[order] / np.sum(weights), std, MAX_LAG)


def histogram(_rng):
    return HistogramFilter(SPACING, SPEED)


def particles(rng):
    return ParticleFilter(SPACING, SPEED, (10.0, 100.0), 2000, rng)


BOTH = pytest.mark.parametrize("make", [histogram, particles])


def test_a_maximum_beyond_the_largest_lag_means_end_fire():
    found = Correlation(np.zeros(1), np.zeros(1), np.array([1.02 * MAX_LAG]), np.ones(1), 1e10, 1e-7, 10.0)
    assert PeakLikelihood.of(found, 0.0, 0.02, MAX_LAG).tdoas == pytest.approx([MAX_LAG])


def test_the_likelihood_is_a_density_that_prefers_the_higher_maximum():
    values, heights = np.zeros(3), np.array([1.0, 0.9])
    found = Correlation(values, values, np.array([1e-4, -1e-4]), heights, (2 * np.pi * 25e3) ** 2, 3e-7, 10.0)
    likelihood = PeakLikelihood.of(found, 4e-7, 0.02, MAX_LAG)
    tdoas = np.linspace(-MAX_LAG, MAX_LAG, 100_001)
    density = likelihood.at(tdoas)
    assert density.sum() * (tdoas[1] - tdoas[0]) == pytest.approx(1.0, rel=1e-3)
    assert likelihood.std == pytest.approx(5e-7)
    log_ratio = math.log(density[np.argmin(abs(tdoas - 1e-4))] / density[np.argmin(abs(tdoas + 1e-4))])
    assert log_ratio == pytest.approx(0.1 / (0.02 + found.curvature * 3e-7**2), rel=0.05)


@BOTH
def test_nees_over_many_runs_is_in_its_chi_square_band(make):
    """A source that wanders as the filter believes, seen without outliers; 200 independent last estimates."""
    runs, spread, std = 200, math.radians(0.5), 3e-6
    rng, nees = np.random.default_rng(3), []
    for _ in range(runs):
        theta, state = rng.uniform(0.8, 2.3), make(np.random.default_rng(rng.integers(1 << 32)))
        for _ in range(6):
            theta += spread * rng.standard_normal()
            state.predict(0.0, STILL, spread)
            state.update(peaks([MAX_LAG * math.cos(theta) + std * rng.standard_normal()], [1.0], std))
        mean, variance = state.estimate()
        nees.append((mean - theta) ** 2 / variance)
    half = 4 * math.sqrt(2 / runs)  # four standard deviations of a mean of chi-squares
    assert 1 - half < np.mean(nees) < 1 + half


@BOTH
def test_ambiguity_is_carried_and_settled_by_motion(make):
    """Two carrier cycles equally high; only one turns as the vehicle does."""
    state, theta, cycle = make(np.random.default_rng(4)), 1.2, 4e-5
    stds = []
    for k in range(12):
        if k:
            state.predict(0.05, STILL, math.radians(0.2))
            theta -= 0.05
        true = MAX_LAG * math.cos(theta)
        state.update(peaks([true, true - cycle, true + cycle], [1.0, 1.0, 1.0]))
        stds.append(math.sqrt(state.estimate()[1]))
    assert stds[0] > 0.05  # a cycle is 0.1 rad: it does not pretend to know
    assert state.estimate()[0] == pytest.approx(theta, abs=0.01)
    assert stds[-1] < 0.02


def gross_and_median(scene, snr_db, seed, pings=150):
    """Per filter: share of errors over 5 degrees, median error in degrees; 1.1 degrees per ping, ten pings per s."""
    rng = np.random.default_rng([21, seed])
    start = rng.uniform(0.0, 220.0)
    azimuths = np.radians(35.0 + 110.0 - np.abs((start + 1.1 * np.arange(pings)) % 220.0 - 110.0))
    band = {"band_low": scene.band[:1], "band_high": scene.band[1:]}
    names = ("none", "particle", "histogram")
    states = {n: BearingEstimator(BearingConfig(("p",), filter=n, seed=seed, **band), scene.info) for n in names}
    errors = {n: [] for n in names}
    for k, azimuth in enumerate(azimuths):
        frame = scene.frame(azimuth, snr_db, rng, scene.info.t_ns + k * 10**8)
        for n, state in states.items():
            errors[n] += [abs(b.bearing - scene.bearing(azimuth)) for _, b in state.process(frame)]
    return {n: (np.mean(np.degrees(e) > 5.0), np.median(np.degrees(e))) for n, e in errors.items()}


@pytest.mark.parametrize(
    ("band", "snr_db", "impulses", "cut"), [((24e3, 26e3), 10.0, False, 6), ((20e3, 30e3), 0.0, True, 10)]
)
def test_every_run_in_multipath_settles_on_the_right_cycle(band, snr_db, impulses, cut):
    """No run may end on a wrong cycle: on average over the runs and, with some allowance, in each."""
    scene = PingScene(band, multipath=True, impulses=impulses)
    runs = [gross_and_median(scene, snr_db, seed) for seed in range(5)]
    alone = np.mean([r["none"][0] for r in runs])
    assert alone > 0.02  # there is something to settle
    for name in ("particle", "histogram"):
        gross, median = np.array([r[name] for r in runs]).T
        assert gross.mean() <= alone / cut
        assert gross.max() < 0.1  # its beginning; a run on a wrong cycle has a half or more
        assert np.median(median) < 1.2


def test_the_particles_of_a_narrow_ping_follow_it_although_motion_is_wide():
    """Per ping the motion is twenty times the likelihood's width: drawn before the ping, few particles would count."""
    rng, std = np.random.default_rng(12), 3.5e-7
    state, theta = particles(rng), 1.3
    for _ in range(30):
        theta += 0.02 * rng.standard_normal()
        state.predict(0.0, STILL, 0.02)
        state.update(peaks([MAX_LAG * math.cos(theta)], [1.0], std))
        assert state.estimate()[0] == pytest.approx(theta, abs=6 * std / MAX_LAG)
    weights = state.cloud[1]
    assert 1 / np.sum(weights**2) > 0.2 * weights.size


@BOTH
def test_a_turn_to_port_moves_a_port_source_clockwise(make):
    state = make(np.random.default_rng(5))
    for _ in range(3):
        state.update(peaks([0.0], [1.0]))
    state.predict(0.3, STILL, 1e-4)
    assert state.estimate()[0] == pytest.approx(math.pi / 2 - 0.3, abs=0.01)


def test_particles_move_against_the_vehicle():
    state = particles(np.random.default_rng(6))
    state.update(peaks([0.0], [1.0]))
    before = state.cloud[0].copy()
    state.predict(0.0, (2.0, 0.5), 0.0)
    assert state.cloud[0] == pytest.approx(before - np.array([[2.0], [0.5]]), abs=1e-4)  # float32 inside


@BOTH
def test_a_lost_source_is_found_again(make):
    state = make(np.random.default_rng(7))
    for theta in [0.7] * 10 + [2.0] * 10:
        state.predict(0.0, STILL, math.radians(0.2))
        state.update(peaks([MAX_LAG * math.cos(theta)], [1.0]))
    assert state.estimate()[0] == pytest.approx(2.0, abs=0.02)


@BOTH
@pytest.mark.parametrize("theta", [0.0, math.pi])
def test_end_fire_stays_finite(make, theta):
    state = make(np.random.default_rng(8))
    for _ in range(5):
        state.predict(0.0, (0.1, 0.0), 0.02)
        state.update(peaks([MAX_LAG * math.cos(theta)], [1.0]))
    mean, variance = state.estimate()
    assert mean == pytest.approx(theta, abs=0.2)
    assert 0.0 < variance < 1.0


@BOTH
def test_without_pings_the_variance_grows(make):
    state = make(np.random.default_rng(9))
    for _ in range(3):
        state.update(peaks([1e-4], [1.0]))
    variances = []
    for _ in range(5):
        state.predict(0.0, STILL, 0.02)
        variances.append(state.estimate()[1])
    assert np.all(np.diff(variances) > 0)


def test_no_filter_takes_the_highest_maximum():
    state = LastPeak()
    state.update(peaks([1e-4, -1e-4], [1.0, 2.0]))
    theta, variance = state.estimate()
    assert theta == pytest.approx(math.acos(-1e-4 / MAX_LAG))
    assert variance == pytest.approx((1e-6 / MAX_LAG / math.sin(theta)) ** 2)


@pytest.mark.parametrize("count", [20, 70_000, 200_000])
def test_a_filter_of_any_size_follows_its_source(count):
    state = ParticleFilter(SPACING, SPEED, (10.0, 100.0), count, np.random.default_rng(0))
    for _ in range(8):
        state.predict(0.0, STILL, 0.01)
        state.update(peaks([MAX_LAG * math.cos(1.2)], [1.0]))
    theta, variance = state.estimate()
    assert theta == pytest.approx(1.2, abs=5.0 * math.sqrt(variance))
    assert variance < math.radians(1.0) ** 2
