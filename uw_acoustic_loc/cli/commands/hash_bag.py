"""`uwloc hash`: hashes by which two runs are compared."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..console import damage_code

HELP = "a hash per topic of a bag's messages, whatever program wrote them"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("--json", action="store_true", help="print JSON instead of lines")


def run(options: Namespace) -> int:
    """Prints a hash per topic and one of all."""
    from ...bag.fingerprint import fingerprints, overall
    from ...bag.reader import Bag

    bag = Bag(options.bag)
    found = fingerprints(bag)
    if options.json:
        topics = {topic: {"n": one.count, "sha256": one.digest} for topic, one in found.items()}
        print(json.dumps({"topics": topics, "all": overall(found)}, indent=2))
    else:
        for topic, one in found.items():
            print(f"{one.digest}  {one.count:7d}  {topic}")
        print(f"{overall(found)}  {sum(one.count for one in found.values()):7d}  all")
    return damage_code(bag.damage)
