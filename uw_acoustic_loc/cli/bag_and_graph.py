"""The arguments of the commands that run a graph on bags."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..bag.remap import RemappedBag


def add_bag_and_graph(parser: ArgumentParser, many: bool = False) -> None:
    """Declares the bag or bags, --graph, --output and --remap."""
    parser.add_argument("bag", type=Path, metavar="BAG", nargs="+" if many else None)
    parser.add_argument("--graph", type=Path, required=True, metavar="GRAPH.yaml")
    where = "the bag to be made" + (", or the folder for those of several bags" if many else "")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help=where)
    parser.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="another name for a topic of the bag"
    )


def open_bag(path: Path, options: Namespace) -> RemappedBag:
    """Opens a bag, its topics under the names that --remap gives."""
    from ..bag.reader import Bag
    from ..bag.remap import RemappedBag, remaps

    return RemappedBag(Bag(path), remaps(options.remap))
