"""Sensors that sit elsewhere and point elsewhere: their values as one at base_link with its axes would give them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uw_acoustic_loc.contract import Input
from uw_acoustic_loc.core.types import Arrivals, Bearing, BodyVelocity, Imu, Odometry, Point
from uw_acoustic_loc.stages.inputs.placing import Placing
from uw_acoustic_loc.stages.inputs.settings import Frames, InputConfig, input_configs

RPY, ARM = (0.4, -0.3, 2.0), (0.5, -0.2, 0.3)
SENSOR = Rotation.from_euler("ZYX", RPY[::-1])  # sensor axes -> base_link
VELOCITY, RATES = np.array([1.5, 0.2, -0.1]), np.array([0.1, -0.2, 0.4])
NED = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FRD = Rotation.from_matrix(np.diag([1, -1, -1]))


def test_a_velocity_is_measured_where_the_log_sits() -> None:
    measured = SENSOR.inv().apply(VELOCITY + np.cross(RATES, ARM))
    placed = Placing(InputConfig(translation=ARM, rotation=RPY)).place(BodyVelocity(1, measured), RATES)
    np.testing.assert_allclose(placed.linear, VELOCITY, atol=1e-12)


def test_an_imu_turns_with_its_axes_and_feels_the_turn_about_base_link() -> None:
    force = np.array([0.3, -0.1, 9.7])
    felt = force + np.cross(RATES, np.cross(RATES, ARM))
    cov = np.diag([1.0, 2.0, 3.0])
    turned = SENSOR.inv().as_matrix() @ cov @ SENSOR.as_matrix()
    imu = Imu(1, SENSOR.inv().apply(RATES), SENSOR.inv().apply(felt), turned, np.eye(3))
    placed = Placing(InputConfig(translation=ARM, rotation=RPY)).place(imu, np.zeros(3))
    np.testing.assert_allclose(placed.angular, RATES, atol=1e-12)
    np.testing.assert_allclose(placed.acceleration, force, atol=1e-12)
    np.testing.assert_allclose(placed.angular_cov, cov, atol=1e-12)


@pytest.mark.parametrize("ned", [False, True])
def test_an_odometry_of_a_sensor_becomes_that_of_base_link(ned: bool) -> None:
    """The same vehicle told by a sensor elsewhere, in REP-103's axes or in north, east, down."""
    attitude, position = Rotation.from_euler("ZYX", (0.7, 0.2, -0.1)), np.array([10.0, -4.0, -7.0])
    sensor_attitude = attitude * SENSOR
    sensor_position = position + attitude.apply(ARM)
    linear = SENSOR.inv().apply(VELOCITY + np.cross(RATES, ARM))
    angular = SENSOR.inv().apply(RATES)
    if ned:
        sensor_attitude = NED.inv() * sensor_attitude * FRD
        sensor_position, linear, angular = NED.apply(sensor_position), FRD.apply(linear), FRD.apply(angular)
    told = Odometry(1, sensor_position, sensor_attitude.as_quat(), linear, angular, np.eye(6), np.eye(6))
    config = InputConfig(translation=ARM, rotation=RPY, convention="ned" if ned else "")
    placed = Placing(config).place(told, np.zeros(3))
    np.testing.assert_allclose(placed.position, position, atol=1e-12)
    np.testing.assert_allclose((Rotation.from_quat(placed.quat_xyzw) * attitude.inv()).magnitude(), 0, atol=1e-7)
    np.testing.assert_allclose(placed.linear, VELOCITY, atol=1e-12)
    np.testing.assert_allclose(placed.angular, RATES, atol=1e-12)


def test_a_bearing_clockwise_from_the_bow_becomes_one_to_the_other_side() -> None:
    ned = Placing(InputConfig(convention="ned"))
    placed = ned.place(Bearing(1, 0.6, 0.01, np.array([1.0, 0.5, 0.2])), RATES)
    assert placed.bearing == pytest.approx(-0.6)
    np.testing.assert_allclose(placed.position, [1.0, -0.5, -0.2])
    np.testing.assert_allclose(ned.place(Point(1, np.array([1.0, 2.0, 3.0])), RATES).position, [2.0, 1.0, -3.0])


# --- settings --------------------------------------------------------------------------------------------------------


def take(_: Any) -> list[Any]:
    return []


DVL = Input("dvl/twist", BodyVelocity, take, frame="base_link")
ODOMETRY = Input("odometry", Odometry, take)


def test_settings_name_an_input_and_what_is_allowed() -> None:
    inputs = [DVL, Input("buoys/arrivals", Arrivals, take)]
    given = {"inputs.dvl/twist.stamp_offset": -0.3, "inputs.dvl/twist.accept_frames": ["dvl_link"], "lateness": 1.0}
    assert input_configs(given, inputs, "node /slam")["dvl/twist"] == InputConfig(-0.3, ("dvl_link",))
    for values, words in [
        ({"inputs.dvl.stamp_offset": 0.1}, "must name one of the inputs dvl/twist, buoys/arrivals, got 'dvl'"),
        ({"inputs.dvl/twist.stamp_ofset": 0.1}, "did you mean 'stamp_offset'"),
        ({"inputs.dvl/twist.rotation": [0.1]}, "must have 3 elements, got 1"),
        ({"inputs.dvl/twist.convention": "NED"}, "must be one of , enu, ned, got 'NED'"),
        ({"inputs.buoys/arrivals.convention": "ned"}, "a Arrivals can be neither turned nor moved"),
    ]:
        with pytest.raises(ValueError, match=words):
            input_configs(values, inputs, "node /slam")


@pytest.mark.parametrize("frame", ["", "dvl_link", "auv1/dvl_link"])
def test_another_frame_is_refused_with_the_cure_and_accepted_when_it_is_listed(frame: str) -> None:
    value = BodyVelocity(1, VELOCITY, frame_id=frame)
    with pytest.raises(ValueError, match=r"got '.*': if that is right, set inputs.dvl/twist.accept_frames"):
        Frames(DVL, InputConfig()).check(value)
    Frames(DVL, InputConfig(accept_frames=("", "dvl_link"))).check(value)


def odometry(frame: str) -> Odometry:
    return Odometry(1, np.zeros(3), np.array([0, 0, 0, 1.0]), VELOCITY, RATES, frame_id=frame)


def test_an_odometry_may_be_in_any_frame_but_stays_there() -> None:
    for frame in ("odom", "map", "auv1/odom", "world"):
        frames = Frames(ODOMETRY, InputConfig())
        frames.check(odometry(frame))
        with pytest.raises(ValueError, match=f"must stay '{frame}', got 'other'"):
            frames.check(odometry("other"))


def test_north_east_down_is_never_guessed() -> None:
    with pytest.raises(ValueError, match=r"'odom_ned' looks like north, east, down: set inputs.odometry.convention to"):
        Frames(ODOMETRY, InputConfig()).check(odometry("odom_ned"))
    Frames(ODOMETRY, InputConfig(convention="ned")).check(odometry("odom_ned"))
    Frames(ODOMETRY, InputConfig(convention="enu")).check(odometry("odom_ned"))
