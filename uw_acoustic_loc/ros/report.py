"""What a node reports over `~/sync`: messages sent and taken, and which nodes each topic connects it with.

Delivery is judged by counting: all writers' `count` of a topic against what a reader has taken. It needs no help of the
middleware, and a loss has a name.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

REACHED_ALL_NS = 2**63 - 1  # of a node that follows no clock


@dataclass(frozen=True)
class Sent:
    """An output: messages published, and the nodes whose subscriptions it reaches, by full name."""

    count: int
    readers: tuple[str, ...] = ()


@dataclass(frozen=True)
class Taken:
    """An input: messages that the node's callback has had, and the nodes whose publishers it hears, by full name."""

    count: int
    writers: tuple[str, ...] = ()


@dataclass(frozen=True)
class NodeReport:
    """One node's state of delivery; topics by full name."""

    sent: Mapping[str, Sent] = field(default_factory=dict)
    taken: Mapping[str, Taken] = field(default_factory=dict)
    counts: Mapping[str, Mapping[str, int]] = field(default_factory=dict)  # an estimator's: own topic, what, how many
    recorded: Mapping[str, int] = field(default_factory=dict)  # a recorder's: messages in the bag
    reached_ns: int = REACHED_ALL_NS  # a driver's: it has published everything up to this instant of the clock
    played_s: float = 0.0  # a player's: time of the bag since its first message

    def to_json(self) -> str:
        """As text, for the answer of a service."""
        return json.dumps(vars(self), default=vars)

    @staticmethod
    def from_json(text: str) -> NodeReport:
        """The report that `to_json` wrote."""
        content = json.loads(text)
        content["sent"] = {t: Sent(s["count"], tuple(s["readers"])) for t, s in content["sent"].items()}
        content["taken"] = {t: Taken(s["count"], tuple(s["writers"])) for t, s in content["taken"].items()}
        return NodeReport(**content)


Reports = Mapping[str, NodeReport]  # by full node name
Missing = dict[tuple[str, str], int]  # messages by reader and topic


def unmatched(reports: Reports, also: Mapping[str, str] | None = None) -> list[str]:
    """Connections that are not made yet between the reporting nodes, and from other writers (`also`: by topic)."""
    writers = {(topic, name) for name, report in reports.items() for topic in report.sent} | set((also or {}).items())
    wrong = [
        f"{reader} does not hear {writer} on {topic}"
        for topic, writer in sorted(writers)
        for reader, report in reports.items()
        if topic in report.taken and writer not in report.taken[topic].writers
    ]
    return wrong + [
        f"{writer} does not reach {reader} on {topic}"
        for writer, report in reports.items()
        for topic, sent in report.sent.items()
        for reader in unreached(reports, topic, sent.readers)
    ]


def unreached(reports: Reports, topic: str, reached: tuple[str, ...]) -> list[str]:
    """The reporting nodes that subscribe to a topic and are not among those `reached`."""
    return [name for name, report in reports.items() if topic in report.taken and name not in reached]


def behind(reports: Reports, t_ns: int) -> list[str]:
    """Drivers that have not published everything up to an instant of the clock."""
    return [f"{name} is behind the clock" for name, report in reports.items() if report.reached_ns < t_ns]


def missing(reports: Reports, sent: Mapping[str, int]) -> Missing:
    """Messages that the reporting nodes have published (`sent` by topic) and each of them has not taken."""
    return {
        (name, topic): sent[topic] - taken.count
        for name, report in reports.items()
        for topic, taken in report.taken.items()
        if taken.count < sent.get(topic, 0)
    }


def published(reports: Reports) -> Counter[str]:
    """Messages by topic, of all reporting nodes together."""
    total: Counter[str] = Counter()
    for report in reports.values():
        total.update({topic: sent.count for topic, sent in report.sent.items()})
    return total


class Deliveries:
    """Compares what was published with what was taken; what has been given up is not waited for again."""

    def __init__(self) -> None:
        self._last: Missing = {}
        self._given_up: Missing = {}

    @property
    def lost(self) -> list[str]:
        """Sentences on what has been given up and has not come since."""
        return [f"{name} missed {count} on {topic}" for (name, topic), count in sorted(self._given_up.items())]

    def outstanding(self, reports: Reports, also: Mapping[str, int] | None = None) -> list[str]:
        """Inputs of the reporting nodes that lack messages which these, and others (`also`: by topic), published."""
        sent = published(reports)
        sent.update(also or {})
        self._last = missing(reports, sent)
        self._given_up = {
            (name, topic): left
            for (name, topic), count in self._given_up.items()
            if (left := min(count, self._last.get((name, topic), 0)) if name in reports else count)
        }
        return [
            f"{name} took {sent[topic] - count} of {sent[topic]} on {topic}"
            for (name, topic), count in self._last.items()
            if count > self._given_up.get((name, topic), 0)
        ]

    def give_up(self) -> None:
        """Takes what is outstanding now for lost."""
        self._given_up |= self._last
