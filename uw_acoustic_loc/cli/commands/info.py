"""`uwloc info`: what is in a bag, what is wrong with it, and what can be done with it."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..bag_and_graph import add_msg_path, read_bag
from ..console import damage_code, wide

HELP = "what is in a bag, what is wrong with it, which estimators can use it"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    add_msg_path(parser)


def run(options: Namespace) -> int:
    """Prints a bag's content; exit code 1 when a part of it cannot be read."""
    from rich.text import Text

    from ...bag.survey import survey
    from ...bag.usable import uses
    from ..bag_summary import as_json, parts

    bag = read_bag(options.bag, options)
    found = survey(bag)
    estimators = uses(found)
    if options.json:
        print(json.dumps(as_json(bag, found, estimators), indent=2))
    else:
        widest = sum(
            max(map(len, names), default=0) for names in (found.topics, [t.msgtype for t in found.topics.values()])
        )
        console = wide(widest + 40)
        for part in parts(bag, found, estimators):
            console.print(part, soft_wrap=isinstance(part, Text))
    return damage_code(bag.damage)
