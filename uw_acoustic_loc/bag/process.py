"""Runs the estimators of a graph on a bag, offline: the same numbers as the live nodes give."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..graph import Graph
from ..stages.runner import Refusal
from ..wire.codec import codec
from .pipeline import Pipeline, Published
from .reader import Bag, Record
from .types import BagMake, deserialize, serialize
from .writer import BagWriter

_MAKE = BagMake()


class OfflineRun:
    """One bag through one graph into a new bag. `progress` is called with each record's log time."""

    def __init__(self, bag: Bag, graph: Graph, tell: Callable[[str, Refusal], None]) -> None:
        self.pipeline = Pipeline(graph, tell)
        self._bag = bag
        self._kinds = self.pipeline.inputs
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
        last_ns = 0
        with BagWriter(out, {"made_by": "process", "input": self._bag.path.name}) as writer:
            for topic, output in own.items():
                writer.add_topic(topic, codec(output.kind).msgtype, output.latched)
            topics = None if keep_inputs else [*self._kinds]
            for record in self._bag.records(topics):
                if keep_inputs and record.topic not in own:
                    writer.add_topic(record.topic, record.msgtype, self._bag.topics[record.topic].latched)
                    writer.write(record.topic, record.t_ns, record.data)
                last_ns = record.t_ns
                for published in self._feed(record):
                    _write(writer, published, record.t_ns)
                progress(record.t_ns)
            for published in self.pipeline.flush():
                _write(writer, published, last_ns)
            return writer.counts

    def _feed(self, record: Record) -> list[Published]:
        kind = self._kinds.get(record.topic)
        if kind is None:
            return []
        try:
            if record.msgtype != codec(kind).msgtype:
                raise ValueError(f"type must be {codec(kind).msgtype}, got {record.msgtype}")
            value = codec(kind).decode(deserialize(record.data, record.msgtype), record.t_ns)
        except ValueError as error:
            self.pipeline.malformed(record.topic, str(error))
            return []
        return list(self.pipeline.push(record.topic, value))


def _write(writer: BagWriter, published: Published, t_ns: int) -> None:
    topic, value = published
    form = codec(type(value))
    writer.write(topic, t_ns, serialize(form.encode(_MAKE, value), form.msgtype))
