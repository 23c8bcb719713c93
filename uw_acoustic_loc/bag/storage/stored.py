"""What the files of a bag have in common: messages, topics, and the note of what could not be read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import yaml
import zstandard

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


class Record(NamedTuple):
    """A message of the bag, not decoded."""

    topic: str
    msgtype: str
    t_ns: int  # log time
    data: bytes


@dataclass(frozen=True)
class Topic:
    """A topic of the bag; `encoding` other than cdr means that its messages are not read."""

    name: str
    msgtype: str
    latched: bool
    encoding: str = "cdr"
    definition: str = ""  # the type's text, where the bag has it


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
        profiles = yaml.safe_load(qos) or []
        return any(profile.get("durability") in ("transient_local", 1) for profile in profiles)
    except (yaml.YAMLError, AttributeError, TypeError):
        return False


def unpacked(data: bytes) -> bytes:
    """Unpacks a message that rosbag2 compressed by itself (a CDR header never begins like one).

    Raises:
        ValueError: it cannot be decompressed.
    """
    if data[:4] != ZSTD_MAGIC:
        return data
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    except zstandard.ZstdError as error:
        raise ValueError(f"a compressed message cannot be unpacked ({error})") from None
