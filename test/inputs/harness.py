"""Damages an input of a recorded bag as the world damages it, runs estimators on it, and scores what comes out.

A damage takes the messages of one topic in their order and returns what arrives in their place.
"""

from __future__ import annotations

import copy
import dataclasses
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import deserialize, serialize
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.evaluation.recording import load
from uw_acoustic_loc.evaluation.score import score
from uw_acoustic_loc.graph import Graph, load_graph
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.stages.runner import Refusal

HARBOUR = Path(__file__).parents[2] / "bags" / "harbour"
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Heard:
    """A message of a bag: when it was received, and what it says (rosbags' class)."""

    t_ns: int
    topic: str
    msgtype: str
    message: Any


Damage = Callable[[list[Heard]], Iterable[Heard]]


@dataclass(frozen=True)
class Outcome:
    """What a run gave."""

    score: dict[str, Any]
    refused: Counter[tuple[str, str]]  # node and topic
    sentences: dict[tuple[str, str], str]  # the first refusal of each
    statuses: dict[str, Status]
    counts: dict[str, Counter[tuple[str, str]]]  # of each node's runner
    out: list[tuple[str, int, bytes]]  # topic, log time and CDR of every output
    course: list[tuple[int, dict[str, Status]]]  # log time, and what diagnostics said then, every half second

    def said(self, node: str = "", begin: float = 0.0, end: float = 1e9) -> list[str]:
        """What diagnostics said of a node between two seconds of the run."""
        start = self.course[0][0]
        found = [
            status.message
            for t_ns, statuses in self.course
            for name, status in statuses.items()
            if begin <= (t_ns - start) * 1e-9 <= end and name.endswith(node)
        ]
        return list(dict.fromkeys(found))

    @property
    def restarts(self) -> int:
        return sum(counts["", "restarts"] for counts in self.counts.values())


def harbour() -> list[Heard]:
    """The harbour bag."""
    return heard(HARBOUR)


def heard(path: Path) -> list[Heard]:
    """A bag's messages, in their order."""
    return [Heard(r.t_ns, r.topic, r.msgtype, deserialize(r.data, r.msgtype)) for r in Bag(path).records()]


def graph(nodes: Sequence[str] = (), **params: dict[str, Any]) -> Graph:
    """The harbour graph, or its estimators of these names; `params` adds parameters by node."""
    whole = load_graph(resource("config/harbour/graph.yaml"))
    chosen = [
        dataclasses.replace(node, params={**node.params, **params.get(node.name, {})})
        for node in whole.nodes
        if not nodes or node.name in nodes
    ]
    return dataclasses.replace(whole, nodes=tuple(chosen))


def damaged(messages: Iterable[Heard], topic: str, damage: Damage) -> list[Heard]:
    """All messages with those of one topic damaged, in the order of their reception."""
    messages = list(messages)
    others = [message for message in messages if message.topic != topic]
    own = [message for message in messages if message.topic == topic]
    return sorted([*others, *damage(own)], key=lambda message: message.t_ns)


def run(messages: Iterable[Heard], wanted: Graph) -> Outcome:
    """Writes the messages into a bag, processes it, and scores the result against the bag's truth."""
    with tempfile.TemporaryDirectory() as folder:
        return _run(messages, wanted, Path(folder))


def _run(messages: Iterable[Heard], wanted: Graph, folder: Path) -> Outcome:
    write(messages, folder / "in")
    refused: Counter[tuple[str, str]] = Counter()
    sentences: dict[tuple[str, str], str] = {}

    def tell(node: str, refusal: Refusal) -> None:
        refused[node, refusal.topic] += 1
        sentences.setdefault((node, refusal.topic), refusal.sentence)

    offline = OfflineRun(Bag(folder / "in"), wanted, tell)
    runners, said = offline.pipeline.runners, []

    def look(t_ns: int) -> None:
        if not said or t_ns - said[-1][0] >= SECOND // 2:
            said.append((t_ns, {name: runner.status() for name, runner in runners.items()}))

    with mock.patch("uw_acoustic_loc.bag.process._BATCH", 4096):
        offline.run(folder / "out", keep_inputs=True, progress=look)
    own = offline.pipeline.outputs
    out = [(r.topic, r.t_ns, r.data) for r in Bag(folder / "out").records([*own])]
    statuses = {name: runner.status() for name, runner in runners.items()}
    counts = {name: runner.counts for name, runner in runners.items()}
    return Outcome(score(load(folder / "out")), refused, sentences, statuses, counts, out, said)


def write(messages: Iterable[Heard], path: Path) -> None:
    """A bag of the messages; latched are those of which the harbour bag has one."""
    latched = {name for name, topic in Bag(HARBOUR).topics.items() if topic.latched}
    with BagWriter(path) as writer:
        for m in messages:
            writer.add_topic(m.topic, m.msgtype, m.topic in latched)
            writer.write(m.topic, m.t_ns, serialize(m.message, m.msgtype))


# --- damages ------------------------------------------------------------------------------------------------------


def stamp(message: Any) -> int:
    """The header's stamp in ns."""
    return int(message.header.stamp.sec) * SECOND + int(message.header.stamp.nanosec)


def shifted(one: Heard, seconds: float) -> Heard:
    """The message with another stamp; its reception stays."""
    changed = copy.deepcopy(one)
    sec, nanosec = divmod(stamp(one.message) + round(seconds * SECOND), SECOND)
    object.__setattr__(changed.message.header, "stamp", type(one.message.header.stamp)(sec, nanosec))
    return changed


def shift_at(second: float, seconds: float, count: int = 1) -> Damage:
    """`count` messages from some second of the topic on have stamps that are off by `seconds`."""

    def damage(own: list[Heard]) -> list[Heard]:
        first = index_at(own, second)
        return [shifted(m, seconds) if first <= k < first + count else m for k, m in enumerate(own)]

    return damage


def shift_between(begin: float, end: float, seconds: float) -> Damage:
    """Stamps are off by `seconds` between two seconds of the topic."""

    def damage(own: list[Heard]) -> list[Heard]:
        start = own[0].t_ns
        inside = [begin <= (m.t_ns - start) * 1e-9 < end for m in own]
        return [shifted(m, seconds) if off else m for m, off in zip(own, inside, strict=True)]

    return damage


def silent(begin: float, seconds: float = 10.0) -> Damage:
    """Nothing comes for a while."""

    def damage(own: list[Heard]) -> list[Heard]:
        start = own[0].t_ns
        return [m for m in own if not begin <= (m.t_ns - start) * 1e-9 < begin + seconds]

    return damage


def dropped(fraction: float = 0.1, seed: int = 1) -> Damage:
    """A part of the messages is lost, one by one."""
    return lambda own: [
        m for m, u in zip(own, np.random.default_rng(seed).random(len(own)), strict=True) if u >= fraction
    ]


def lost(second: float) -> Damage:
    """One message does not come."""
    return lambda own: [m for k, m in enumerate(own) if k != index_at(own, second)]


def swapped(second: float) -> Damage:
    """Two messages change places."""

    def damage(own: list[Heard]) -> list[Heard]:
        k = min(index_at(own, second), len(own) - 2)
        if k < 0:
            return own
        a, b = own[k : k + 2]
        pair = [dataclasses.replace(b, t_ns=a.t_ns), dataclasses.replace(a, t_ns=b.t_ns)]
        return [*own[:k], *pair, *own[k + 2 :]]

    return damage


def duplicated(second: float) -> Damage:
    """One message comes twice."""

    def damage(own: list[Heard]) -> list[Heard]:
        k = index_at(own, second)
        return [*own[: k + 1], *own[k:]]

    return damage


def repeated(period: float = 1.0, duration: float = 20.0) -> Damage:
    """The topic's first message comes again and again, as latched topics do."""

    def damage(own: list[Heard]) -> list[Heard]:
        first, count = own[0], int(duration / period)
        more = [dataclasses.replace(first, t_ns=first.t_ns + round((k + 1) * period * SECOND)) for k in range(count)]
        return sorted([*own, *more], key=lambda m: m.t_ns)

    return damage


def changed(change: Callable[[Any], None], begin: float = 0.0, count: int | None = None) -> Damage:
    """`change` works on a copy of `count` messages (all) from some second of the topic on."""

    def damage(own: list[Heard]) -> list[Heard]:
        first = index_at(own, begin)
        last = len(own) if count is None else first + count
        return [_changed(m, change) if first <= k < last else m for k, m in enumerate(own)]

    return damage


def _changed(one: Heard, change: Callable[[Any], None]) -> Heard:
    one = copy.deepcopy(one)
    change(one.message)
    return one


def put(message: Any, path: str, value: Any) -> None:
    """Sets a field such as `twist.twist.linear.x`; rosbags' classes are frozen."""
    *holders, name = path.split(".")
    for holder in holders:
        message = getattr(message, holder)
    object.__setattr__(message, name, value)


def index_at(own: list[Heard], second: float) -> int:
    """The first message at or after some second of the topic."""
    start = own[0].t_ns if own else 0
    return next((k for k, m in enumerate(own) if (m.t_ns - start) * 1e-9 >= second), len(own) - 1)
