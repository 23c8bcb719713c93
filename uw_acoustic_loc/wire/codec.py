"""The table of core types: which ROS message each travels in, and the functions there and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
from .flat import FlatForm, Make
from .record_form import RecordForm


@dataclass(frozen=True)
class Codec:
    """`encode(make, value) -> message`, `decode(message, received_ns) -> value`; `cdr` if it needs no object."""

    msgtype: str
    encode: Callable[[Make, Any], Any]
    decode: Callable[[Any, int], Any]
    cdr: FlatForm | RecordForm | None = None


def codec(kind: type) -> Codec:
    """The codec of a core type."""
    return _CODECS[kind]


def _flat(form: FlatForm) -> Codec:
    return Codec(form.body.msgtype, form.encode, form.decode, form)


def _record(kind: type, name: str, single: bool = False) -> Codec:
    form = RecordForm(name, kind, single)
    return Codec(RECORD, form.encode, form.decode, form)


RECORD = "sensor_msgs/msg/PointCloud2"
_CODECS: dict[type, Codec] = {
    Odometry: _flat(m.ODOMETRY),
    Bearing: _flat(m.BEARING),
    Position: _flat(m.POSITION),
    Imu: _flat(m.IMU),
    BodyVelocity: _flat(m.BODY_VELOCITY),
    Point: _flat(m.POINT),
    Pressure: _flat(m.PRESSURE),
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
