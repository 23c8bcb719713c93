"""How a graph is replayed: the bag stands in for the drivers, and what was sent must equal what was taken."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from ...bag.reader import Bag
from ...bag.remap import RemappedBag, remaps
from ...graph import Graph, GraphNode
from ...resolved_graph import resolve_node, upstream_first
from ...sim.catalog import SOURCES
from ...stages.catalog import is_stage
from ..report import Reports, published
from .command_line import RECORDER
from .window import window_s


def without_drivers(graph: Graph) -> Graph:
    """The graph's other nodes."""
    return dataclasses.replace(graph, nodes=tuple(n for n in graph.nodes if n.executable not in SOURCES))


def player_node(graph: Graph, bag: RemappedBag, rate: float, pairs: Sequence[str]) -> GraphNode:
    """The player of all topics that no node of the graph publishes itself; `pairs` are `theirs:=ours`.

    Raises:
        ValueError: the bag has none of the topics that the graph needs.
    """
    wirings = upstream_first([resolve_node(node) for node in graph.nodes])
    outputs = {topic for wiring in wirings for topic in wiring.outputs}
    needed = {topic for wiring in wirings for topic in wiring.inputs} - outputs
    if needed and not needed & set(bag.topics):
        raise ValueError(f"bag {bag.path} has none of the topics that the graph needs: {', '.join(sorted(needed))}")
    topics = sorted(needed & set(bag.topics)) if needed else sorted(set(bag.topics) - outputs)
    consumers = [w.node.full_name for w in wirings if is_stage(w.node.executable)]
    params = {
        "bag": str(bag.path.resolve()),
        "rate": float(rate),
        "window": window_s(wirings),
        "topics": topics,
        "consumers": [*consumers, RECORDER],
    }
    if latched := sorted({topic for w in wirings for topic, i in w.inputs.items() if i.latched} & set(topics)):
        params["latched"] = latched
    if pairs:
        params["remap"] = [f"{old} {new}" for old, new in remaps(pairs).items()]
    return GraphNode("player", "player", "/", None, {}, params)


@dataclass(frozen=True)
class Delivery:
    """A topic's messages on their way from a writer to a reader."""

    topic: str
    written: int
    reader: str
    read: int

    @property
    def complete(self) -> bool:
        """Nothing was lost, nothing came twice."""
        return self.written == self.read

    @property
    def sentence(self) -> str:
        """For example `/odometry: 200 out, 200 in /bearing`."""
        return f"{self.topic}: {self.written} out, {self.read} in {self.reader}"


def replay_deliveries(reports: Reports, played: RemappedBag, recorded: Bag) -> list[Delivery]:
    """What the bag holds against what the nodes took, and what they sent against what the recorded bag holds."""
    nodes = {name: report for name, report in reports.items() if name != RECORDER}
    taken = sorted((topic, name, t.count) for name, report in nodes.items() for topic, t in report.taken.items())
    sent = published(nodes)
    written = sent + Counter(record.topic for record in played.records({t for t, _, _ in taken} - set(sent)))
    kept = Counter(record.topic for record in recorded.records([*sent]))
    inputs = [Delivery(topic, written[topic], name, count) for topic, name, count in taken]
    return [*inputs, *(Delivery(topic, sent[topic], "the new bag", kept[topic]) for topic in sorted(sent))]
