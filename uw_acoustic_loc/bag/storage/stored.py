"""What the files of a bag have in common: messages, topics, and the note of what could not be read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from .compression import ZSTD_MAGIC, unpacked_zstd

_LARGEST_MESSAGE = 1 << 30  # bytes, of a message that was compressed by itself


@dataclass(frozen=True)
class Definition:
    """The text of a message type as it stands in a bag, its language (`ros2msg`, `ros2idl`) and its RIHS01 hash."""

    text: str = ""
    language: str = ""
    type_hash: str = ""


NO_DEFINITION = Definition()


class Record(NamedTuple):
    """A message of the bag, not decoded."""

    topic: str
    msgtype: str
    t_ns: int  # log time
    data: bytes
    definition: Definition = NO_DEFINITION
    encoding: str = "cdr"


@dataclass(frozen=True)
class Topic:
    """A topic of the bag; messages of an `encoding` other than cdr can be copied and hashed, but not decoded."""

    name: str
    msgtype: str
    latched: bool
    encoding: str = "cdr"
    definition: Definition = NO_DEFINITION
    qos: str = ""  # YAML, as the bag has it


class Damage:
    """What is wrong with one file; noting the same place again changes nothing."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._reasons: dict[str, str] = {}

    def note(self, place: str, reason: str) -> None:
        """Notes what is wrong at a place in the file, such as `byte 512`."""
        self._reasons.setdefault(place, reason)

    @property
    def sentences(self) -> list[str]:
        """A list of one sentence, or of none."""
        if not self._reasons:
            return []
        (place, reason), *more = self._reasons.items()
        others = f", and near {', '.join(other for other, _ in more[:3])}" if more else ""
        others += f" and {len(more) - 3} more" if len(more) > 3 else ""
        return [f"bag {self._file}: damaged near {place}: {reason}{others}; the rest is read"]


def full_type(name: str) -> str:
    """Completes `std_msgs/String`, as some writers have it, to `std_msgs/msg/String`."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name


@cache
def is_latched(qos: str) -> bool:
    """Returns whether QoS profiles in YAML are transient-local: by name in new bags, as 1 in old ones."""
    try:
        return any(profile.get("durability") in ("transient_local", 1) for profile in qos_profiles(qos) or [])
    except (AttributeError, TypeError):
        return False


def qos_profiles(qos: str) -> Any:
    """The profiles, or the text itself where it is no YAML."""
    try:
        return yaml.safe_load(qos)
    except (yaml.YAMLError, ValueError, RecursionError):  # dates of no calendar, numbers of thousands of digits
        return qos


def unpacked(data: bytes) -> bytes:
    """Unpacks a message that rosbag2 compressed by itself (a CDR header never begins like one).

    Raises:
        ValueError: it cannot be decompressed, or is larger than any message.
    """
    return unpacked_zstd(data, _LARGEST_MESSAGE) if data[:4] == ZSTD_MAGIC else data
