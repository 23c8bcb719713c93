"""What is in a bag, topic by topic: counts, rates, gaps, and clocks that were set back."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .definitions import store_of
from .reader import Bag, Record, Topic

_GAP = 5.0  # median intervals between two messages make a gap
_FEW = 5  # intervals, below which a median means nothing


@dataclass(frozen=True)
class TopicSurvey:
    """One topic. Times are log times, when each message was recorded; a stamp is that of its header."""

    msgtype: str
    latched: bool
    count: int
    first_ns: int
    last_ns: int
    rate_hz: float  # 0 = fewer than two messages
    gaps: int  # intervals of more than five usual ones
    longest_gap_s: float
    longest_interval_s: float
    clock_back: int  # log times that lie before the one before them
    stamps_back: int
    largest_step_back_s: float  # of both
    unset_stamps: int
    unset_log_times: int  # messages that were recorded at no time; they count in nothing but `count`
    other_types: tuple[str, ...]  # that messages of this topic have, too

    def as_json(self) -> dict[str, Any]:
        """Returns the fields as a dictionary, the message type as `type`."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {"type": values.pop("msgtype"), **values}


@dataclass
class _Traffic:
    """What is noted while reading."""

    topic: Topic
    has_header: bool
    log_ns: list[int] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    first: Record | None = None

    def note(self, record: Record) -> None:
        self.first = self.first or record
        self.log_ns.append(record.t_ns)
        if self.has_header and record.msgtype == self.topic.msgtype and (stamp := _stamp_ns(record.data)) is not None:
            self.stamps_ns.append(stamp)


@dataclass(frozen=True)
class Survey:
    """All topics by name, and the first message of each that has one."""

    topics: dict[str, TopicSurvey]
    first: dict[str, Record]

    @property
    def span(self) -> tuple[int, int]:
        """The first and the last log time in ns; zeros for an empty bag."""
        filled = [topic for topic in self.topics.values() if topic.last_ns]
        return (min(t.first_ns for t in filled), max(t.last_ns for t in filled)) if filled else (0, 0)


def survey(bag: Bag) -> Survey:
    """Reads the whole bag as it was recorded; what cannot be read is in `bag.damage` afterwards."""
    traffic = {name: _Traffic(topic, _has_header(topic)) for name, topic in bag.topics.items()}
    for record in bag.records(by_time=False):
        traffic[record.topic].note(record)
    first = {name: noted.first for name, noted in traffic.items() if noted.first}
    return Survey({name: _summary(noted, bag.types[name]) for name, noted in sorted(traffic.items())}, first)


def _summary(noted: _Traffic, types: list[str]) -> TopicSurvey:
    log = np.array([t_ns for t_ns in noted.log_ns if t_ns > 0], dtype=np.int64)
    stamps = np.array([stamp for stamp in noted.stamps_ns if stamp > 0], dtype=np.int64)
    steps = np.sort(log)
    intervals = np.diff(steps) * 1e-9
    gaps = _gaps(intervals)
    back = [np.diff(times)[np.diff(times) < 0] * -1e-9 for times in (log, stamps)]
    span = float(steps[-1] - steps[0]) * 1e-9 if log.size else 0.0
    return TopicSurvey(
        msgtype=noted.topic.msgtype,
        latched=noted.topic.latched,
        count=len(noted.log_ns),
        first_ns=int(steps[0]) if log.size else 0,
        last_ns=int(steps[-1]) if log.size else 0,
        rate_hz=(log.size - 1) / span if span > 0 else 0.0,
        gaps=len(gaps),
        longest_gap_s=max(gaps, default=0.0),
        longest_interval_s=float(intervals.max(initial=0.0)),
        clock_back=back[0].size,
        stamps_back=back[1].size,
        largest_step_back_s=float(max((steps.max() for steps in back if steps.size), default=0.0)),
        unset_stamps=sum(stamp <= 0 for stamp in noted.stamps_ns),
        unset_log_times=len(noted.log_ns) - log.size,
        other_types=tuple(one for one in types if one != noted.topic.msgtype),
    )


def _gaps(intervals: np.ndarray[Any, Any]) -> list[float]:
    """Returns the intervals in s that are much longer than usual."""
    usual = float(np.median(intervals)) if intervals.size >= _FEW else 0.0
    return intervals[intervals > _GAP * usual].tolist() if usual > 0 else []


def _has_header(topic: Topic) -> bool:
    """Whether messages begin with std_msgs/Header, by the definition that they are read by."""
    store = store_of(topic.msgtype, topic.definition)
    fields: Any = store.fielddefs[topic.msgtype][1] if store else ()
    return bool(fields) and fields[0][1][1] == "std_msgs/msg/Header"


def _stamp_ns(data: bytes) -> int | None:
    """Returns the stamp in ns of a header that comes first in CDR bytes."""
    if len(data) < 12:
        return None
    seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
