"""The simulated IMU, DVL, dead reckoning and truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.core.geometry import wrap_angle, yaw_from_quat
from uw_acoustic_loc.sim.scenario import Scenario, Vehicle, Waypoint
from uw_acoustic_loc.sim.vehicle import VehicleSource

VEHICLE = Vehicle(waypoints=(Waypoint(10, 20), Waypoint(50, 20), Waypoint(50, 60)))
SCENARIO = Scenario(vehicle=VEHICLE, duration=40.0)
QUIET = dict.fromkeys(("gyro_std", "accelerometer_std", "gyro_bias_std", "dvl_std", "dvl_bias_std"), 0.0)


def collected(scenario: Scenario) -> dict[str, list]:
    values: dict[str, list] = {}
    for t_ns, topic, value in VehicleSource(scenario).events():
        assert t_ns == value.t_ns
        values.setdefault(topic, []).append(value)
    return values


def test_rates_order_and_frames():
    stamps = [event[0] for event in VehicleSource(SCENARIO).events()]
    assert stamps == sorted(stamps) and stamps[0] == SCENARIO.start_ns
    values = collected(SCENARIO)
    assert {topic: len(v) for topic, v in values.items()} == {
        "imu/data": 4001,
        "dvl/twist": 201,
        "odometry": 801,
        "/truth/auv1/odometry": 801,
    }
    assert (values["odometry"][0].frame_id, values["odometry"][0].child_frame_id) == ("odom", "base_link")
    assert values["/truth/auv1/odometry"][0].frame_id == "map"
    assert {output.topic for output in VehicleSource(SCENARIO).outputs} == set(values)


def test_imu_feels_gravity_and_a_port_turn_pushes_to_port():
    values = collected(replace(SCENARIO, vehicle=replace(VEHICLE, **QUIET)))
    rates = np.array([imu.angular for imu in values["imu/data"]])
    force = np.array([imu.acceleration for imu in values["imu/data"]])
    np.testing.assert_array_equal(force[:, 2], 9.81)
    turning = rates[:, 2] > 0
    assert 800 < turning.sum() < 900  # a quarter of a circle of 8 m at 1.5 m/s
    np.testing.assert_allclose(force[turning, 1], 1.5**2 / 8)
    assert rates[:, 2].sum() / 100 == pytest.approx(math.pi / 2, abs=0.01)


def test_without_noise_dead_reckoning_is_the_truth_seen_from_the_start():
    values = collected(replace(SCENARIO, vehicle=replace(VEHICLE, **QUIET)))
    first = values["odometry"][0]
    assert np.all(first.position == 0) and yaw_from_quat(first.quat_xyzw) == 0
    for reckoned, true in zip(values["odometry"][::50], values["/truth/auv1/odometry"][::50], strict=True):
        np.testing.assert_allclose(reckoned.position, true.position - [10, 20, -15], atol=0.02)
        assert abs(wrap_angle(yaw_from_quat(reckoned.quat_xyzw) - yaw_from_quat(true.quat_xyzw))) < 2e-3


def test_noise_has_the_scenarios_size():
    values = collected(SCENARIO)
    assert np.std([imu.angular[0] for imu in values["imu/data"]]) == pytest.approx(0.01, rel=0.1)
    assert np.std([imu.acceleration[0] for imu in values["imu/data"]]) == pytest.approx(0.1, rel=0.1)
    assert np.std([dvl.linear[1] for dvl in values["dvl/twist"]]) == pytest.approx(0.005, rel=0.2)


def test_drift_covariance_is_honest():
    runs, nees = 60, []
    for seed in range(runs):
        values = collected(replace(SCENARIO, seed=seed, vehicle=replace(VEHICLE, imu_rate=20.0)))
        reckoned, true = values["odometry"][-1], values["/truth/auv1/odometry"][-1]
        turn = wrap_angle(yaw_from_quat(reckoned.quat_xyzw) - yaw_from_quat(true.quat_xyzw))
        error = np.append((reckoned.position - true.position + [10, 20, -15])[:2], turn)
        cov = reckoned.pose_cov[np.ix_([0, 1, 5], [0, 1, 5])]
        nees.append(error @ np.linalg.solve(cov, error) / 3)
    assert abs(np.mean(nees) - 1) < 4 * math.sqrt(2 / 3 / runs)


def test_same_seed_same_events():
    one, two = (list(VehicleSource(SCENARIO).events()) for _ in range(2))
    assert all(a[:2] == b[:2] for a, b in zip(one, two, strict=True))
    last = [event[2] for event in (one[-2], two[-2])]
    np.testing.assert_array_equal(last[0].position, last[1].position)


def test_no_vehicle():
    with pytest.raises(ValueError, match="vehicle: the scenario has none"):
        VehicleSource(Scenario())
