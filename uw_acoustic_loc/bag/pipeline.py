"""The stages of a graph, chained without DDS: what one publishes is pushed into those that subscribe to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from ..contract import Output
from ..graph import Graph
from ..stages.catalog import STAGES
from ..stages.runner import Refusal, Runner
from ..wire.codec import codec
from ..wiring import StageWiring, upstream_first, wire_stage
from .types import BagMake

_MAKE = BagMake()
Published = tuple[str, Any]  # full topic name, core value


class Pipeline:
    """All estimators of `graph`; `tell` is called with a node's name and each message that it refused."""

    def __init__(self, graph: Graph, tell: Callable[[str, Refusal], None]) -> None:
        wirings = upstream_first([wire_stage(node) for node in graph.nodes if node.executable in STAGES])
        if not wirings:
            raise ValueError(f"graph {graph.path} has no estimator (one of {', '.join(STAGES)})")
        self._members = [(wiring, _runner(wiring, tell)) for wiring in wirings]
        self.outputs: dict[str, Output] = {}
        for wiring in wirings:
            self.outputs |= wiring.outputs
        kinds = {topic: wanted.kind for wiring in wirings for topic, wanted in wiring.inputs.items()}
        self.inputs = {topic: kind for topic, kind in kinds.items() if topic not in self.outputs}

    def push(self, topic: str, value: Any) -> Iterator[Published]:
        """Gives a message to all that subscribe; yields what they, and in turn the others, publish."""
        for wiring, runner in self._members:
            if topic in wiring.inputs:
                yield from self._pass_on(wiring, runner.push(wiring.inputs[topic].topic, value))

    def malformed(self, topic: str, sentence: str) -> None:
        """Counts a message that could not be read."""
        for wiring, runner in self._members:
            if topic in wiring.inputs:
                runner.malformed(wiring.inputs[topic].topic, sentence)

    def flush(self) -> Iterator[Published]:
        """The end of the input, from the first stages to the last."""
        for wiring, runner in self._members:
            yield from self._pass_on(wiring, runner.flush())

    def _pass_on(self, wiring: StageWiring, emissions: Iterator[Published]) -> Iterator[Published]:
        for own_name, value in emissions:
            topic = wiring.node.resolve(own_name)
            yield topic, value
            if any(topic in member.inputs for member, _ in self._members):
                yield from self.push(topic, _as_received(value))


def _as_received(value: Any) -> Any:
    """The value as a subscriber reads it: a bearing that went through a quaternion differs in its last digit."""
    form = codec(type(value))
    return form.decode(form.encode(_MAKE, value), value.t_ns)


def _runner(wiring: StageWiring, tell: Callable[[str, Refusal], None]) -> Runner:
    name = wiring.node.full_name
    return Runner(wiring.make_stage, wiring.lateness, lambda refusal: tell(name, refusal))
