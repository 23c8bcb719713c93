"""Estimates and truth: interpolation, frames, signs, sides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from test import known_run as run
from uw_acoustic_loc.core.geometry import wrap_angle
from uw_acoustic_loc.core.types import Bearing, Point, Position
from uw_acoustic_loc.evaluation.errors import Errors, MapFrame, TruePoses, map_from_odom, source_errors, true_vehicle
from uw_acoustic_loc.evaluation.errors_bearing import bearing_errors
from uw_acoustic_loc.evaluation.errors_net import fix_errors


def true_pose(time, position, yaw, name="auv1"):
    return run.t_ns(time), f"/truth/{name}/odometry", run.odometry(time, np.array(position), yaw, np.eye(3), "map")


def source_at(position):
    return run.t_ns(0), "/truth/sources/a/position", Point(run.t_ns(0), np.array(position))


def test_yaw_goes_the_shortest_way(recorded):
    recording = recorded([true_pose(0, [0.0, 0.0, 0.0], 3.0), true_pose(2, [4.0, 2.0, -1.0], -3.0)])
    positions, yaw = TruePoses(recording.one("true_vehicle")).at(np.array([run.t_ns(0.5), run.t_ns(1.0)]))
    np.testing.assert_allclose(positions, [[1.0, 0.5, -0.25], [2.0, 1.0, -0.5]])
    step = (2 * np.pi - 6.0) / 4
    np.testing.assert_allclose(yaw, [wrap_angle(3.0 + step), np.pi], atol=1e-12)


def test_the_truth_does_not_cover_what_lies_outside(recorded):
    path = TruePoses(recorded([true_pose(1, [0.0] * 3, 0.0), true_pose(2, [0.0] * 3, 0.0)]).one("true_vehicle"))
    stamps = np.array([run.t_ns(time) for time in (0.999, 1.0, 2.0, 2.001)])
    assert path.covers(stamps).tolist() == [False, True, True, False]


@pytest.mark.parametrize("begin", [0.0, 0.1, 20.0])
def test_odom_is_the_pose_at_the_start_of_the_run_whenever_the_recording_begins(recorded, begin):
    recording = recorded([*run.truth(), *run.dead_reckoning(begin=begin)])
    frame = map_from_odom(recording, "/auv1", true_vehicle(recording, "/auv1"))
    np.testing.assert_allclose(frame.origin, [10.0, -20.0, -5.0], atol=1e-9)
    assert frame.yaw == pytest.approx(np.pi / 2)


def test_without_odometry_slam_tells_where_odom_is(recorded):
    rng = np.random.default_rng(0)
    recording = recorded([*run.truth(), *run.slam(rng)])
    frame = map_from_odom(recording, "/auv1", true_vehicle(recording, "/auv1"))
    np.testing.assert_allclose(frame.origin, [10.0, -20.0, -5.0], atol=5 * np.sqrt(run.COV.max()))


def test_covariances_turn_with_the_frame():
    turned = MapFrame(np.zeros(3), np.pi / 2).covs(np.diag([4.0, 1.0, 9.0])[None])[0]
    np.testing.assert_allclose(turned, np.diag([1.0, 4.0, 9.0]), atol=1e-12)


def test_an_estimate_in_map_stays_where_it_is(recorded):
    estimate = Position(run.t_ns(1), np.array([1.0, 2.0, 0.0]), np.eye(3), "map")
    event = (run.t_ns(1), "/auv1/sources/a/position", estimate)
    recording = recorded([*run.dead_reckoning(), event, source_at([1.0, 1.5, 0.0])])
    np.testing.assert_allclose(source_errors(recording, recording.one("source")).error, [[0.0, 0.5]])


def test_a_vehicle_of_another_name_has_the_only_truth(recorded):
    one = recorded([true_pose(0, [0.0] * 3, 0.0, "glider")])
    assert true_vehicle(one, "/auv1") is not None
    assert true_vehicle(one, "") is not None


def test_of_several_truths_only_the_own_one_counts(recorded):
    two = recorded([true_pose(0, [0.0] * 3, 0.0, "auv2"), true_pose(0, [5.0, 0.0, 0.0], 0.0, "auv3")])
    assert true_vehicle(two, "/auv1") is None
    np.testing.assert_allclose(true_vehicle(two, "/fleet/auv3").positions, [[5.0, 0.0, 0.0]])


@pytest.mark.parametrize(("heading", "expected"), [(0.0, np.pi / 2), (np.pi / 2, 0.0), (np.pi, -np.pi / 2)])
def test_a_source_to_port_has_a_positive_bearing(recorded, heading, expected):
    measured = Bearing(run.t_ns(1), wrap_angle(expected + 0.1), 0.01, np.zeros(3))
    events = [true_pose(0, [0.0] * 3, heading), true_pose(2, [0.0] * 3, heading), source_at([0.0, 10.0, 3.0])]
    recording = recorded([*events, (run.t_ns(1), "/auv1/sources/a/bearing", measured)])
    assert bearing_errors(recording, recording.one("bearing")).error == pytest.approx(0.1)


def test_the_bearing_is_seen_from_the_array(recorded):
    """A source abeam of an array that lies 2 m ahead of base_link."""
    measured = Bearing(run.t_ns(1), np.pi / 2, 0.01, np.array([2.0, 0.0, 0.0]))
    events = [true_pose(0, [0.0] * 3, np.pi / 2), true_pose(2, [0.0] * 3, np.pi / 2), source_at([-10.0, 2.0, 0.0])]
    recording = recorded([*events, (run.t_ns(1), "/auv1/sources/a/bearing", measured)])
    assert bearing_errors(recording, recording.one("bearing")).error == pytest.approx(0.0, abs=1e-12)


def test_of_both_sides_the_nearer_one_counts(recorded):
    sides = [Bearing(run.t_ns(1), side, 0.01, np.zeros(3)) for side in (-1.5, 1.6)]
    events = [true_pose(0, [0.0] * 3, 0.0), true_pose(2, [0.0] * 3, 0.0), source_at([0.0, 10.0, 0.0])]
    recording = recorded([*events, *((run.t_ns(1), "/auv1/sources/a/bearing", side) for side in sides)])
    errors = bearing_errors(recording, recording.one("bearing"))
    assert errors.error.shape == (1, 1)
    assert errors.error == pytest.approx(1.6 - np.pi / 2)


def test_without_net_positions_the_target_is_taken_at_the_stamp(recorded):
    still = [event for event in run.sonar(np.random.default_rng(1)) if event[1] != "/sonar/positions"]
    errors = fix_errors(recording := recorded(still), recording.one("fix"))
    bound = 5 * np.sqrt(run.FIX_COV[1, 1] / 100)
    assert abs(errors.error[:, 1].mean() - 10.0) < bound  # 5 m/s for 2 s


def test_nees_is_chi_square_and_unknown_covariances_stay_out():
    rng = np.random.default_rng(3)
    cov = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, 0.0], [0.5, 0.0, 1.0]])
    error = rng.multivariate_normal(np.zeros(3), cov, 2000)
    covs = np.repeat(cov[None], 2000, axis=0)
    covs[:1000] = np.diag([-1.0, 0.0, 0.0])
    error[:1000] = 1e6
    nees = Errors(np.arange(2000), error, error, covs).nees
    assert nees.size == 1000
    low, high = chi2.ppf([0.0005, 0.9995], 3000) / 3000
    assert low < nees.mean() < high
