"""Messages of a header, names and float64: one row of numbers stands for them, in a message object or in CDR.

`make` builds a message of a named type from its fields: rclpy's classes in a node, rosbags' offline. Reading goes by
attribute, so that both kinds of message are read by the same code.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..core.types import Array


class Make(Protocol):
    """Builds messages; `uint8_array` turns bytes into what a uint8[] field takes fastest."""

    def __call__(self, msgtype: str, **fields: Any) -> Any: ...

    def uint8_array(self, data: bytes) -> Any: ...


class Flat(NamedTuple):
    """The content of a message."""

    t_ns: int
    names: tuple[str, ...]  # header.frame_id, and those that follow
    values: Array  # (n,) in the message's order


@dataclass(frozen=True)
class Part:
    """A message type and its fields: a number (1), an array (its size), or a message."""

    msgtype: str
    fields: dict[str, Part | int]

    def size(self) -> int:
        """How many numbers it has."""
        return sum(field if isinstance(field, int) else field.size() for field in self.fields.values())


@dataclass(frozen=True)
class FlatForm:
    """A stamped message type, and how a core value becomes its numbers and comes back."""

    body: Part
    flatten: Callable[[Any], Flat]
    restore: Callable[[Flat], Any]
    names: tuple[str, ...] = ()  # fields between header and numbers

    @property
    def msgtype(self) -> str:
        return self.body.msgtype

    @cached_property
    def size(self) -> int:
        """How many numbers the message has."""
        return self.body.size()

    def encode(self, make: Make, value: Any) -> Any:
        """Builds the message of a core value."""
        flat = self.flatten(value)
        names = dict(zip(self.names, flat.names[1:], strict=True))
        fields = _fields(make, self.body, flat.values)
        return make(self.msgtype, header=header(make, flat.t_ns, flat.names[0]), **names, **fields)

    def decode(self, msg: Any, _received_ns: int = 0) -> Any:
        """Returns the core value of a message."""
        names = (msg.header.frame_id, *(getattr(msg, name) for name in self.names))
        return self.restore(Flat(stamp_ns(msg), names, np.array([*_numbers(self.body, msg)])))

    def pack(self, value: Any) -> bytes:
        """Returns the CDR bytes of a core value."""
        flat = self.flatten(value)
        return STAMP.pack(LITTLE_ENDIAN, *divmod(flat.t_ns, SECOND)) + _packed(flat.names) + flat.values.tobytes()

    def unpack(self, data: bytes) -> Any:
        """Reads CDR bytes; returns None when their layout is another one, which a general decoder must read."""
        try:
            flat = self._unpacked(data)
        except (struct.error, UnicodeDecodeError):
            return None
        return None if flat is None else self.restore(flat)

    def _unpacked(self, data: bytes) -> Flat | None:
        kind, sec, nanosec = STAMP.unpack_from(data)
        begin = len(data) - 8 * self.size
        names = _names_in(data[STAMP.size : begin], 1 + len(self.names)) if begin > STAMP.size else None
        if kind != LITTLE_ENDIAN or names is None:
            return None
        values = np.frombuffer(data, _FLOAT64, self.size, begin).copy()  # a copy is aligned
        return Flat(checked_stamp(sec, nanosec), names, values)


def header(make: Make, t_ns: int, frame_id: str) -> Any:
    """Builds a std_msgs/Header."""
    sec, nanosec = divmod(t_ns, SECOND)
    stamp = make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def stamp_ns(msg: Any) -> int:
    """Returns the header's stamp in ns; ValueError for zero, which means that nobody set it."""
    return checked_stamp(int(msg.header.stamp.sec), int(msg.header.stamp.nanosec))


def checked_stamp(sec: int, nanosec: int) -> int:
    """Returns the stamp in ns; ValueError unless it is set, and its nanoseconds are less than a second."""
    if not 0 <= nanosec < SECOND:
        raise ValueError(f"header.stamp.nanosec must be below {SECOND}, got {nanosec}")
    t_ns = sec * SECOND + nanosec
    if t_ns <= 0:
        raise ValueError(f"header.stamp must be set, got {t_ns} ns")
    return t_ns


def _fields(make: Make, part: Part, values: Array) -> dict[str, Any]:
    made, at = {}, 0
    for name, field in part.fields.items():
        size = field if isinstance(field, int) else field.size()
        own = values[at : at + size]
        if isinstance(field, Part):
            made[name] = make(field.msgtype, **_fields(make, field, own))
        else:
            made[name] = own if size > 1 else float(own[0])
        at += size
    return made


def _numbers(part: Part, msg: Any) -> Iterator[float]:
    for name, field in part.fields.items():
        value = getattr(msg, name)
        if isinstance(field, Part):
            yield from _numbers(field, value)
        elif field > 1:
            yield from value.tolist()
        else:
            yield value


@lru_cache(maxsize=256)
def _packed(names: tuple[str, ...]) -> bytes:
    """Returns strings as they follow a stamp in CDR, up to the first number."""
    data = b"".join(map(aligned_string, names))
    return data + bytes(-len(data) % 8)


def aligned_string(text: str) -> bytes:
    """Returns a string in CDR, up to where the next string or 32 bit number begins."""
    data = text.encode() + b"\0"
    return LENGTH.pack(len(data)) + data + bytes(-len(data) % 4)


@lru_cache(maxsize=256)
def _names_in(packed: bytes, count: int) -> tuple[str, ...] | None:
    """Returns the strings between a stamp and the first number; None when there is something else."""
    at, names = 0, []
    for _ in range(count):
        at += -at % 4
        (length,) = LENGTH.unpack_from(packed, at)
        at += LENGTH.size + length
        text = packed[at - length : at]
        if not text.endswith(b"\0"):
            return None
        names.append(text[:-1].decode())
    return tuple(names) if len(packed) == at + -at % 8 else None


SECOND = 1_000_000_000
_FLOAT64 = np.dtype("<f8")
LITTLE_ENDIAN = b"\0\1\0\0"  # the encapsulation; alignment counts from its end
STAMP = struct.Struct("<4siI")
LENGTH = struct.Struct("<I")
