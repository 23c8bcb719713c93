"""The table of core types: which ROS message each travels in, and the functions there and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from ..core.types import (
    ArrivalPaths,
    Arrivals,
    Bearing,
    BodyVelocity,
    Detections,
    HydrophoneInfo,
    Imu,
    NodePositions,
    Odometry,
    Particles,
    Point,
    Position,
    Pressure,
    Samples,
    Scalar,
    Tracks,
)
from . import messages as m


@dataclass(frozen=True)
class Codec:
    """`encode(make, value) -> message`, `decode(message, received_ns) -> value`."""

    msgtype: str
    encode: Callable[[m.Make, Any], Any]
    decode: Callable[[Any, int], Any]


def codec(kind: type) -> Codec:
    """The codec of a core type."""
    return _CODECS[kind]


def _stamped(msgtype: str, encode: Callable[[m.Make, Any], Any], decode: Callable[[Any], Any]) -> Codec:
    return Codec(msgtype, encode, lambda msg, _received_ns: decode(msg))


def _record(kind: type, name: str, single: bool = False) -> Codec:
    def encode(make: m.Make, value: Any) -> Any:
        return m.record_to(make, name, value)

    return _stamped("sensor_msgs/msg/PointCloud2", encode, partial(m.record_from, name, kind, single=single))


_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"

_CODECS: dict[type, Codec] = {
    Odometry: _stamped("nav_msgs/msg/Odometry", m.odometry_to, m.odometry_from),
    Bearing: _stamped(_POSE, m.bearing_to, m.bearing_from),
    Position: _stamped(_POSE, m.position_to, m.position_from),
    Imu: _stamped("sensor_msgs/msg/Imu", m.imu_to, m.imu_from),
    BodyVelocity: _stamped("geometry_msgs/msg/TwistWithCovarianceStamped", m.body_velocity_to, m.body_velocity_from),
    Point: _stamped("geometry_msgs/msg/PointStamped", m.point_to, m.point_from),
    Pressure: _stamped("sensor_msgs/msg/FluidPressure", m.pressure_to, m.pressure_from),
    Scalar: Codec("std_msgs/msg/Float64", m.scalar_to, m.scalar_from),
    HydrophoneInfo: _record(HydrophoneInfo, "HydrophoneInfo", single=True),
    Samples: _record(Samples, "HydrophoneSample"),
    Particles: _record(Particles, "Particle"),
    NodePositions: _record(NodePositions, "NodePosition"),
    Arrivals: _record(Arrivals, "Arrival"),
    ArrivalPaths: _record(ArrivalPaths, "ArrivalPath"),
    Detections: _record(Detections, "BistaticDetection"),
    Tracks: _record(Tracks, "Track"),
}
