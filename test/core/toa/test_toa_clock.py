"""Clocks of the buoys as states: four buoys 2 km apart, offsets of 5 ms and drifts of 10 us/s, 3 ms per arrival."""

import functools

import numpy as np
import pytest

from uw_acoustic_loc.config import build, changed, configured
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.toa.model import heard_times
from uw_acoustic_loc.core.toa.paths import make_net
from uw_acoustic_loc.core.toa.tracker import ToaTracker
from uw_acoustic_loc.core.types import Array, Arrivals

RUNS, PINGS, STD, OFFSET, DRIFT = 40, 60, 0.003, 0.005, 1e-5
BUOYS = np.array([[0.0, 0, 0], [2000, 0, 0], [0, 2000, 0], [2000, 2000, 0]])
NET = make_net([1, 2, 3, 4], BUOYS, 200.0)
IMAGES = NET.images[[1, 2]].reshape(-1, 3)
STILL = configured(
    ToaConfig, bottom_depth=200.0, acceleration_noise=0.02, vertical_acceleration_noise=0.02, sound_speed_walk=0.0
)
CLOCKS = changed(STILL, buoy_clock_offset_std=OFFSET, buoy_clock_drift_std=DRIFT)


@functools.cache
def monte_carlo(config: ToaConfig, *, cold: bool) -> tuple[Array, Array]:
    """Errors (runs, pings, 15) of the states (the clocks' NaN if they are none) and NEES (runs, pings) of them all."""
    errors, nees = np.full((RUNS, PINGS, 15), np.nan), np.full((RUNS, PINGS), np.nan)
    for run in range(RUNS):
        rng = np.random.default_rng([77, run])
        x, v = np.array([500.0, 800, -60]), rng.normal(0.0, [2.0, 2.0, 0.5])
        offset, drift = rng.normal(0.0, OFFSET, 4), rng.normal(0.0, DRIFT, 4)
        c = 1500.0 + rng.normal(0.0, 2.0)
        start = x + rng.normal(0.0, 10.0, 3)
        known = {"cold_start": False, "initial_position": tuple(start)}
        tracker = ToaTracker(config if cold else changed(config, **known), NET)
        for k in range(PINGS):
            time = np.linalg.norm(x - IMAGES, axis=1) / c + np.tile(offset + drift * k, 2) + rng.normal(0, STD, 8)
            ids, paths = np.tile([1, 2, 3, 4], 2), np.repeat([1, 2], 4)
            estimate = tracker.update(Arrivals((k + 1) * 10**9, ids, paths, time, np.full(8, STD), np.zeros(8)))
            if estimate:
                state = np.array([*x, *v, c, *(offset + drift * k), *drift])
                error = estimate.mean - state[: len(estimate.mean)]
                errors[run, k, : len(error)] = error
                nees[run, k] = error @ np.linalg.solve(estimate.cov, error) / len(error)
            a = rng.normal(0.0, 0.02, 3)
            x, v = x + v + a / 2, v + a
    return errors, nees


@pytest.mark.parametrize("cold", [False, True], ids=["prior", "cold"])
def test_the_clocks_are_honest_states(cold: bool) -> None:
    _, nees = monte_carlo(CLOCKS, cold=cold)
    band = 2.5 * np.nanmean(nees, axis=1).std() / np.sqrt(RUNS)
    assert np.nanmean(nees) == pytest.approx(1.0, abs=band)


def test_without_them_the_track_is_wrong_and_does_not_say_so() -> None:
    (errors, _), (ignorant, nees) = monte_carlo(CLOCKS, cold=False), monte_carlo(STILL, cold=False)
    flat, ignorant_flat = (np.sqrt(np.mean(np.square(e[:, 10:, :2]))) for e in (errors, ignorant))
    assert flat < 0.9 * ignorant_flat
    assert np.mean(nees[:, 10:]) > 1.5


def test_an_offset_of_all_clocks_cannot_be_seen_with_an_unknown_emission() -> None:
    config = changed(CLOCKS, emission="unknown", buoy_clock_drift_std=0.0, cold_start=False)
    tracker = ToaTracker(changed(config, initial_position=(500.0, 800.0, -60.0)), NET)
    rng, exact = np.random.default_rng(3), np.linalg.norm(np.array([500.0, 800, -60]) - IMAGES, axis=1) / 1500.0
    for k in range(60):
        times = exact + 0.2 + rng.normal(0, STD, 8)
        ids, paths = np.tile([1, 2, 3, 4], 2), np.repeat([1, 2], 4)
        estimate = tracker.update(Arrivals((k + 1) * 10**9, ids, paths, times, np.full(8, STD), np.zeros(8)))
    assert estimate is not None
    common, apart = np.full(4, 0.25), np.array([0.5, -0.5, -0.5, 0.5])
    clocks = estimate.cov[7:, 7:]
    assert np.sqrt(common @ clocks @ common) == pytest.approx(OFFSET / 2, rel=0.02)  # as before: std of a mean of 4
    assert np.sqrt(apart @ clocks @ apart) < 0.5 * OFFSET


def test_jacobian_is_the_finite_difference_of_the_heard_times() -> None:
    mean, receiver = (
        np.array([500.0, 800, -60, 1, 1, 0, 1500, 1e-3, 2e-3, 0, 0, 1e-5, 0, 0, 0]),
        np.tile(np.arange(4), 2),
    )
    times, H = heard_times(mean, IMAGES, receiver)
    for k, h in enumerate(np.array([1e-3] * 7 + [1e-6] * 8)):
        moved = mean + h * np.eye(15)[k]
        assert H[:, k] == pytest.approx((heard_times(moved, IMAGES, receiver)[0] - times) / h, rel=1e-4, abs=1e-8)


def test_a_drift_needs_an_offset() -> None:
    with pytest.raises(ValueError, match="buoy_clock_drift_std needs a buoy_clock_offset_std above 0, got 0 s"):
        build(ToaConfig, {"buoy_clock_drift_std": 1e-6}, "toa_tracker")
