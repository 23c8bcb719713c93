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

    def from_cdr(self, data: bytes, deserialize: Callable[[bytes, str], Any], received_ns: int) -> Any:
        """A core value from CDR bytes; `deserialize(data, msgtype)` makes the message where one is needed.

        Raises:
            ValueError: the bytes are no such message, or it says what cannot be.
        """
        value = self.cdr.unpack(data) if self.cdr else None
        return self.decode(deserialize(data, self.msgtype), received_ns) if value is None else value

    def to_cdr(self, value: Any, serialize: Callable[[Any, str], bytes], make: Make) -> bytes:
        """CDR bytes of a core value; `serialize(message, msgtype)` makes them where a message is needed."""
        return self.cdr.pack(value) if self.cdr else serialize(self.encode(make, value), self.msgtype)


def codec(kind: type) -> Codec:
    """The codec of a core type."""
    return _CODECS[kind]


def _direct(form: FlatForm | RecordForm) -> Codec:
    return Codec(form.msgtype, form.encode, form.decode, form)


_CODECS: dict[type, Codec] = {
    Odometry: _direct(m.ODOMETRY),
    Bearing: _direct(m.BEARING),
    Position: _direct(m.POSITION),
    Imu: _direct(m.IMU),
    BodyVelocity: _direct(m.BODY_VELOCITY),
    Point: _direct(m.POINT),
    Pressure: _direct(m.PRESSURE),
    Scalar: Codec("std_msgs/msg/Float64", m.scalar_to, m.scalar_from),
    HydrophoneInfo: _direct(RecordForm("HydrophoneInfo", HydrophoneInfo, single=True)),
    Samples: _direct(RecordForm("HydrophoneSample", Samples)),
    Particles: _direct(RecordForm("Particle", Particles)),
    NodePositions: _direct(RecordForm("NodePosition", NodePositions)),
    Arrivals: _direct(RecordForm("Arrival", Arrivals)),
    ArrivalPaths: _direct(RecordForm("ArrivalPath", ArrivalPaths)),
    Detections: _direct(RecordForm("BistaticDetection", Detections)),
    Tracks: _direct(RecordForm("Track", Tracks)),
}
