"""Runs the estimators of a graph on a bag, offline: the same numbers as the live nodes give."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from operator import itemgetter
from pathlib import Path

from ..graph import Graph
from ..resolved_graph import resolve_node
from ..sim.catalog import SOURCES
from ..stages.catalog import is_stage
from ..stages.runner import Refusal
from ..wire.codec import codec
from .about import about_graph
from .definitions import decoded
from .pipeline import Message, Pipeline
from .reader import Bag, Record, Topic
from .remap import RemappedBag
from .writer import BagWriter


class OfflineRun:
    """One bag through one graph into a new bag. `progress` is called with log times, as they are reached."""

    def __init__(self, bag: Bag | RemappedBag, graph: Graph, report: Callable[[str, Refusal], None]) -> None:
        self.pipeline = Pipeline(graph, self._publish, report)
        self._bag = bag
        self._about = {"made_by": "process", "input": bag.path.name, **about_graph(map(resolve_node, graph.nodes))}
        self._kinds = self.pipeline.inputs
        self._writer: BagWriter
        self._due: list[tuple[int, str | Topic, bytes]] = []  # log time, topic (one that is copied) and data
        # no simulated driver, and no estimator that can run here
        self.left_out = [
            node for node in graph.nodes if not is_stage(node.executable) and node.executable not in SOURCES
        ]
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
        with BagWriter(out, self._about) as self._writer, _rare_collections():
            for topic, output in own.items():
                self._writer.add_topic(topic, codec(output.kind).msgtype, output.latched)
            last_ns = 0
            for batch in _batches(self._bag.records(self._wanted(keep_inputs))):
                self._due = [self._kept(record) for record in batch if keep_inputs and record.topic not in own]
                self.pipeline.push(self._decoded(batch))
                self._write()
                last_ns = batch[-1].t_ns
                progress(last_ns)
            self.pipeline.flush(last_ns)
            self._write()
            return self._writer.counts

    def _wanted(self, keep_inputs: bool) -> list[str]:
        return [*self._bag.topics, *self._bag.refused] if keep_inputs else [*self._kinds]

    def _kept(self, record: Record) -> tuple[int, Topic, bytes]:
        topic = self._bag.topics.get(record.topic) or self._bag.refused[record.topic]
        own = replace(topic, msgtype=record.msgtype, definition=record.definition, encoding=record.encoding)
        return record.t_ns, own, record.data

    def _decoded(self, batch: list[Record]) -> Iterator[Message]:
        """What the graph needs of it, and can read."""
        for record in batch:
            kind = self._kinds.get(record.topic)
            if kind is None:
                continue
            try:
                value = decoded(kind, record)
            except ValueError as error:
                self.pipeline.malformed(record.topic, str(error))
                continue
            yield record.t_ns, record.topic, value

    def _publish(self, t_ns: int, topic: str, data: bytes) -> None:
        self._due.append((t_ns, topic, data))

    def _write(self) -> None:
        """What is due, in the order of the log times."""
        for t_ns, topic, data in sorted(self._due, key=itemgetter(0)):
            if isinstance(topic, Topic):
                self._writer.copy_topic(topic)
            self._writer.write(topic.name if isinstance(topic, Topic) else topic, t_ns, data)
        self._due = []


@contextmanager
def _rare_collections() -> Iterator[None]:
    """Messages and what is made of them form no cycles; to look for some as often as usual takes 4 % of the time."""
    usual = gc.get_threshold()
    gc.set_threshold(_COLLECT_AFTER, *usual[1:])
    try:
        yield
    finally:
        gc.set_threshold(*usual)


def _batches(records: Iterable[Record]) -> Iterator[list[Record]]:
    batch: list[Record] = []
    size = 0
    for record in records:
        batch.append(record)
        size += len(record.data)
        if size > _BATCH:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


_BATCH = 1 << 22  # bytes of messages
_COLLECT_AFTER = 100_000  # objects, a few minutes of a bag
