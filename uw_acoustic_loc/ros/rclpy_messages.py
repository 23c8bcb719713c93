"""rclpy's message classes behind the same `Make` that the offline run uses, and what goes over DDS."""

from __future__ import annotations

from array import array
from functools import cache
from importlib import import_module
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock

from ..wire.codec import codec


@cache
def message_class(msgtype: str) -> Any:
    """The class of a type such as ``nav_msgs/msg/Odometry``.

    Raises:
        ValueError: the type is not installed.
    """
    package, kind, name = msgtype.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError):
        raise ValueError(f"message type {msgtype} is not installed") from None


def clock_message(t_ns: int) -> Clock:
    """An instant for /clock."""
    message = Clock()
    message.clock.sec, message.clock.nanosec = divmod(t_ns, 1_000_000_000)
    return message


class RosMake:
    """Builds rclpy messages (see wire.flat.Make)."""

    def __call__(self, msgtype: str, **fields: Any) -> Any:
        return message_class(msgtype)(**fields)

    def uint8_array(self, data: bytes) -> array[int]:
        """An array of bytes: the only form that rclpy's setter takes without looking at every element."""
        values = array("B")
        values.frombytes(data)
        return values


_MAKE = RosMake()


def to_dds(value: Any) -> bytes:
    """What a publisher takes: CDR, most of it made without a message object in half the processor time."""
    return codec(type(value)).to_cdr(value, lambda message, _msgtype: bytes(serialize_message(message)), _MAKE)


def from_dds(kind: type, data: bytes, received_ns: int) -> Any:
    """A core value from CDR bytes.

    Raises:
        ValueError: the message says what cannot be, or the bytes are no such message.
    """
    return codec(kind).from_cdr(data, _deserialized, received_ns)


def _deserialized(data: bytes, msgtype: str) -> Any:
    try:
        return deserialize_message(data, message_class(msgtype))
    except Exception as error:  # rclpy's, whichever it is: the bytes came from outside
        raise ValueError(f"{msgtype}: {len(data)} bytes cannot be decoded ({error})") from None
