"""A hash per topic of a bag's messages, by which two runs are compared."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass

from .reader import Bag, Record
from .rosbags_messages import STORE, deserialize, serialize

# by the timers and clocks of a live run: how many there are is nobody's result
TIMER_DRIVEN = ("/clock", "/diagnostics", "/parameter_events", "/rosout")
_MODULUS = 1 << 256


@dataclass(frozen=True)
class Fingerprint:
    """How many messages a topic has, and a hash of them in 64 hexadecimal digits."""

    count: int
    digest: str


def fingerprints(bag: Bag, topics: Collection[str] | None = None) -> dict[str, Fingerprint]:
    """Returns the fingerprints of these topics, or of all, by name; the timer-driven ones are left out.

    The SHA-256 of the messages are added up, so that the bag may be of any size and the messages in any order: a stamp
    is part of its message. Messages without a header count with their place among those of the topic.
    """
    counts: dict[str, int] = {}
    sums: dict[str, int] = {}
    wanted = bag.topics if topics is None else topics
    for record in bag.records([topic for topic in wanted if topic not in TIMER_DRIVEN]):
        place = counts.get(record.topic, 0)
        digest = hashlib.sha256(_payload(record, place)).digest()
        counts[record.topic] = place + 1
        sums[record.topic] = (sums.get(record.topic, 0) + int.from_bytes(digest)) % _MODULUS
    return {topic: Fingerprint(counts[topic], f"{sums[topic]:064x}") for topic in sorted(counts)}


def overall(found: dict[str, Fingerprint]) -> str:
    """Returns one hash of all topics and their names."""
    lines = [f"{topic} {one.count} {one.digest}\n" for topic, one in sorted(found.items())]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _payload(record: Record, place: int) -> bytes:
    """Returns the CDR that rosbags writes: rclpy leaves leftovers of memory in the padding between fields."""
    if record.msgtype not in STORE.types:
        return record.data
    message = deserialize(record.data, record.msgtype)
    data = serialize(message, record.msgtype)
    return data if hasattr(message, "header") else place.to_bytes(8) + data
