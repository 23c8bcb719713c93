import math
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.core.multistatic.association import assign
from uw_acoustic_loc.core.multistatic.track import Sighting, Track, Tracker, TrackRules, chi_square_limit

RULES = TrackRules(
    process_noise=0.01, manoeuvre_noise=0.01, speed_std=5.0, confirm_hits=3, confirm_pings=4, coast_time=30.0
)
SECOND = 1_000_000_000
PERIOD = 4


def sighting(x, y, std=30.0, delay=0.0):
    return Sighting(np.array([x, y], dtype=float), std**2 * np.eye(2), delay)


def track(x, y, vx=0.0, vy=0.0, std=30.0):
    return Track.start(np.array([x, y, vx, vy], dtype=float), np.diag([std**2, std**2, 1.0, 1.0]), 0)


class Points:
    """A scan of positions, each a sighting by itself."""

    def __init__(self, *sightings):
        self.left = list(sightings)

    def assign(self, tracks):
        fit = np.array([[self._fit(t, s) for s in self.left] for t in tracks]).reshape(len(tracks), len(self.left), 2)
        pairs = assign(fit[..., 0], fit[..., 1], chi_square_limit(4.0, 2))
        claimed = [self.left[pairs[i]] if i in pairs else None for i in range(len(tracks))]
        self.left = [s for j, s in enumerate(self.left) if j not in pairs.values()]
        return claimed

    def rest(self):
        return self.left

    @staticmethod
    def _fit(track, sighting):
        return track.nis(sighting), np.linalg.slogdet(track.ahead(sighting.delay)[1] + sighting.cov)[1]


def follow(pings, rules=RULES):
    """Confirmed ids after each ping; `pings` are lists of (x, y)."""
    tracker = Tracker(rules)
    return [
        [t.id for t in tracker.step(k * PERIOD * SECOND, Points(*(sighting(*p) for p in points)))]
        for k, points in enumerate(pings)
    ]


# --- filter ---------------------------------------------------------------------------------------------------------


ALIKE = (0.3, 0.3)  # modes that do not differ: a Kalman filter


def test_two_predictions_are_one_long_prediction():
    start = track(100, -50, 3, -2)
    whole, steps = start.predict(7.0, ALIKE), start.predict(2.0, ALIKE).predict(5.0, ALIKE)
    np.testing.assert_allclose(whole.mean, [121, -64, 3, -2])
    np.testing.assert_allclose(steps.mean, whole.mean)
    np.testing.assert_allclose(steps.cov, whole.cov, atol=1e-9)


def test_update_is_the_information_filters():
    before, seen = track(100, -50, 3, -2).predict(4.0, ALIKE), sighting(130, -40, std=20.0, delay=1.5)
    H = np.array([[1, 0, 1.5, 0], [0, 1, 0, 1.5]])
    information = np.linalg.inv(before.cov) + H.T @ H / 400.0
    mean = np.linalg.solve(information, np.linalg.solve(before.cov, before.mean) + H.T @ seen.position / 400.0)
    after = before.update(seen)
    np.testing.assert_allclose(after.mean, mean)
    np.testing.assert_allclose(after.cov, np.linalg.inv(information), atol=1e-9)
    np.testing.assert_allclose(after.cov, after.cov.T, rtol=1e-12)


def test_a_sighting_is_compared_with_where_the_target_is_when_the_ping_meets_it():
    position, cov = track(100, -50, 3, -2).ahead(2.0)
    np.testing.assert_allclose(position, [106, -54])
    np.testing.assert_allclose(cov, (30.0**2 + 2.0**2) * np.eye(2))
    assert track(100, -50, 3, -2).nis(sighting(106, -54, delay=2.0)) == pytest.approx(0, abs=1e-12)


def test_tracks_are_honest_from_their_first_sighting_on():
    from scipy.stats import chi2

    runs, pings, q = 150, 12, 0.05
    rules = TrackRules(q, q, 5.0, 1, 1, 1e9)
    rng = np.random.default_rng(3)
    nees = np.zeros((runs, pings))
    for run in range(runs):
        tracker = Tracker(rules)
        truth = np.array([0.0, 0.0, *rng.normal(0, 5.0, 2)])
        for k in range(pings):
            moved = Track.start(truth, np.zeros((4, 4)), 0).predict(PERIOD if k else 0.0, (q, q))
            truth = rng.multivariate_normal(moved.mean, moved.cov)
            delay, std = rng.uniform(0, 3), np.array([40.0, 15.0])
            at = truth[:2] + delay * truth[2:] + std * rng.standard_normal(2)
            (found,) = tracker.step(k * PERIOD * SECOND, Points(Sighting(at, np.diag(std**2), delay)))
            error = found.mean - truth
            nees[run, k] = error @ np.linalg.solve(found.cov, error)
    low, high = chi2.ppf([0.0005, 0.9995], 4 * runs) / runs
    for k in range(pings):
        assert low < nees[:, k].mean() < high, k


def test_tracks_are_honest_about_targets_that_manoeuvre_now_and_then():
    """Targets switch between the modes as the filter assumes; the limits are three times the spread over the runs."""
    rng, noises, pings = np.random.default_rng(4), (0.002, 0.5), 60
    nees = []
    for _ in range(60):
        tracker = Tracker(TrackRules(*noises, 5.0, 1, 1, 1e9))
        truth, mode, own = np.array([0.0, 0.0, *rng.normal(0, 5.0, 2)]), int(rng.random() < 60 / 360), []
        for k in range(pings):
            mode = 1 - mode if rng.random() < -math.expm1(-PERIOD / (300.0, 60.0)[mode]) else mode
            moved = Track.start(truth, np.zeros((4, 4)), 0).predict(PERIOD, (noises[mode], noises[mode]))
            truth = rng.multivariate_normal(moved.mean, moved.cov)
            (found,) = tracker.step(k * PERIOD * SECOND, Points(sighting(*(truth[:2] + rng.normal(0, 30.0, 2)))))
            error = found.mean - truth
            own.append(error @ np.linalg.solve(found.cov, error) / 4)
        nees.append(np.mean(own[5:]))
    assert abs(np.mean(nees) - 1) < 3 * np.std(nees) / math.sqrt(len(nees))


def test_position_std_is_the_longest_half_axis():
    turned = np.array([[math.cos(0.5), -math.sin(0.5)], [math.sin(0.5), math.cos(0.5)]])
    cov = np.eye(4)
    cov[:2, :2] = turned @ np.diag([900.0, 16.0]) @ turned.T
    assert Track.start(np.zeros(4), cov, 0).position_std == pytest.approx(30.0)


# --- association ----------------------------------------------------------------------------------------------------


def test_assignment_is_global_not_greedy():
    nis = np.array([[4.0, 99.0], [1.0, 6.0]])  # the nearest pair of all is 1 -> 0
    assert assign(nis, np.zeros((2, 2)), limit=20.0) == {0: 0, 1: 1}


def test_nothing_beyond_the_gate_is_assigned_nor_for_its_sake():
    assert assign(np.array([[13.1]]), np.zeros((1, 1)), limit=13.2) == {0: 0}
    assert assign(np.array([[13.3]]), np.zeros((1, 1)), limit=13.2) == {}
    assert assign(np.empty((0, 1)), np.empty((0, 1)), limit=13.2) == {}
    # two bad pairs are not better than a good one
    assert assign(np.array([[0.0, 12.0], [12.0, 99.0]]), np.zeros((2, 2)), limit=13.2) == {0: 0}


def test_a_sharp_track_goes_before_a_vague_one_that_fits_as_well():
    assert assign(np.array([[2.0], [2.0]]), np.array([[8.0], [3.0]]), limit=13.2) == {1: 0}


@pytest.mark.parametrize("dof", [2, 4, 10, 30])
@pytest.mark.parametrize("sigma", [2.0, 3.0, 4.0])
def test_chi_square_limit_is_the_quantile_of_as_many_sigma(dof, sigma):
    from scipy.stats import chi2, norm

    assert chi_square_limit(sigma, dof) == pytest.approx(chi2.isf(norm.sf(sigma), dof), rel=0.06)


def test_confirmed_tracks_choose_before_tentative_ones():
    tracker = Tracker(RULES)
    for k in range(3):
        tracker.step(k * PERIOD * SECOND, Points(sighting(0, 0)))
    tracker.step(3 * PERIOD * SECOND, Points(sighting(0, 0), sighting(40, 0)))  # the second begins a tentative track
    (confirmed,) = tracker.step(4 * PERIOD * SECOND, Points(sighting(30, 0)))  # nearer to the tentative one
    assert confirmed.seen_ns == 4 * PERIOD * SECOND
    assert tracker.tentative == 1


# --- life of a track ------------------------------------------------------------------------------------------------

HERE, NONE = [(0, 0)], []


def test_a_track_is_confirmed_by_m_of_n_pings_and_keeps_its_id():
    assert follow([HERE, HERE, HERE, HERE]) == [[], [], [1], [1]]
    assert follow([HERE, NONE, HERE, HERE, NONE, HERE]) == [[], [], [], [1], [1], [1]]


def test_a_track_that_cannot_be_confirmed_any_more_is_dropped():
    # hit, miss, miss: 3 of 4 is out of reach; the next two sightings begin anew
    assert follow([HERE, NONE, NONE, HERE, HERE]) == [[], [], [], [], []]
    tracker = Tracker(RULES)
    for k, points in enumerate([HERE, NONE, NONE]):
        tracker.step(k * PERIOD * SECOND, Points(*(sighting(*p) for p in points)))
    assert tracker.tentative == 0


def test_a_confirmed_track_coasts_and_ends_and_its_id_is_not_used_again():
    ids = follow([HERE] * 3 + [NONE] * 8 + [HERE] * 3)
    assert ids[2:10] == [[1]] * 8  # last seen at 8 s, coasts up to 38 s
    assert ids[10:13] == [[]] * 3  # 40 s
    assert ids[13] == [2]


def test_a_lone_sighting_does_not_prolong_a_tracks_life_but_two_do():
    lone = follow([HERE] * 3 + [NONE] * 5 + [HERE] + [NONE] * 3)  # last seen at 8 s, alone at 32 s
    assert lone[9:] == [[1], [], []]
    twice = follow([HERE] * 3 + [NONE] * 5 + [HERE, NONE, HERE] + [NONE] * 3)
    assert twice[9:] == [[1]] * 5


def test_a_coasting_track_moves_on_and_grows():
    tracker = Tracker(RULES)
    for k in range(6):
        (before,) = tracker.step(k * PERIOD * SECOND, Points(sighting(20.0 * k, 0))) or [None]
    (after,) = tracker.step(6 * PERIOD * SECOND, Points())
    np.testing.assert_allclose(after.mean[:2], before.mean[:2] + PERIOD * before.mean[2:])
    assert after.position_std > before.position_std


def test_ids_stay_with_their_targets_when_the_targets_pass_each_other():
    tracker = Tracker(RULES)
    rng = np.random.default_rng(5)
    for k in range(30):
        x = -900.0 + 60.0 * k
        points = [(x, 60.0), (-x, -60.0)]
        order = rng.permutation(2)
        seen = [sighting(*(np.array(points[i]) + rng.normal(0, 10, 2)), std=10.0) for i in order]
        tracks = tracker.step(k * PERIOD * SECOND, Points(*seen))
    assert len(tracks) == 2
    by_id = {t.id: t.mean for t in tracks}
    assert set(by_id) == {1, 2}
    east = [t for t in by_id.values() if t[2] > 0]
    assert len(east) == 1
    np.testing.assert_allclose(east[0], [840, 60, 15, 0], atol=30)


def turning(rng, runs=20, pings=40):
    """Courses (pings, 2) at 8 m/s that turn by 1.5 degrees per second from ping 15 on, and seen with 30 m."""
    heading = np.radians(1.5) * PERIOD * np.maximum(np.arange(pings) - 15, 0)
    course = 8.0 * PERIOD * np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    for _ in range(runs):
        yield course, course + rng.normal(0, 30.0, course.shape)


def test_a_turning_target_is_noticed_and_followed():
    errors = {}
    for noise in (0.01, 0.5):
        tracker_rules = replace(RULES, manoeuvre_noise=noise)
        noticed = {"before": 0, "after": 0}
        for course, seen in turning(np.random.default_rng(6)):
            tracker = Tracker(tracker_rules)
            for k, point in enumerate(seen):
                tracks = tracker.step(k * PERIOD * SECOND, Points(sighting(*point)))
                noticed["before"] += k < 15 and any(t.shares[1] > 0.5 for t in tracks)
                noticed["after"] += k >= 25 and any(t.shares[1] > 0.5 for t in tracks)
                if k >= 20:
                    errors.setdefault(noise, []).append(np.hypot(*(tracks[0].mean[:2] - course[k])))
    assert noticed["before"] < 0.1 * 20 * 15
    assert noticed["after"] > 0.2 * 20 * 15
    assert np.median(errors[0.5]) < 40  # a fix alone has 35
    assert np.percentile(errors[0.5], 90) < 0.5 * np.percentile(errors[0.01], 90)


def test_a_ping_that_is_not_later_is_refused():
    tracker = Tracker(RULES)
    tracker.step(5, Points())
    with pytest.raises(ValueError, match="t_ns must be after the ping before, 5, got 5"):
        tracker.step(5, Points())
