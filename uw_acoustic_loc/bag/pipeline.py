"""The stages of a graph, chained without DDS: what one publishes is pushed into those that subscribe to it.

Messages come in batches, and each stage takes all of its own at once: its code and data then stay in the processor's
caches. It takes them in the order of the batch, what another stage published in the place of what made it do so, which
is the order of handing over one message at a time. Where stages feed each other in a loop, none may run ahead, and each
message is a batch.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import partial
from operator import itemgetter
from typing import Any

from ..contract import Emission, Output
from ..graph import Graph
from ..resolved_graph import ResolvedStage, resolve_stage, upstream_first
from ..stages.catalog import is_stage, stage_names
from ..stages.runner import Refusal, Runner
from .rosbags_messages import decode, encode

Publish = Callable[[int, str, bytes], None]  # log time, full topic name, CDR
Message = tuple[int, str, Any]  # log time, topic, core value
_Place = tuple[int, int]  # in the batch, and log time


class _Member:
    """An estimator, with the full names of its outputs, and what has come for it."""

    def __init__(self, stage: ResolvedStage, report: Callable[[str, Refusal], None]) -> None:
        self.name = name = stage.node.full_name
        self.runner = Runner(stage.make_stage, stage.lateness, partial(report, name), stage.input_configs)
        self.names = {output.topic: topic for topic, output in stage.outputs.items()}
        self.inbox: list[tuple[_Place, str, Any]] = []

    def emptied(self) -> list[tuple[_Place, str, Any]]:
        """What has come, in its order."""
        inbox, self.inbox = sorted(self.inbox, key=itemgetter(0)), []
        return inbox


class Pipeline:
    """All estimators of `graph`; `publish` takes what they say, `report` a node's name and each message it refused."""

    def __init__(self, graph: Graph, publish: Publish, report: Callable[[str, Refusal], None]) -> None:
        stages = upstream_first([resolve_stage(node) for node in graph.nodes if is_stage(node.executable)])
        if not stages:
            named = ", ".join(dict.fromkeys(node.executable for node in graph.nodes)) or "no node"
            raise ValueError(
                f"graph {graph.path} has no estimator that is installed here, it has {named};"
                f" installed are {', '.join(stage_names())}"
            )
        self._publish = publish
        self._members = [_Member(stage, report) for stage in stages]
        self._readers: dict[str, list[tuple[_Member, str]]] = defaultdict(list)
        self.outputs: dict[str, Output] = {}
        kinds: dict[str, type] = {}
        for stage, member in zip(stages, self._members, strict=True):
            self.outputs |= stage.outputs
            for topic, wanted in stage.inputs.items():
                self._readers[topic].append((member, wanted.topic))
                kinds[topic] = wanted.kind
        self.inputs = {topic: kind for topic, kind in kinds.items() if topic not in self.outputs}
        self._loops = any(set(w.inputs) & set(fed.outputs) for k, w in enumerate(stages) for fed in stages[k:])

    @property
    def runners(self) -> dict[str, Runner]:
        """What drives each estimator, by the node's full name."""
        return {member.name: member.runner for member in self._members}

    def push(self, batch: Iterable[Message]) -> None:
        """Gives messages to all that subscribe, and what they publish to those that subscribe to that."""
        for k, (t_ns, topic, value) in enumerate(batch):
            self._deliver((k, t_ns), topic, value)
            if self._loops:
                self._work()
        self._work()

    def malformed(self, topic: str, sentence: str) -> None:
        """Counts a message that could not be read."""
        for member, own_name in self._readers[topic]:
            member.runner.malformed(own_name, sentence)

    def flush(self, t_ns: int) -> None:
        """The end of the input, at a log time, from the first stages to the last."""
        for member in self._members:
            self._pass_on(member, (0, t_ns), member.runner.flush())
            self._work()

    def _work(self) -> None:
        while any(member.inbox for member in self._members):
            for member in self._members:
                for place, topic, value in member.emptied():
                    self._pass_on(member, place, member.runner.push(topic, value))

    def _pass_on(self, member: _Member, place: _Place, emissions: list[Emission]) -> None:
        for own_name, value in emissions:
            topic, data = member.names[own_name], encode(value)
            self._publish(place[1], topic, data)
            if topic in self._readers:  # they get what went through CDR: a quaternion changes a bearing's last digit
                self._deliver(place, topic, decode(type(value), data, value.t_ns))

    def _deliver(self, place: _Place, topic: str, value: Any) -> None:
        for member, own_name in self._readers[topic]:
            member.inbox.append((place, own_name, value))
