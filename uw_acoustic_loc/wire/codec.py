"""The table of core types: which ROS message each travels in, and the functions there and back."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

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
from .record import layout
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
            ValueError: the bytes are no such message, or its content is impossible.
        """
        value = self.cdr.unpack(data) if self.cdr else None
        return self.decode(deserialize(data, self.msgtype), received_ns) if value is None else value

    def to_cdr(self, value: Any, serialize: Callable[[Any, str], bytes], make: Make) -> bytes:
        """CDR bytes of a core value; `serialize(message, msgtype)` makes them where a message is needed."""
        return self.cdr.pack(value) if self.cdr else serialize(self.encode(make, value), self.msgtype)


def codec(kind: type) -> Codec:
    """The codec of a core type, or of another package's record: a dataclass with its layout file beside its module.

    Raises:
        ValueError: the type is neither.
    """
    return _CODECS.get(kind) or _foreign_record(kind)


@cache
def _foreign_record(kind: type) -> Codec:
    """The columns of <class>.msg are the fields beside t_ns and frame_id; of one row if they are declared float."""
    name = kind.__name__
    folder = Path(getattr(sys.modules[kind.__module__], "__file__", "")).parent
    if not (folder / f"{name}.msg").is_file():
        raise ValueError(f"{name} must be a type of core.types, or a record with its {name}.msg in {folder}")
    columns = [column for column, _ in layout(name, folder).columns]
    given = [field.name for field in dataclasses.fields(kind)]
    if set(given) != {"t_ns", "frame_id", *columns}:
        raise ValueError(f"{name} must have the fields t_ns, {', '.join(columns)}, frame_id, got {', '.join(given)}")
    hints = get_type_hints(kind)
    return _direct(RecordForm(name, kind, all(hints[column] is float for column in columns), folder))


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
