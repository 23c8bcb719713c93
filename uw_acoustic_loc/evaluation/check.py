"""Compares a bag with a file of expected values, for tests of nodes in continuous integration."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..bag.definitions import deserialized
from ..bag.fingerprint import TIMER_DRIVEN, fingerprints
from ..bag.reader import Bag, Definition
from ..bag.survey import TopicSurvey, survey
from ..config import build, param
from ..core.types import Array
from ..yaml_file import load_yaml
from .message_field import numbers
from .recording import load
from .score import score


@dataclass(frozen=True)
class ExpectedField:
    """The range of every number of a field in every message; `rows.<column>` is a column of a PointCloud2."""

    field: str = param(doc="such as pose.pose.position.x or pose.covariance[35]")
    range: tuple[float, ...] = param(length=2)

    def __post_init__(self) -> None:
        _ordered("range", self.range, required=True)


@dataclass(frozen=True)
class ExpectedTopic:
    """What a topic must have; what is left out is not checked. Ranges are [lowest, highest], both included."""

    name: str = param()
    type: str = param("")
    count: tuple[int, ...] = param((), low=0, length=2)
    rate: tuple[float, ...] = param((), unit="Hz", low=0, length=2)
    longest_gap: float = param(0.0, unit="s", low=0, doc="between two messages; 0 = any")
    stamps_back: bool = param(True, doc="whether stamps may go back")
    sha256: str = param("", doc="of all messages, as uwloc hash prints it")
    values: tuple[ExpectedField, ...] = param(())

    def __post_init__(self) -> None:
        _ordered("count", self.count)
        _ordered("rate", self.rate)
        if self.sha256 and not re.fullmatch("[0-9a-f]{64}", self.sha256):
            raise ValueError(f"sha256 must be 64 hexadecimal digits as uwloc hash prints them, got '{self.sha256}'")
        if self.sha256 and self.name in TIMER_DRIVEN:
            raise ValueError(f"sha256 of {self.name} cannot be expected: uwloc hash leaves out what timers make")


@dataclass(frozen=True)
class ExpectedScore:
    """The range of a number of `uwloc score --json`, such as bearing.a.rmse_deg."""

    name: str = param()
    range: tuple[float, ...] = param(length=2)

    def __post_init__(self) -> None:
        _ordered("range", self.range, required=True)


@dataclass(frozen=True)
class Expected:
    """The file's content."""

    topics: tuple[ExpectedTopic, ...] = param(())
    scores: tuple[ExpectedScore, ...] = param(())
    damage: bool = param(False, doc="whether the bag may be damaged")


@dataclass(frozen=True)
class Check:
    """One line of the table."""

    what: str
    expected: str
    found: str
    passed: bool

    @property
    def sentence(self) -> str:
        """The violation in words."""
        return f"{self.what} must be {self.expected}, got {self.found}"


def load_expected(path: Path) -> Expected:
    """Reads the file; ValueError with one sentence for anything wrong in it."""
    expected = build(Expected, load_yaml(path, "expectation") or {}, f"expectation {path}")
    if not expected.topics and not expected.scores:
        raise ValueError(f"expectation {path} must have topics or scores, it has none")
    return expected


def checked(path: Path, expected: Expected, definitions: Mapping[str, Definition] | None = None) -> Iterator[Check]:
    """Yields all checks, in the order of the file; `definitions` as for a bag."""
    bag = Bag(path, definitions)
    found = survey(bag)
    for wanted in expected.topics:
        topic = found.topics.get(wanted.name)
        if topic is None:
            yield Check(wanted.name, "in the bag", "nothing of that name", False)
            continue
        yield from _of_topic(wanted, topic)
        if wanted.sha256:
            yield _of_hash(bag, wanted)
        for one in wanted.values:
            yield _of_field(bag, wanted.name, one)
    if expected.scores:
        scored = score(load(path, definitions))
        yield from (_in_range(f"score {one.name}", one.range, _lookup(scored, one.name)) for one in expected.scores)
    if not expected.damage:
        yield Check("damage", "none", "; ".join(bag.damage) or "none", not bag.damage)


def _ordered(name: str, given: tuple[float, ...], required: bool = False) -> None:
    if (required and not given) or (given and given[0] > given[1]):
        raise ValueError(f"{name} must be [lowest, highest], got {list(given)}")


def _of_topic(wanted: ExpectedTopic, topic: TopicSurvey) -> Iterator[Check]:
    name = wanted.name
    if wanted.type:
        yield Check(f"{name} type", wanted.type, topic.msgtype, topic.msgtype == wanted.type)
    if wanted.count:
        yield _in_range(f"{name} count", wanted.count, topic.count)
    if wanted.rate:
        yield _in_range(f"{name} rate in Hz", wanted.rate, topic.rate_hz)
    if wanted.longest_gap:
        yield _in_range(f"{name} longest interval in s", (0.0, wanted.longest_gap), topic.longest_interval_s)
    if not wanted.stamps_back:
        yield _in_range(f"{name} stamps that go back", (0, 0), topic.stamps_back)


def _of_hash(bag: Bag, wanted: ExpectedTopic) -> Check:
    hashed = fingerprints(bag, [wanted.name]).get(wanted.name)
    digest = hashed.digest if hashed else "no message"
    return Check(f"{wanted.name} sha256", wanted.sha256, digest, digest == wanted.sha256)


def _of_field(bag: Bag, topic: str, wanted: ExpectedField) -> Check:
    low, high = wanted.range
    what, allowed = f"{topic} {wanted.field}", f"from {low:g} to {high:g}"
    try:
        values = _values(bag, topic, wanted.field)
    except ValueError as error:
        return Check(what, allowed, str(error), False)
    if not values.size:
        return Check(what, allowed, "no number at all", False)
    good = bool(np.all((values >= low) & (values <= high)))  # NaN is never
    return Check(what, allowed, f"from {values.min():g} to {values.max():g}", good)


def _values(bag: Bag, topic: str, field: str) -> Array:
    records = bag.records([topic])
    found = [numbers(deserialized(record), field) for record in records]
    return np.concatenate(found) if found else np.array([])


def _in_range(what: str, allowed: tuple[float, ...], value: float | None) -> Check:
    low, high = allowed
    words = f"{low:g}" if low == high else f"from {low:g} to {high:g}"
    if value is None:
        return Check(what, words, "nothing of that name", False)
    return Check(what, words, f"{value:.6g}", low <= value <= high)


def _lookup(scored: dict[str, Any], name: str) -> float | None:
    """Returns the number under a dotted name; keys may have dots or slashes of their own."""
    for key, part in scored.items():
        if key == name:
            return float(part) if isinstance(part, int | float) else None
        if name.startswith(f"{key}.") and isinstance(part, dict):
            return _lookup(part, name[len(key) + 1 :])
    return None
