"""A bag as series of core values; a topic's role follows from its name, in any namespace."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..bag.definitions import decoded
from ..bag.reader import Bag, Definition, Record
from ..core.types import AnyArray, Scalar
from ..topics import TOPICS, KnownTopic, Place, find
from ..wire.codec import codec


@dataclass(frozen=True, eq=False)
class Series:
    """The messages of one topic, in stamp order."""

    topic: str
    role: str  # what the topic is, see uw_acoustic_loc.topics
    space: str  # its namespace, "" = root
    id: str  # of the source, mooring or true vehicle; "" where there is one only
    values: list[Any]
    log_ns: AnyArray  # (n,) int64, when each was recorded

    @property
    def t_ns(self) -> AnyArray:
        """(n,) int64 stamps; log times where the message has no header."""
        return np.array([value.t_ns for value in self.values], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Traffic:
    """What came over a topic, known or not."""

    msgtype: str
    log_ns: AnyArray  # (n,) int64


@dataclass(frozen=True, eq=False)
class Recording:
    """Everything that score and report need of a bag."""

    name: str
    traffic: Mapping[str, Traffic]  # by topic
    series: tuple[Series, ...] = ()  # with at least one message each, in the order of their topics
    refused: Mapping[str, str] = field(default_factory=dict)  # by topic: how many could not be read, and why the first
    damage: tuple[str, ...] = ()  # where reading stopped

    @property
    def span(self) -> tuple[int, int]:
        """Log times of the first and the last message in ns."""
        times = [traffic.log_ns for traffic in self.traffic.values() if traffic.log_ns.size]
        return (int(min(t[0] for t in times)), int(max(t[-1] for t in times))) if times else (0, 0)

    @property
    def spaces(self) -> list[str]:
        """The namespaces of vehicles' estimators."""
        return sorted({series.space for series in self.series if series.role in VEHICLE_ROLES})

    def all(self, role: str, space: str | None = None) -> Iterator[Series]:
        """Yields the series of a role (in one namespace only, when given)."""
        return (s for s in self.series if s.role == role and space in (None, s.space))

    def one(self, role: str, space: str | None = None, name: str | None = None) -> Series | None:
        """Returns the first series of a role (and namespace, and id)."""
        return next((s for s in self.all(role, space) if name in (None, s.id)), None)

    def source(self, name: str) -> Series | None:
        """Returns the true position of a source."""
        return self.one("true_source", name=name)

    def label(self, space: str, name: str) -> str:
        """Returns a name in the score: `name` itself for the first vehicle, `vehicle/name` for the others."""
        first = not self.spaces or space == self.spaces[0]
        return name if first else f"{space.strip('/')}/{name}"


def load(path: Path, definitions: Mapping[str, Definition] | None = None) -> Recording:
    """Reads a bag; messages that cannot be read are counted, a damaged bag is read as far as it goes.

    `definitions` stand in where the bag has none of a type.

    Raises:
        ValueError: there is no bag at `path`.
    """
    bag = Bag(path, definitions)
    readers = {name: reader for name, topic in bag.topics.items() if (reader := _reader(name, topic.msgtype))}
    times: dict[str, list[int]] = {name: [] for name in bag.topics}
    for record in bag.records():
        times.setdefault(record.topic, []).append(record.t_ns)
        if reader := readers.get(record.topic):
            reader.read(record)
    traffic = {
        name: Traffic(topic.msgtype, np.array(times[name], dtype=np.int64)) for name, topic in bag.topics.items()
    }
    filled = sorted((reader for reader in readers.values() if reader.pairs), key=lambda reader: reader.topic)
    series = tuple(reader.series() for reader in filled)
    refused = {
        name: f"{reader.refused} not read: {reader.sentence}" for name, reader in readers.items() if reader.refused
    }
    return Recording(path.resolve().name, traffic, series, refused, tuple(bag.damage))


class _Reader:
    """Decodes the messages of one topic."""

    def __init__(self, topic: str, row: KnownTopic, place: Place) -> None:
        self.topic, self._row, self._place = topic, row, place
        self.pairs: list[tuple[Any, int]] = []  # value, log time
        self.refused, self.sentence = 0, ""

    def read(self, record: Record) -> None:
        try:
            value = decoded(self._row.kind, record)
        except ValueError as error:
            self.refused += 1
            self.sentence = self.sentence or str(error)
            return
        self.pairs.append((value, record.t_ns))

    def series(self) -> Series:
        self.pairs.sort(key=lambda pair: int(pair[0].t_ns))
        log_ns = np.array([t_ns for _, t_ns in self.pairs], dtype=np.int64)
        values = [value for value, _ in self.pairs]
        return Series(self.topic, self._row.role, self._place.space, self._place.id, values, log_ns)


def _reader(topic: str, msgtype: str) -> _Reader | None:
    """None for a topic that has no role in scoring, or that only has the name of one."""
    row, place = find(topic) or (None, None)
    if row is None or place is None or not row.role or codec(row.kind).msgtype != msgtype:
        return None
    return _Reader(topic, row, place)


VEHICLE_ROLES = [row.role for row in TOPICS if row.role and row.estimate_in == "vehicle"]
# with a header, so that latency is known
ESTIMATOR_ROLES = [row.role for row in TOPICS if row.role and row.estimate_in and row.kind is not Scalar]
