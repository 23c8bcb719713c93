"""`uwloc launch`: the live graph, a process per node."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..console import NodeLog, importing, progress

HELP = "start the nodes of a graph, one process each"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("graph", type=Path, metavar="GRAPH.yaml")
    parser.add_argument("--record", type=Path, metavar="BAG", help="record all outputs into a new bag")
    parser.add_argument("--duration", type=float, default=0.0, metavar="S", help="stop after S seconds of the clock")


def run(options: Namespace) -> int:
    """Starts a graph and watches it to its end."""
    return launch_graph(options.graph, options.record, options.duration)


def launch_graph(graph: Path, record: Path | None, duration: float, bag_is_vital: bool = False) -> int:
    """Runs a graph file's nodes until the duration is over (0 = until stopped); returns the exit code.

    When the recorder fails the run goes on, unless the bag is what it is made for.
    """
    with importing():
        from ...graph import load_graph
        from ...ros.orchestrator.launcher import Launcher, LaunchOptions

    with progress("launch", duration) as bar:
        options = LaunchOptions(record, bag_is_vital, duration, progress=bar if duration else None)
        return Launcher(load_graph(graph), options, NodeLog()).run()
