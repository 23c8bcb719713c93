"""`uwloc replay`: a bag through a graph's live nodes."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from ..bag_and_graph import add_bag_and_graph, open_bag
from ..console import NodeLog, damage_code, importing, progress, say

HELP = "play a bag to a graph's live nodes and record what they publish"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    add_bag_and_graph(parser)
    parser.add_argument("--rate", type=float, default=1.0, help="x real time; 0 = as fast as the nodes go")


def run(options: Namespace) -> int:
    """Plays a bag to live nodes, records their outputs, and compares what was sent with what arrived."""
    with importing():
        import dataclasses

        from ...bag.reader import Bag
        from ...graph import load_graph
        from ...ros.orchestrator.launcher import Launcher, LaunchOptions
        from ...ros.orchestrator.replay import player_node, replay_deliveries, without_drivers

    bag = open_bag(options.bag, options)
    graph = without_drivers(load_graph(options.graph))
    player = player_node(graph, bag, options.rate, options.remap)
    first, last = bag.span()
    with progress("replay", (last - first) * 1e-9) as bar:
        launched = LaunchOptions(options.output, bag_is_vital=True, player=player, progress=bar)
        launcher = Launcher(dataclasses.replace(graph, clock_rate=0.0), launched, NodeLog())
        code = launcher.run()
    deliveries = replay_deliveries(launcher.reports, bag, Bag(options.output)) if options.output.exists() else []
    for delivery in deliveries:
        say(f"{'' if delivery.complete else 'LOST '}{delivery.sentence}")
    complete = bool(deliveries) and all(delivery.complete for delivery in deliveries)
    return max(code, int(not complete), damage_code(bag.damage))
