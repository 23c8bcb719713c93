"""rosbags' message classes behind the same `Make` that a node uses, and their CDR bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from ..core.types import AnyArray
from ..wire.codec import codec

STORE = get_typestore(Stores.ROS2_JAZZY)


class BagMake:
    """Builds rosbags messages (see wire.flat.Make)."""

    def __call__(self, msgtype: str, **fields: Any) -> Any:
        return STORE.types[msgtype](**fields)

    def uint8_array(self, data: bytes) -> AnyArray:
        """Returns the bytes as uint8 (N,)."""
        return np.frombuffer(data, dtype=np.uint8)


_MAKE = BagMake()


def encode(value: Any) -> bytes:
    """Returns the CDR bytes of a core value."""
    return codec(type(value)).to_cdr(value, serialize, _MAKE)


def decode(kind: type, data: bytes, t_ns: int) -> Any:
    """Reads a core value from CDR bytes that were received at t_ns.

    Raises:
        ValueError: the bytes are no such message, or its content is impossible.
    """
    return codec(kind).from_cdr(data, deserialize, t_ns)


def serialize(msg: Any, msgtype: str) -> bytes:
    """Returns the CDR bytes of a message."""
    return bytes(STORE.serialize_cdr(msg, msgtype))


def deserialize(data: bytes, msgtype: str) -> Any:
    """Reads the message in CDR bytes.

    Raises:
        ValueError: the bytes are not such a message.
    """
    try:
        return STORE.deserialize_cdr(data, msgtype)
    except Exception as error:  # damaged bytes make rosbags' decoder raise anything
        raise ValueError(f"{msgtype}: {len(data)} bytes cannot be decoded ({error})") from None
