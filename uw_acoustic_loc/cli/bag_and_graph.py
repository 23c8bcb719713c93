"""The arguments that commands share which read bags, or run a graph on them."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..bag.reader import Bag, Definition
    from ..bag.remap import RemappedBag


def add_bag_and_graph(parser: ArgumentParser, many: bool = False, output: str = "the bag to be made") -> None:
    """Declares the bag or bags, --graph, --output, --remap and --msg-path."""
    parser.add_argument("bag", type=Path, metavar="BAG", nargs="+" if many else None)
    parser.add_argument("--graph", type=Path, required=True, metavar="GRAPH.yaml")
    where = output + (", or the folder for those of several bags" if many else "")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help=where)
    parser.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="another name for a topic of the bag"
    )
    add_msg_path(parser)


def add_msg_path(parser: ArgumentParser) -> None:
    """Declares where definitions are that a bag does not carry."""
    where = "a folder of <package>/msg/<Type>.msg files, for types that the bag has no definition of"
    parser.add_argument("--msg-path", type=Path, metavar="DIR", help=where)


def read_bag(path: Path, options: Namespace) -> Bag:
    """The bag, with the definitions of --msg-path."""
    from ..bag.reader import Bag

    return Bag(path, given_definitions(options))


def given_definitions(options: Namespace) -> dict[str, Definition] | None:
    """Those of --msg-path."""
    from ..bag.definitions import read_definitions

    return read_definitions(options.msg_path) if options.msg_path else None


def open_bag(path: Path, options: Namespace) -> RemappedBag:
    """Opens a bag, its topics under the names that --remap gives."""
    from ..bag.remap import RemappedBag, remaps

    return RemappedBag(read_bag(path, options), remaps(options.remap))
