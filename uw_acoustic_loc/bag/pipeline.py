"""The stages of a graph, chained without DDS: what one publishes is pushed into those that subscribe to it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

from ..contract import Emission, Output
from ..graph import Graph
from ..stages.catalog import STAGES
from ..stages.runner import Refusal, Runner
from ..wiring import StageWiring, upstream_first, wire_stage
from .types import decode, encode

Publish = Callable[[str, bytes], None]  # full topic name, CDR


class _Member:
    """An estimator, with the full names of its outputs."""

    def __init__(self, wiring: StageWiring, tell: Callable[[str, Refusal], None]) -> None:
        name = wiring.node.full_name
        self.runner = Runner(wiring.make_stage, wiring.lateness, lambda refusal: tell(name, refusal))
        self.names = {output.topic: topic for topic, output in wiring.outputs.items()}


class Pipeline:
    """All estimators of `graph`; `publish` takes what they say, `tell` a node's name and each message it refused."""

    def __init__(self, graph: Graph, publish: Publish, tell: Callable[[str, Refusal], None]) -> None:
        wirings = upstream_first([wire_stage(node) for node in graph.nodes if node.executable in STAGES])
        if not wirings:
            raise ValueError(f"graph {graph.path} has no estimator (one of {', '.join(STAGES)})")
        self._publish = publish
        self._members = [_Member(wiring, tell) for wiring in wirings]
        self._readers: dict[str, list[tuple[_Member, str]]] = defaultdict(list)
        self.outputs: dict[str, Output] = {}
        kinds: dict[str, type] = {}
        for wiring, member in zip(wirings, self._members, strict=True):
            self.outputs |= wiring.outputs
            for topic, wanted in wiring.inputs.items():
                self._readers[topic].append((member, wanted.topic))
                kinds[topic] = wanted.kind
        self.inputs = {topic: kind for topic, kind in kinds.items() if topic not in self.outputs}

    def push(self, topic: str, value: Any) -> None:
        """Gives a message to all that subscribe, and what they publish to those that subscribe to that."""
        for member, own_name in self._readers[topic]:
            self._pass_on(member, member.runner.push(own_name, value))

    def malformed(self, topic: str, sentence: str) -> None:
        """Counts a message that could not be read."""
        for member, own_name in self._readers[topic]:
            member.runner.malformed(own_name, sentence)

    def flush(self) -> None:
        """The end of the input, from the first stages to the last."""
        for member in self._members:
            self._pass_on(member, member.runner.flush())

    def _pass_on(self, member: _Member, emissions: Iterable[Emission]) -> None:
        for own_name, value in emissions:
            topic, data = member.names[own_name], encode(value)
            self._publish(topic, data)
            if topic in self._readers:  # they get what went through CDR: a quaternion changes a bearing's last digit
                self.push(topic, decode(type(value), data, value.t_ns))
