"""Messages that are damaged as cables, clocks and careless nodes damage them."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from hypothesis import strategies as st

from uw_acoustic_loc.bag.rosbags_messages import BagMake

NUMBERS = [np.nan, np.inf, -np.inf, -1.0, 0.0, 1e-300, 1e300, -1e300, 1e9, -1e9, 1e5]
STAMPS = [(0, 0), (-5, 0), (1, 0), (2**31 - 1, 999_999_999), (0, 4_294_967_295)]  # s, ns
HARM = st.one_of(
    st.tuples(st.just("number"), st.floats(0, 1), st.sampled_from(NUMBERS)),
    st.tuples(st.just("stamp"), st.just(0.0), st.sampled_from([*STAMPS, "back", "ahead"])),
    st.tuples(st.just("frame"), st.just(0.0), st.sampled_from(["", "nonsense", "map", "base_link", "odom"])),
    st.tuples(st.just("bytes"), st.floats(0, 1), st.binary(min_size=1, max_size=12)),
    st.tuples(st.just("rows"), st.floats(0, 1), st.none()),
    st.tuples(st.just("length"), st.floats(0, 1), st.none()),
    st.tuples(st.just("layout"), st.floats(0, 1), st.integers(0, 255)),
    st.tuples(st.just("repeat"), st.just(0.0), st.none()),
    st.tuples(st.just("drop"), st.just(0.0), st.none()),
)


def harmed(message: Any, kind: str, where: float, value: Any) -> list[Any]:
    """The messages that take the place of `message` (rosbags' classes)."""
    if kind == "drop":
        return []
    if kind == "repeat":
        return [message, message]
    message = copy.deepcopy(message)
    {"number": _number, "stamp": _stamp, "frame": _frame}.get(kind, _cloud)(message, kind, where, value)
    return [message]


def _number(message: Any, _kind: str, where: float, value: float) -> None:
    """One floating-point number anywhere in the message, or in the rows of a PointCloud2."""
    if hasattr(message, "point_step"):
        _cloud(message, "bytes", where - where % 1e-9, np.float64(value).tobytes())
        return
    places = list(_floats(message))
    holder, name, index = places[min(int(where * len(places)), len(places) - 1)]
    if index is None:
        object.__setattr__(holder, name, float(value))
    else:
        getattr(holder, name)[index] = value


def _floats(message: Any) -> Any:
    for name, part in vars(message).items():
        if isinstance(part, float):
            yield message, name, None
        elif isinstance(part, np.ndarray) and part.dtype.kind == "f":
            object.__setattr__(message, name, part.copy())
            yield from ((message, name, index) for index in range(part.size))
        elif hasattr(part, "__dataclass_fields__"):
            yield from _floats(part)


def _stamp(message: Any, _kind: str, _where: float, value: Any) -> None:
    if hasattr(message, "header"):
        stamp = message.header.stamp
        shift = {"back": -100, "ahead": 3600}.get(value) if isinstance(value, str) else None
        seconds, nanoseconds = (stamp.sec + shift, stamp.nanosec) if shift else value
        object.__setattr__(message.header, "stamp", type(stamp)(seconds, nanoseconds))


def _frame(message: Any, _kind: str, _where: float, value: str) -> None:
    if hasattr(message, "header"):
        object.__setattr__(message.header, "frame_id", value)


def _cloud(message: Any, kind: str, where: float, value: Any) -> None:
    """A PointCloud2's rows and layout; whole rows begin where a number is set."""
    if not hasattr(message, "point_step"):
        return
    data = bytearray(message.data.tobytes())
    if kind == "bytes" and data:
        columns = [field.offset for field in message.fields]
        rows = max(int(message.width), 1)
        at = int(where * rows) % rows * message.point_step + columns[int(where * 997) % len(columns)]
        data[at : at + len(value)] = value[: len(data) - at]
    elif kind == "rows":
        object.__setattr__(message, "width", int(where * message.width))
        data = data[: message.width * message.point_step]
    elif kind == "length":
        data = data[: int(where * len(data))]
    elif kind == "layout" and message.fields:
        field = message.fields[int(where * len(message.fields)) % len(message.fields)]
        object.__setattr__(field, "datatype" if value % 2 else "offset", value)
    object.__setattr__(message, "data", BagMake().uint8_array(bytes(data)))
