"""Core types to ROS messages and back, one pair of functions per message type.

`make` builds a message of a named type from its fields: rclpy's classes in a node, rosbags' offline (see `Make`).
Reading goes by attribute, so that both kinds of message are read by the same code. A message whose stamp is zero or
whose numbers are not finite raises ValueError with what is wrong.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from ..core.geometry import quat_from_yaw, yaw_from_quat
from ..core.types import (
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
from . import record


class Make(Protocol):
    """Builds messages; `octets` turns bytes into what a uint8[] field takes fastest."""

    def __call__(self, msgtype: str, **fields: Any) -> Any: ...

    def octets(self, data: bytes) -> Any: ...


# --- parts --------------------------------------------------------------------------------------------------------


def header(make: Make, t_ns: int, frame_id: str) -> Any:
    """std_msgs/Header."""
    stamp = make("builtin_interfaces/msg/Time", sec=t_ns // 1_000_000_000, nanosec=t_ns % 1_000_000_000)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def stamp_ns(msg: Any) -> int:
    """The header's stamp in nanoseconds; zero means that nobody set it."""
    t_ns = int(msg.header.stamp.sec) * 1_000_000_000 + int(msg.header.stamp.nanosec)
    if t_ns <= 0:
        raise ValueError(f"header.stamp must be set, got {t_ns} ns")
    return t_ns


def _xyz(make: Make, kind: str, values: Array) -> Any:
    x, y, z = (float(v) for v in values)
    return make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def _quat(make: Make, quat_xyzw: Array) -> Any:
    x, y, z, w = (float(v) for v in quat_xyzw)
    return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def _read_xyz(what: str, vector: Any) -> Array:
    return _finite(what, np.array([vector.x, vector.y, vector.z], dtype=float))


def _read_quat(what: str, q: Any) -> Array:
    quat = _finite(what, np.array([q.x, q.y, q.z, q.w], dtype=float))
    norm = float(np.linalg.norm(quat))
    if not 0.99 < norm < 1.01:
        raise ValueError(f"{what} must have length 1, got {norm:.6g}")
    return np.asarray(quat / norm)


def _read_cov(what: str, flat: Any, size: int) -> Array:
    return _finite(what, np.array(flat, dtype=float).reshape(size, size))


def _finite(what: str, values: Array) -> Array:
    if not math.isfinite(values.sum()):
        raise ValueError(f"{what} must be finite, got {values.tolist()}")
    return values


# --- messages -----------------------------------------------------------------------------------------------------


def odometry_to(make: Make, value: Odometry) -> Any:
    """nav_msgs/Odometry."""
    pose = make(
        "geometry_msgs/msg/Pose", position=_xyz(make, "Point", value.position), orientation=_quat(make, value.quat_xyzw)
    )
    twist = make(
        "geometry_msgs/msg/Twist",
        linear=_xyz(make, "Vector3", value.linear),
        angular=_xyz(make, "Vector3", value.angular),
    )
    return make(
        "nav_msgs/msg/Odometry",
        header=header(make, value.t_ns, value.frame_id),
        child_frame_id=value.child_frame_id,
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=value.pose_cov.reshape(36)),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=value.twist_cov.reshape(36)),
    )


def odometry_from(msg: Any) -> Odometry:
    """From nav_msgs/Odometry."""
    pose, twist = msg.pose.pose, msg.twist.twist
    return Odometry(
        t_ns=stamp_ns(msg),
        position=_read_xyz("pose.position", pose.position),
        quat_xyzw=_read_quat("pose.orientation", pose.orientation),
        linear=_read_xyz("twist.linear", twist.linear),
        angular=_read_xyz("twist.angular", twist.angular),
        pose_cov=_read_cov("pose.covariance", msg.pose.covariance, 6),
        twist_cov=_read_cov("twist.covariance", msg.twist.covariance, 6),
        frame_id=msg.header.frame_id,
        child_frame_id=msg.child_frame_id,
    )


def bearing_to(make: Make, value: Bearing) -> Any:
    """geometry_msgs/PoseWithCovarianceStamped: yaw = bearing, covariance[35] = its variance."""
    cov = unknown(6)
    cov[5, 5] = value.variance
    return _pose_to(make, value.t_ns, value.frame_id, value.position, quat_from_yaw(value.bearing), cov)


def bearing_from(msg: Any) -> Bearing:
    """From geometry_msgs/PoseWithCovarianceStamped."""
    pose = msg.pose.pose
    variance = float(msg.pose.covariance[35])
    if not 0.0 < variance < math.inf:
        raise ValueError(f"pose.covariance[35], the bearing's variance, must be positive, got {variance!r}")
    yaw = yaw_from_quat(_read_quat("pose.orientation", pose.orientation))
    return Bearing(stamp_ns(msg), yaw, variance, _read_xyz("pose.position", pose.position), msg.header.frame_id)


def position_to(make: Make, value: Position) -> Any:
    """geometry_msgs/PoseWithCovarianceStamped without an orientation (its variances are -1)."""
    cov = np.zeros((6, 6))
    cov[:3, :3] = value.cov
    cov[3:, 3:] = -np.eye(3)
    return _pose_to(make, value.t_ns, value.frame_id, value.position, quat_from_yaw(0.0), cov)


def position_from(msg: Any) -> Position:
    """From geometry_msgs/PoseWithCovarianceStamped."""
    cov = _read_cov("pose.covariance", msg.pose.covariance, 6)[:3, :3]
    return Position(stamp_ns(msg), _read_xyz("pose.position", msg.pose.pose.position), cov, msg.header.frame_id)


def _pose_to(make: Make, t_ns: int, frame_id: str, position: Array, quat: Array, cov: Array) -> Any:
    pose = make("geometry_msgs/msg/Pose", position=_xyz(make, "Point", position), orientation=_quat(make, quat))
    return make(
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        header=header(make, t_ns, frame_id),
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=cov.reshape(36)),
    )


def imu_to(make: Make, value: Imu) -> Any:
    """sensor_msgs/Imu without an orientation (its covariance is -1)."""
    return make(
        "sensor_msgs/msg/Imu",
        header=header(make, value.t_ns, value.frame_id),
        orientation=_quat(make, quat_from_yaw(0.0)),
        orientation_covariance=unknown(3).reshape(9),
        angular_velocity=_xyz(make, "Vector3", value.angular),
        angular_velocity_covariance=value.angular_cov.reshape(9),
        linear_acceleration=_xyz(make, "Vector3", value.acceleration),
        linear_acceleration_covariance=value.acceleration_cov.reshape(9),
    )


def imu_from(msg: Any) -> Imu:
    """From sensor_msgs/Imu."""
    return Imu(
        t_ns=stamp_ns(msg),
        angular=_read_xyz("angular_velocity", msg.angular_velocity),
        acceleration=_read_xyz("linear_acceleration", msg.linear_acceleration),
        angular_cov=_read_cov("angular_velocity_covariance", msg.angular_velocity_covariance, 3),
        acceleration_cov=_read_cov("linear_acceleration_covariance", msg.linear_acceleration_covariance, 3),
        frame_id=msg.header.frame_id,
    )


def body_velocity_to(make: Make, value: BodyVelocity) -> Any:
    """geometry_msgs/TwistWithCovarianceStamped; angular unknown."""
    cov = np.zeros((6, 6))
    cov[:3, :3] = value.linear_cov
    cov[3:, 3:] = -np.eye(3)
    zero = _xyz(make, "Vector3", np.zeros(3))
    twist = make("geometry_msgs/msg/Twist", linear=_xyz(make, "Vector3", value.linear), angular=zero)
    return make(
        "geometry_msgs/msg/TwistWithCovarianceStamped",
        header=header(make, value.t_ns, value.frame_id),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=cov.reshape(36)),
    )


def body_velocity_from(msg: Any) -> BodyVelocity:
    """From geometry_msgs/TwistWithCovarianceStamped."""
    cov = _read_cov("twist.covariance", msg.twist.covariance, 6)[:3, :3]
    return BodyVelocity(stamp_ns(msg), _read_xyz("twist.linear", msg.twist.twist.linear), cov, msg.header.frame_id)


def point_to(make: Make, value: Point) -> Any:
    """geometry_msgs/PointStamped."""
    point = _xyz(make, "Point", value.position)
    return make("geometry_msgs/msg/PointStamped", header=header(make, value.t_ns, value.frame_id), point=point)


def point_from(msg: Any) -> Point:
    """From geometry_msgs/PointStamped."""
    return Point(stamp_ns(msg), _read_xyz("point", msg.point), msg.header.frame_id)


def pressure_to(make: Make, value: Pressure) -> Any:
    """sensor_msgs/FluidPressure."""
    return make(
        "sensor_msgs/msg/FluidPressure",
        header=header(make, value.t_ns, value.frame_id),
        fluid_pressure=float(value.pressure),
        variance=float(value.variance),
    )


def pressure_from(msg: Any) -> Pressure:
    """From sensor_msgs/FluidPressure."""
    pressure, variance = _finite("fluid_pressure and variance", np.array([msg.fluid_pressure, msg.variance]))
    return Pressure(stamp_ns(msg), float(pressure), float(variance), msg.header.frame_id)


def scalar_to(make: Make, value: Scalar) -> Any:
    """std_msgs/Float64."""
    return make("std_msgs/msg/Float64", data=float(value.value))


def scalar_from(msg: Any, t_ns: int) -> Scalar:
    """From std_msgs/Float64, with the instant at which it came (the message has no stamp)."""
    return Scalar(t_ns, float(_finite("data", np.array([msg.data]))[0]))


def record_to(make: Make, name: str, value: Any) -> Any:
    """sensor_msgs/PointCloud2 rows of the record `name` from a core type with one array (or number) per column."""
    columns = {column: np.atleast_1d(getattr(value, column)) for column, _ in record.layout(name).columns}
    rows = record.pack(name, columns)
    return make(
        "sensor_msgs/msg/PointCloud2",
        header=header(make, value.t_ns, value.frame_id),
        height=1,
        width=len(rows),
        fields=[make("sensor_msgs/msg/PointField", **field) for field in record.fields(rows)],
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=rows.nbytes,
        data=make.octets(rows.tobytes()),
        is_dense=True,
    )


def record_from(name: str, kind: type, msg: Any, single: bool = False) -> Any:
    """A core type from PointCloud2 rows; a `single` record has exactly one row and becomes numbers."""
    columns: dict[str, Any] = dict(record.unpack(name, msg))
    if single:
        if len(next(iter(columns.values()))) != 1:
            raise ValueError(f"{name}: must have 1 row, got {len(next(iter(columns.values())))}")
        columns = {column: float(values[0]) for column, values in columns.items()}
        _finite(name, np.array(list(columns.values())))
    return kind(t_ns=stamp_ns(msg), frame_id=msg.header.frame_id, **columns)
