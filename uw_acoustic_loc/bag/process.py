"""Runs the estimators of a graph on a bag, offline: the same numbers as the live nodes give."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..graph import Graph
from ..stages.runner import Refusal
from ..wire.codec import codec
from ..wiring import wire
from .about import about_graph
from .pipeline import Pipeline
from .reader import Bag, Record
from .remap import RemappedBag
from .types import decode
from .writer import BagWriter


class OfflineRun:
    """One bag through one graph into a new bag. `progress` is called with each record's log time."""

    def __init__(self, bag: Bag | RemappedBag, graph: Graph, tell: Callable[[str, Refusal], None]) -> None:
        self.pipeline = Pipeline(graph, self._publish, tell)
        self._bag = bag
        self._about = {"made_by": "process", "input": bag.path.name, **about_graph(map(wire, graph.nodes))}
        self._kinds = self.pipeline.inputs
        self._writer: BagWriter
        self._t_ns = 0  # log time of what is being handled
        missing = sorted(set(self._kinds) - set(bag.topics))
        self.missing = missing
        if len(missing) == len(self._kinds):
            raise ValueError(
                f"bag {bag.path} has none of the topics that the graph needs ({', '.join(missing)}),"
                f" it has {', '.join(sorted(bag.topics)) or 'none'}"
            )

    def run(self, out: Path, keep_inputs: bool, progress: Callable[[int], None]) -> dict[str, int]:
        """Writes the outputs (and, to keep, all of the bag that is not an output); returns counts per topic."""
        own = self.pipeline.outputs
        with BagWriter(out, self._about) as self._writer:
            for topic, output in own.items():
                self._writer.add_topic(topic, codec(output.kind).msgtype, output.latched)
            topics = None if keep_inputs else [*self._kinds]
            for record in self._bag.records(topics):
                self._t_ns = record.t_ns
                if keep_inputs and record.topic not in own:
                    self._keep(record)
                self._feed(record)
                progress(record.t_ns)
            self.pipeline.flush()
            return self._writer.counts

    def _keep(self, record: Record) -> None:
        topic = self._bag.topics[record.topic]
        self._writer.add_topic(record.topic, record.msgtype, topic.latched, topic.definition)
        self._writer.write(record.topic, record.t_ns, record.data)

    def _feed(self, record: Record) -> None:
        kind = self._kinds.get(record.topic)
        if kind is None:
            return
        try:
            if record.msgtype != codec(kind).msgtype:
                raise ValueError(f"type must be {codec(kind).msgtype}, got {record.msgtype}")
            value = decode(kind, record.data, record.t_ns)
        except ValueError as error:
            self.pipeline.malformed(record.topic, str(error))
            return
        self.pipeline.push(record.topic, value)

    def _publish(self, topic: str, data: bytes) -> None:
        self._writer.write(topic, self._t_ns, data)
