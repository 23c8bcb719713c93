"""rosbags' message classes behind the same `Make` that a node uses, and their CDR bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from ..core.types import AnyArray

STORE = get_typestore(Stores.ROS2_JAZZY)


class BagMake:
    """Builds rosbags messages (see wire.messages.Make)."""

    def __call__(self, msgtype: str, **fields: Any) -> Any:
        return STORE.types[msgtype](**fields)

    def octets(self, data: bytes) -> AnyArray:
        """The bytes as uint8 (N,)."""
        return np.frombuffer(data, dtype=np.uint8)


def serialize(msg: Any, msgtype: str) -> bytes:
    """CDR bytes of a message."""
    return bytes(STORE.serialize_cdr(msg, msgtype))


def deserialize(data: bytes, msgtype: str) -> Any:
    """The message in CDR bytes.

    Raises:
        ValueError: the bytes are not such a message.
    """
    try:
        return STORE.deserialize_cdr(data, msgtype)
    except Exception as error:  # rosbags' decoder fails with whatever the bytes lead it into
        raise ValueError(f"{msgtype}: {len(data)} bytes cannot be decoded ({error})") from None


def definition(msgtype: str) -> tuple[str, str]:
    """Definition text and RIHS01 hash of a message type; empty when the type is not one of ROS 2 Jazzy's."""
    if msgtype not in STORE.types:
        return "", ""
    return STORE.generate_msgdef(msgtype, ros_version=2)[0], STORE.hash_rihs01(msgtype)
