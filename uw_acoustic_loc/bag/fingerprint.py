"""A hash per topic of a bag's messages, by which two runs are compared."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass

from .definitions import store_of
from .reader import Bag, Record

# by the timers and clocks of a live run: how many there are is nobody's result
TIMER_DRIVEN = ("/clock", "/diagnostics", "/parameter_events", "/rosout")
_MODULUS = 1 << 256


@dataclass(frozen=True)
class Fingerprint:
    """How many messages a topic has, and a hash of them in 64 hexadecimal digits.

    `raw` of them could not be decoded: their bytes count as they are, with what writers leave in the padding.
    """

    count: int
    digest: str
    raw: int = 0


def fingerprints(bag: Bag, topics: Collection[str] | None = None) -> dict[str, Fingerprint]:
    """Returns the fingerprints of these topics, or of all, by name; the timer-driven ones are left out.

    The SHA-256 of the messages are added up, so that the bag may be of any size and the messages in any order: a stamp
    is part of its message. Messages without a header count with their place among those of the topic.
    """
    counts: dict[str, int] = {}
    raw: dict[str, int] = {}
    sums: dict[str, int] = {}
    wanted = [*bag.topics, *bag.refused] if topics is None else topics
    for record in bag.records([topic for topic in wanted if topic not in TIMER_DRIVEN]):
        place = counts.get(record.topic, 0)
        payload = _payload(record, place)
        digest = hashlib.sha256(record.data if payload is None else payload).digest()
        counts[record.topic] = place + 1
        raw[record.topic] = raw.get(record.topic, 0) + (payload is None)
        sums[record.topic] = (sums.get(record.topic, 0) + int.from_bytes(digest)) % _MODULUS
    return {topic: Fingerprint(counts[topic], f"{sums[topic]:064x}", raw[topic]) for topic in sorted(counts)}


def overall(found: dict[str, Fingerprint]) -> str:
    """Returns one hash of all topics and their names."""
    lines = [f"{topic} {one.count} {one.digest}\n" for topic, one in sorted(found.items())]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _payload(record: Record, place: int) -> bytes | None:
    """CDR as rosbags writes it: rclpy leaves whatever was in memory in the padding between fields.

    None for a message that cannot be decoded.
    """
    store = store_of(record.msgtype, record.definition) if record.encoding == "cdr" else None
    if store is None:
        return None
    try:
        message = store.deserialize_cdr(record.data, record.msgtype)
        data = bytes(store.serialize_cdr(message, record.msgtype))
    except Exception:  # rosbags' decoder fails with whatever the bytes lead it into
        return None
    return data if hasattr(message, "header") else place.to_bytes(8) + data
