"""How a graph is replayed: the bag stands in for the drivers, and the player waits for the estimators."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from ..bag.reader import Bag
from ..graph import Graph, GraphNode
from ..sim.catalog import SOURCES
from ..stages.catalog import STAGES
from ..wiring import upstream_first, wire


def without_drivers(graph: Graph) -> Graph:
    """The graph's other nodes."""
    return dataclasses.replace(graph, nodes=tuple(n for n in graph.nodes if n.executable not in SOURCES))


def player_node(graph: Graph, path: Path, bag: Bag, rate: float) -> GraphNode:
    """The player of all topics that no node of the graph publishes itself.

    Raises:
        ValueError: the bag has none of the topics that the graph needs.
    """
    wirings = upstream_first([wire(node) for node in graph.nodes])
    outputs = {topic for wiring in wirings for topic in wiring.outputs}
    needed = {topic for wiring in wirings for topic in wiring.inputs} - outputs
    if needed and not needed & set(bag.topics):
        raise ValueError(f"bag {path} has none of the topics that the graph needs: {', '.join(sorted(needed))}")
    topics = sorted(needed & set(bag.topics)) if needed else sorted(set(bag.topics) - outputs)
    consumers = [w.node.full_name for w in wirings if w.node.executable in STAGES]
    params = {
        "bag": path.resolve(),
        "rate": float(rate),
        "topics": f"[{', '.join(topics)}]",
        "consumers": f"[{', '.join([*consumers, '/recorder'])}]",
    }
    return GraphNode("player", "player", "/", None, {}, params)
