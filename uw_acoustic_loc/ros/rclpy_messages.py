"""rclpy's message classes behind the same `Make` that the offline run uses, what goes over DDS, and QoS profiles."""

from __future__ import annotations

from array import array
from functools import cache
from importlib import import_module
from typing import Any

from rclpy.duration import Infinite
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock

from ..contract import Output
from ..wire.codec import codec
from ..wire.record import RECORD

# So many messages may a subscriber fall behind before it loses any: in its own queue while it is busy, and in the
# publisher's while its process is held up. 10 s of an IMU at 100 Hz, and of a record, which may be long, 100 messages.
_DEPTH, _RECORDS = 1000, 100


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

    def octets(self, data: bytes) -> array[int]:
        """An array of bytes: the only form that rclpy's setter takes without looking at every element."""
        octets = array("B")
        octets.frombytes(data)
        return octets


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


def publisher_qos(output: Output) -> QoSProfile:
    """Of an output."""
    return qos(output.latched, _RECORDS if codec(output.kind).msgtype == RECORD else _DEPTH)


def qos(latched: bool, depth: int = _DEPTH) -> QoSProfile:
    """Reliable; latched topics keep their last value for whoever comes later. Every policy is named, none left open."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1 if latched else depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        deadline=Infinite,
        lifespan=Infinite,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Infinite,
    )
