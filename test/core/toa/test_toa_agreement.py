"""Receivers that report one at a time: a lost target is noticed, a silence leaves no false place, nothing runs away."""

import math
import time

import numpy as np
import pytest

from uw_acoustic_loc.config import changed, configured
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.toa.paths import make_net
from uw_acoustic_loc.core.toa.solver import believable
from uw_acoustic_loc.core.toa.tracker import ToaTracker
from uw_acoustic_loc.core.types import Array, Arrivals

BUOYS = np.array([[-370.0, -380, 0], [430, -380, 0], [-370, 420, 0], [430, 420, 0]])
NET = make_net([1, 2, 3, 4], BUOYS, 40.0)
CONFIG = configured(ToaConfig, bottom_depth=40.0, acceleration_noise=0.18, vertical_acceleration_noise=0.01)
STD = 1e-3


def heard(t: float, position: Array, receivers: list[int], rng: np.random.Generator, outliers: float = 0.0) -> Arrivals:
    """Direct and bottom arrivals at some receivers (rows of the net), some of them late by 0.1 s on average."""
    rows, paths = np.repeat(np.array(receivers, int), 2), np.tile([1, 2], len(receivers))
    n = len(rows)
    late = (rng.random(n) < outliers) * rng.exponential(0.1, n)
    time = np.linalg.norm(position - NET.images[paths, rows], axis=1) / 1500 + rng.normal(0, STD, n) + late
    return Arrivals(10**12 + round(t * 1e9), rows + 1, paths, time, np.full(n, STD), np.full(n, 20.0))


def course(rng: np.random.Generator, seconds: float, step: float) -> Array:
    """(n, 3) of a target at 1.5 m/s that turns now and then and stays within the net."""
    position, heading, turn, track = np.array([*rng.uniform(-200, 200, 2), -rng.uniform(5, 35)]), 0.0, 0.0, []
    for _ in range(round(seconds / step)):
        turn = rng.choice([0.0, 0.12, -0.12]) if rng.random() < 0.02 else turn
        turn = 0.12 if np.hypot(*position[:2]) > 280 else turn
        heading += turn * step
        position = position + 1.5 * step * np.array([math.cos(heading), math.sin(heading), 0.0])
        track.append(position)
    return np.array(track)


@pytest.mark.parametrize("together", [False, True], ids=["one by one", "together"])
def test_a_target_elsewhere_is_noticed_though_one_receiver_agrees(together: bool) -> None:
    """It is set down 100 m away at the same distance from the first receiver."""
    rng, tracker = np.random.default_rng(3), ToaTracker(CONFIG, NET)
    before = np.array([60.0, -20.0, -15.0])
    arm = before[:2] - BUOYS[0, :2]
    angle = 2 * math.asin(50 / np.hypot(*arm))
    turned = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]) @ arm
    after = np.array([*(BUOYS[0, :2] + turned), -15.0])
    off = {}
    for k in range(200):
        t, position = 0.25 * k, before if k < 100 else after
        if together and k % 4:
            continue
        estimate = tracker.update(heard(t, position, [0, 1, 2, 3] if together else [k % 4], rng))
        if estimate and k >= 100:
            off[t - 25.0] = float(np.linalg.norm(estimate.mean[:3] - position))
    assert np.hypot(*(after - before)[:2]) == pytest.approx(100.0)
    assert max(error for t, error in off.items() if t >= 5.0) < 10.0  # three rounds of 1 s, and a start
    assert tracker.counts["lost"] == 1


def test_outliers_alone_are_no_loss() -> None:
    """One arrival in ten is late: in 12 minutes of receivers that report one by one the target is never given up."""
    lost = 0
    for run in range(3):
        rng, tracker = np.random.default_rng([5, run]), ToaTracker(CONFIG, NET)
        for k, position in enumerate(course(rng, 240.0, 1.0)):
            tracker.update(heard(float(k), position, [k % 4], rng, outliers=0.1))
        lost += tracker.counts["lost"]
    assert lost <= 1


@pytest.mark.parametrize("silence", [10.0, 100.0, 300.0])
def test_after_a_silence_an_estimate_is_where_it_says(silence: float) -> None:
    """Chi-square of 3: beyond 30 once in 7e5; consecutive epochs share their errors."""
    worst, late = [], []
    for run in range(3):
        rng, tracker, start = np.random.default_rng([7, run]), ToaTracker(CONFIG, NET), 40.0
        for k, position in enumerate(course(rng, start + silence + 20.0, 0.5)):
            t = 0.5 * k
            if start <= t < start + silence:
                continue
            estimate = tracker.update(heard(t, position, [int(rng.integers(4))], rng, outliers=0.05))
            if estimate and t >= start + silence:
                off = estimate.mean[:3] - position
                worst.append(float(off @ np.linalg.solve(estimate.cov[:3, :3], off)))
                late.append(t - start - silence)
    assert len(late) > 3 * 20  # found again within 10 of the 20 s
    assert max(worst) < 30.0


def test_a_cold_start_finds_the_place_that_suits_all_receivers() -> None:
    """A bad start point, a track that one receiver never agrees with: it moves to where all do."""
    rng, tracker = np.random.default_rng(11), ToaTracker(CONFIG, NET)
    truth = np.array([120.0, 60.0, -20.0])
    wrong = changed(
        CONFIG, cold_start=False, initial_position=(120.0, 60.0, -20.0), initial_position_std=(1.0, 1.0, 1.0)
    )
    tracker = ToaTracker(wrong, NET)
    moved = truth + np.array([0.0, 40.0, 0.0])
    for k in range(40):
        estimate = tracker.update(heard(float(k), moved if k > 5 else truth, [0, 1, 2, 3], rng))
    assert estimate is not None
    assert estimate.rejected == 0
    assert np.linalg.norm(estimate.mean[:3] - moved) < 6.0


def test_nothing_beyond_what_is_known_beforehand_is_published() -> None:
    """Silences of 10 to 300 s, lost receivers, arrivals of nothing: whatever is published is within the prior."""
    published, config = 0, CONFIG
    for run in range(3):
        rng, tracker, t = np.random.default_rng([13, run]), ToaTracker(config, NET), 0.0
        track = course(rng, 900.0, 1.0)
        while t < 890.0:
            t += rng.uniform(10.0, 300.0) if rng.random() < 0.03 else 1.0
            if t >= 890.0:
                break
            receivers = rng.permutation(4)[: rng.integers(0, 5)].tolist()
            arrivals = heard(t, track[int(t)], receivers, rng, outliers=0.3)
            if rng.random() < 0.05:
                arrivals.time[:] = rng.uniform(0, 2, len(arrivals.time))
            if estimate := tracker.update(arrivals):
                published += 1
                assert believable(estimate.mean, NET, config)
                assert np.linalg.eigvalsh(estimate.cov).min() > 0
    assert published > 200


def test_a_range_bias_of_each_receiver_is_a_state() -> None:
    """Constant errors of 3 m: without the state the track is overconfident, with it NEES/3 is in its band."""
    nees: dict[float, list[float]] = {0.0: [], 3.0: []}
    for run in range(12):
        for std, found in nees.items():
            rng = np.random.default_rng([17, run])
            bias, tracker = rng.normal(0, 3.0, 4), ToaTracker(changed(CONFIG, range_bias_std=std), NET)
            for k, position in enumerate(course(rng, 60.0, 1.0)):
                arrivals = heard(float(k), position, [0, 1, 2, 3], rng)
                arrivals.time[:] += bias[arrivals.receiver - 1] / 1500
                estimate = tracker.update(arrivals)
            assert estimate is not None
            off = estimate.mean[:3] - position
            found.append(float(off @ np.linalg.solve(estimate.cov[:3, :3], off)) / 3)
    assert np.mean(nees[0.0]) > 3.0
    assert 0.3 < np.mean(nees[3.0]) < 2.0  # chi-square of 36 over 36: 0.5 to 1.6 at 3 sigma


def test_a_thousand_unlabelled_arrivals_cost_milliseconds_and_hide_nothing() -> None:
    """9 to 15 ms on a busy core; without a bound they took seconds."""
    rng, tracker, truth = np.random.default_rng(19), ToaTracker(CONFIG, NET), np.array([50.0, -30.0, -15.0])
    spent = []
    for k in range(12):
        arrivals = heard(float(k), truth, [0, 1, 2, 3], rng)
        count = 1000 if k >= 6 else 0
        crowd = Arrivals(
            arrivals.t_ns,
            np.concatenate([arrivals.receiver, rng.integers(1, 5, count)]),
            np.zeros(8 + count, int),
            np.concatenate([arrivals.time, rng.uniform(0.2, 1.0, count)]),
            np.full(8 + count, STD),
            np.concatenate([arrivals.snr, rng.uniform(5, 15, count)]),
        )
        begun = time.process_time()
        estimate = tracker.update(crowd)
        spent.append(time.process_time() - begun)
    assert estimate is not None
    assert np.linalg.norm(estimate.mean[:3] - truth) < 6.0
    assert min(spent[6:]) < 0.1
    assert tracker.counts["unassociated"] == 6000
