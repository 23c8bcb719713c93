"""`uwloc replay`: a bag through a graph's live nodes."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from ..bag_and_graph import add_bag_and_graph, open_bag
from ..console import STDERR, NodeLog, damage_code, progress

HELP = "play a bag to a graph's live nodes and record what they publish"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    add_bag_and_graph(parser)
    parser.add_argument("--rate", type=float, default=1.0, help="x real time; 0 = as fast as the nodes go")


def run(options: Namespace) -> int:
    """Plays a bag to live nodes, records their outputs, and compares what was sent with what arrived."""
    import dataclasses

    from ...bag.reader import Bag
    from ...graph import load_graph
    from ...ros.launcher import Launcher, Run
    from ...ros.replay import player_node, replay_books, without_drivers

    bag = open_bag(options.bag, options)
    graph = without_drivers(load_graph(options.graph))
    player = player_node(graph, bag, options.rate, options.remap)
    first, last = bag.span()
    with progress("replay", (last - first) * 1e-9) as bar:
        run = Run(record=options.output, player=player, progress=bar)
        launcher = Launcher(dataclasses.replace(graph, clock_rate=0.0), run, NodeLog())
        code = launcher.run()
    books = replay_books(launcher.books, bag, Bag(options.output)) if options.output.exists() else []
    for entry in books:
        STDERR.print(f"{'' if entry.balanced else 'LOST '}{entry.sentence}", markup=False, soft_wrap=True)
    complete = bool(books) and all(entry.balanced for entry in books)
    return max(code, int(not complete), damage_code(bag.damage))
