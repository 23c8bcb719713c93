from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.core.multistatic.association import residuals_at
from uw_acoustic_loc.core.multistatic.estimator import METHODS, Noise, SonarNet, gaussian_likelihood
from uw_acoustic_loc.core.multistatic.fusion import Echoes, Fusion, MultistaticConfig, PingScan
from uw_acoustic_loc.core.multistatic.track import Track

NET = SonarNet(np.zeros(2), np.array([[2000.0, 0.0], [-1000.0, 1732.0], [-1000.0, -1732.0]]))
RANGE_STD, BEARING_STD = 40.0, 0.02


def echoes_of(targets, rng, misses=()):
    """Echoes of targets (T, 2), a row for each receiver and target in turn, but for `misses` (rows of that list)."""
    ranges, bearings = NET.measure(np.asarray(targets, dtype=float))
    noise = Noise(np.full(3, RANGE_STD), np.full(3, BEARING_STD))
    range_errors, bearing_errors = noise.draw(rng, (len(targets),))
    receiver = np.repeat(np.arange(3), len(targets))
    keep = [k for k in range(receiver.size) if k not in misses]
    return rows(receiver[keep], (ranges + range_errors).ravel()[keep], (bearings + bearing_errors).ravel()[keep])


def rows(receiver, ranges, bearings):
    size = len(receiver)
    receiver, ranges, bearings = np.asarray(receiver, dtype=int), np.asarray(ranges), np.asarray(bearings)
    range_std, bearing_std = np.full(size, RANGE_STD), np.full(size, BEARING_STD)
    return Echoes(receiver, ranges, range_std, bearings, bearing_std, np.full(size, 15.0))


def joined(first, second):
    names = ("receiver", "range", "range_std", "bearing", "bearing_std", "snr")
    return Echoes(*(np.concatenate([getattr(first, name), getattr(second, name)]) for name in names))


def alarms(rng, count):
    """False alarms at every receiver, uniform over 4 km around the net."""
    points = rng.uniform(-4000, 4000, (3 * count, 2))
    ranges, bearings = NET.measure(points)
    receiver = np.repeat(np.arange(3), count)
    own = receiver, np.arange(3 * count)
    return rows(receiver, ranges[own], bearings[own])


def test_residuals_and_their_jacobian_against_finite_differences():
    noise = Noise(np.full(3, RANGE_STD), np.full(3, BEARING_STD))
    target, h = np.array([700.0, 900.0]), 1e-3
    ranges, bearings = NET.measure(target)
    single = gaussian_likelihood(NET, ranges[:, None] + 5.0, bearings[:, None] + 0.01, noise)
    residuals, G = residuals_at(single, target)
    np.testing.assert_allclose(residuals, [[5.0, 0.01]] * 3, rtol=1e-6)
    for axis in range(2):
        step = h * np.eye(2)[axis]
        difference = (residuals_at(single, target - step)[0] - residuals_at(single, target + step)[0]) / (2 * h)
        np.testing.assert_allclose(G[:, :, axis], difference, rtol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_one_target_among_false_alarms_is_grouped_right(method):
    rng = np.random.default_rng(2)
    fusion, right, runs = Fusion(NET, MultistaticConfig(method=method)), 0, 60
    for _ in range(runs):
        target = rng.uniform(-4000, 4000, 2)
        echoes = joined(alarms(rng, 2), echoes_of([target], rng))
        first = next(fusion.fixes(echoes), None)
        right += first is not None and first.rows == (6, 7, 8)
    assert right >= 0.95 * runs  # an alarm now and then lies as near as the echo itself


def test_several_targets_give_a_fix_each_of_its_own_echoes():
    rng = np.random.default_rng(3)
    targets = [(2600.0, 1400.0), (-1500.0, 1500.0), (100.0, -2500.0)]
    found = list(Fusion(NET, MultistaticConfig()).fixes(echoes_of(targets, rng)))
    assert sorted(fix.rows for fix in found) == [(0, 3, 6), (1, 4, 7), (2, 5, 8)]
    for fix in found:
        error = fix.position - targets[fix.rows[0]]
        assert error @ np.linalg.solve(fix.cov, error) < 20


def test_the_strongest_group_comes_first():
    rng = np.random.default_rng(4)
    targets = [(2600.0, 1400.0), (-1500.0, 1500.0)]
    echoes = echoes_of(targets, rng)
    by_snr = Echoes(*vars(echoes).values())
    by_snr.snr[[1, 3, 5]] = 25.0
    fusion = Fusion(NET, MultistaticConfig())
    assert [fix.rows for fix in fusion.fixes(by_snr)] == [(1, 3, 5), (0, 2, 4)]
    by_snr.snr[:] = np.nan  # unknown
    missed = echoes_of(targets, rng, misses=[1])  # the second target's echo at the first receiver
    assert [len(fix.rows) for fix in fusion.fixes(missed)] == [3, 2]
    assert len(list(fusion.fixes(by_snr))) == 2


def test_two_receivers_are_enough_and_one_only_if_wanted():
    rng = np.random.default_rng(5)
    target = [(2600.0, 1400.0)]
    three, two, one = (echoes_of(target, rng, misses) for misses in ((), (1,), (0, 1)))
    fusion, poor = Fusion(NET, MultistaticConfig()), Fusion(NET, MultistaticConfig(min_receivers=1))
    assert [len(list(fusion.fixes(echoes))) for echoes in (three, two, one)] == [1, 1, 0]
    stds = [np.sqrt(np.trace(next(poor.fixes(echoes)).cov)) for echoes in (three, two, one)]
    assert stds[0] < stds[1] < stds[2]


def test_a_net_of_one_receiver_gives_fixes():
    net = SonarNet(np.zeros(2), np.array([[2000.0, 0.0]]))
    ranges, bearings = net.measure(np.array([2600.0, 1400.0]))
    bias = Noise(np.array([RANGE_STD]), np.array([BEARING_STD])).bias
    (fix,) = Fusion(net, MultistaticConfig()).fixes(rows([0], ranges + bias, bearings))
    np.testing.assert_allclose(fix.position, [2600, 1400], atol=0.1)


def test_receivers_that_the_method_cannot_use_alone_give_no_fix():
    net = SonarNet(np.zeros(2), np.array([[2000.0, 0.0], [-2000.0, 0.0], [0.0, 2000.0]]))
    ranges, bearings = net.measure(np.array([600.0, 1400.0]))
    in_line = rows([0, 1], ranges[:2] + 76.5, bearings[:2])
    assert list(Fusion(net, MultistaticConfig(method="ls")).fixes(in_line)) == []
    assert len(list(Fusion(net, MultistaticConfig()).fixes(in_line))) == 1


def test_no_echo_no_fix():
    assert list(Fusion(NET, MultistaticConfig()).fixes(rows([], [], []))) == []


# --- what tracks claim ----------------------------------------------------------------------------------------------


def track(x, y, std=30.0, number=1):
    return replace(Track.start(np.array([x, y, 0.0, 0.0]), np.diag([std**2, std**2, 1.0, 1.0]), 0), id=number)


def test_a_vague_tracks_sighting_is_the_fix_of_its_detections():
    rng, fusion = np.random.default_rng(6), Fusion(NET, MultistaticConfig())
    for _ in range(20):
        target = rng.uniform(-4000, 4000, 2)
        echoes = echoes_of([target], rng)
        (fix,) = fusion.fixes(echoes)
        (seen,) = PingScan(fusion, echoes).assign([track(*(target + rng.normal(0, 100, 2)), std=100.0)])
        apart = seen.position - fix.position
        assert apart @ np.linalg.solve(fix.cov, apart) < 0.1**2  # a tenth of a standard deviation
        np.testing.assert_allclose(seen.cov, fix.cov, rtol=0.15, atol=0.05 * np.trace(fix.cov))
        assert seen.delay == pytest.approx(np.hypot(*target) / 1500, abs=0.3)


def test_tracks_claim_each_receivers_detections_and_the_rest_makes_fixes():
    rng, fusion = np.random.default_rng(7), Fusion(NET, MultistaticConfig())
    targets = [(2600.0, 1400.0), (-1500.0, 1500.0), (100.0, -2500.0)]
    scan = PingScan(fusion, echoes_of(targets, rng, misses=[0, 3]))  # the first target's echo at one receiver is left
    claimed = scan.assign([track(*targets[1]), track(*targets[0])])
    for seen, target in zip(claimed, [targets[1], targets[0]], strict=True):
        error = seen.position - target
        assert error @ np.linalg.solve(seen.cov, error) < 20
    assert np.linalg.det(claimed[1].cov) > 4 * np.linalg.det(claimed[0].cov)
    assert scan.assign([track(*targets[0])]) == [None]
    (left,) = scan.rest()
    assert np.hypot(*(left.position - targets[2])) < 200


def test_a_tentative_track_needs_as_many_receivers_as_a_fix():
    rng, target = np.random.default_rng(8), (2600.0, 1400.0)
    scan = PingScan(Fusion(NET, MultistaticConfig()), echoes_of([target], rng, misses=[0, 1]))
    assert scan.assign([track(*target, number=0)]) == [None]
    assert scan.assign([track(*target)]) != [None]


def test_a_receiver_upon_whose_baseline_the_track_lies_leaves_its_distance_open():
    rng = np.random.default_rng(9)
    scan = PingScan(Fusion(NET, MultistaticConfig()), echoes_of([(1000.0, 0.5)], rng, misses=[1, 2]))
    (seen,) = scan.assign([track(1000.0, 0.0)])
    assert np.sqrt(seen.cov[0, 0]) > 1000
    assert np.sqrt(seen.cov[1, 1]) < 40


def test_config_errors():
    with pytest.raises(ValueError, match="node: confirm_hits must be at most confirm_pings, got 5 of 4"):
        build(MultistaticConfig, {"confirm_hits": 5}, "node")
    with pytest.raises(ValueError, match="method must be one of ls, ml_range, ml_range_bearing, ml_exact, got 'ml'"):
        build(MultistaticConfig, {"method": "ml"}, "node")
    with pytest.raises(ValueError, match="ls needs 2 receivers"):
        Fusion(SonarNet(np.zeros(2), np.array([[2000.0, 0.0]])), MultistaticConfig(method="ls"))
