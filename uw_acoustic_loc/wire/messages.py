"""Core types to ROS messages and back, one pair of functions per message type.

A message whose stamp is zero or whose numbers are not finite raises ValueError with what is wrong. A covariance never
does: what it does not know is unknown (see `core.types`), and the measurement stands.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..core.geometry import quat_from_yaw, yaw_from_quat
from ..core.types import (
    NO_INFORMATION,
    UNKNOWN,
    Array,
    Bearing,
    BodyVelocity,
    Imu,
    Odometry,
    Point,
    Position,
    Pressure,
    Scalar,
    unknown,
)
from .flat import Flat, FlatForm, Make, Part

# --- parts --------------------------------------------------------------------------------------------------------


def _part(name: str, **fields: Part | int) -> Part:
    return Part(f"geometry_msgs/msg/{name}", fields)


_POINT, _VECTOR = (_part(name, x=1, y=1, z=1) for name in ("Point", "Vector3"))
_QUATERNION = _part("Quaternion", x=1, y=1, z=1, w=1)
_POSE = _part("PoseWithCovariance", pose=_part("Pose", position=_POINT, orientation=_QUATERNION), covariance=36)
_TWIST = _part("TwistWithCovariance", twist=_part("Twist", linear=_VECTOR, angular=_VECTOR), covariance=36)
_STAMPED_POSE = _part("PoseWithCovarianceStamped", pose=_POSE)


def _finite(values: Array, parts: Mapping[str, slice]) -> None:
    """Raises ValueError naming the part that is not finite; numbers outside all parts are not checked."""
    if math.isfinite(values.dot(values)):  # the fastest check of all of them
        return
    for what, part in parts.items():
        if not math.isfinite(values[part].sum()):
            raise ValueError(f"{what} must be finite, got {values[part].tolist()}")


def _covariance(values: Array) -> Array:
    """(n, n) of a message's n * n numbers; usable ones stay as they are.

    -1 in the first place makes all of it unknown; elsewhere a negative or NaN variance is unknown by itself. A huge
    one is cut to a number that means no information, as infinity does. Neither has covariances with the others.
    """
    size = math.isqrt(values.size)
    cov = values.reshape(size, size)
    variances = cov.diagonal()
    if variances.min() >= 0.0 and variances.max() <= NO_INFORMATION and math.isfinite(values.dot(values)):
        return cov
    if variances[0] == UNKNOWN:
        return unknown(size)
    given = np.where(variances >= 0, variances, UNKNOWN)
    apart = (given < 0) | (given > NO_INFORMATION)
    cov = np.where(np.isfinite(cov) & ~apart & ~apart[:, None], cov, 0.0)
    np.fill_diagonal(cov, np.minimum(given, NO_INFORMATION))
    return cov


def _unit(what: str, quat: Array) -> Array:
    norm = math.sqrt(quat.dot(quat))
    if not 0.99 < norm < 1.01:
        raise ValueError(f"{what} must have length 1, got {norm:.6g}")
    return np.asarray(quat / norm)


# --- messages -----------------------------------------------------------------------------------------------------


def _odometry_to(value: Odometry) -> Flat:
    parts = (value.position, value.quat_xyzw, value.pose_cov.ravel(), value.linear, value.angular)
    values = np.concatenate([*parts, value.twist_cov.ravel()], dtype=float)
    return Flat(value.t_ns, (value.frame_id, value.child_frame_id), values)


def _odometry_from(flat: Flat) -> Odometry:
    t_ns, (frame_id, child_frame_id), values = flat
    _finite(values, _ODOMETRY_PARTS)
    return Odometry(
        t_ns=t_ns,
        position=values[:3],
        quat_xyzw=_unit("pose.orientation", values[3:7]),
        linear=values[43:46],
        angular=values[46:49],
        pose_cov=_covariance(values[7:43]),
        twist_cov=_covariance(values[49:]),
        frame_id=frame_id,
        child_frame_id=child_frame_id,
    )


_ODOMETRY_PARTS = {
    "pose.position": slice(3),
    "pose.orientation": slice(3, 7),
    "twist.linear": slice(43, 46),
    "twist.angular": slice(46, 49),
}
ODOMETRY = FlatForm(
    Part("nav_msgs/msg/Odometry", {"pose": _POSE, "twist": _TWIST}), _odometry_to, _odometry_from, ("child_frame_id",)
)


def _bearing_to(value: Bearing) -> Flat:
    """Puts the bearing into the yaw and its variance into covariance[35]."""
    values = np.zeros(43)
    values[:3], values[3:7] = value.position, quat_from_yaw(value.bearing)
    values[7], values[42] = -1.0, value.variance
    return Flat(value.t_ns, (value.frame_id,), values)


def _bearing_from(flat: Flat) -> Bearing:
    values = flat.values
    _finite(values, _BEARING_PARTS)
    variance = values.item(42)
    variance = min(variance, NO_INFORMATION) if variance > 0.0 else UNKNOWN
    yaw = yaw_from_quat(_unit("pose.orientation", values[3:7]))
    return Bearing(flat.t_ns, yaw, variance, values[:3], flat.names[0])


_BEARING_PARTS = {"pose.orientation": slice(3, 7), "pose.position": slice(3)}
BEARING = FlatForm(_STAMPED_POSE, _bearing_to, _bearing_from)


def _position_to(value: Position) -> Flat:
    """Leaves the orientation unknown (its variances are -1)."""
    values = np.zeros(43)
    values[:3], values[6] = value.position, 1.0
    _cov_without_turn(value.cov, values[7:])
    return Flat(value.t_ns, (value.frame_id,), values)


def _position_from(flat: Flat) -> Position:
    values = flat.values
    _finite(values, _POSITION_PARTS)
    return Position(flat.t_ns, values[:3], _covariance(values[7:])[:3, :3], flat.names[0])


_POSITION_PARTS = {"pose.position": slice(3)}
POSITION = FlatForm(_STAMPED_POSE, _position_to, _position_from)


def _imu_to(value: Imu) -> Flat:
    """Leaves the orientation unknown (its covariance is -1)."""
    values = np.zeros(37)
    values[3], values[4] = 1.0, -1.0
    values[13:16], values[16:25] = value.angular, value.angular_cov.ravel()
    values[25:28], values[28:] = value.acceleration, value.acceleration_cov.ravel()
    return Flat(value.t_ns, (value.frame_id,), values)


def _imu_from(flat: Flat) -> Imu:
    values = flat.values
    _finite(values, _IMU_PARTS)
    covs = _covariance(values[16:25]), _covariance(values[28:])
    return Imu(flat.t_ns, values[13:16], values[25:28], *covs, flat.names[0])


_IMU_PARTS = {
    "angular_velocity": slice(13, 16),
    "linear_acceleration": slice(25, 28),
}
IMU = FlatForm(
    Part(
        "sensor_msgs/msg/Imu",
        {
            "orientation": _QUATERNION,
            "orientation_covariance": 9,
            "angular_velocity": _VECTOR,
            "angular_velocity_covariance": 9,
            "linear_acceleration": _VECTOR,
            "linear_acceleration_covariance": 9,
        },
    ),
    _imu_to,
    _imu_from,
)


def _body_velocity_to(value: BodyVelocity) -> Flat:
    """Leaves the angular velocity unknown."""
    values = np.zeros(42)
    values[:3] = value.linear
    _cov_without_turn(value.linear_cov, values[6:])
    return Flat(value.t_ns, (value.frame_id,), values)


def _body_velocity_from(flat: Flat) -> BodyVelocity:
    values = flat.values
    _finite(values, _TWIST_PARTS)
    return BodyVelocity(flat.t_ns, values[:3], _covariance(values[6:])[:3, :3], flat.names[0])


_TWIST_PARTS = {"twist.linear": slice(3)}
BODY_VELOCITY = FlatForm(_part("TwistWithCovarianceStamped", twist=_TWIST), _body_velocity_to, _body_velocity_from)


def _point_to(value: Point) -> Flat:
    return Flat(value.t_ns, (value.frame_id,), np.array(value.position, dtype=float))


def _point_from(flat: Flat) -> Point:
    _finite(flat.values, {"point": slice(3)})
    return Point(flat.t_ns, flat.values, flat.names[0])


POINT = FlatForm(_part("PointStamped", point=_POINT), _point_to, _point_from)


def _pressure_to(value: Pressure) -> Flat:
    return Flat(value.t_ns, (value.frame_id,), np.array([value.pressure, value.variance], dtype=float))


def _pressure_from(flat: Flat) -> Pressure:
    _finite(flat.values, {"fluid_pressure and variance": slice(2)})
    pressure, variance = flat.values.tolist()
    return Pressure(flat.t_ns, pressure, variance, flat.names[0])


PRESSURE = FlatForm(
    Part("sensor_msgs/msg/FluidPressure", {"fluid_pressure": 1, "variance": 1}), _pressure_to, _pressure_from
)

_NO_TURN = -np.eye(3)


def _cov_without_turn(cov: Array, out: Array) -> None:
    """Fills the covariance of a pose or twist (36,) whose turning half is unknown."""
    whole = out.reshape(6, 6)
    whole[:3, :3], whole[3:, 3:] = cov, _NO_TURN


def scalar_to(make: Make, value: Scalar) -> Any:
    """Builds a std_msgs/Float64."""
    return make("std_msgs/msg/Float64", data=float(value.value))


def scalar_from(msg: Any, t_ns: int) -> Scalar:
    """Reads a std_msgs/Float64; the stamp is the instant of reception, because the message has none."""
    _finite(np.array([msg.data]), {"data": slice(1)})
    return Scalar(t_ns, float(msg.data))
