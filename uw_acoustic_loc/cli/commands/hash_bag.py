"""`uwloc hash`: hashes by which two runs are compared."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..bag_and_graph import add_msg_path, read_bag
from ..console import damage_code, harmless, say

HELP = "a hash per topic of a bag's messages, whatever program wrote them"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("--json", action="store_true", help="print JSON instead of lines")
    add_msg_path(parser)


def run(options: Namespace) -> int:
    """Prints a hash per topic and one of all."""
    from ...bag.fingerprint import fingerprints, overall

    bag = read_bag(options.bag, options)
    found = fingerprints(bag)
    if options.json:
        topics = {topic: {"n": one.count, "sha256": one.digest} for topic, one in found.items()}
        print(json.dumps({"topics": topics, "all": overall(found)}, indent=2))
    else:
        for topic, one in found.items():
            print(f"{one.digest}  {one.count:7d}  {harmless(topic)}")
        print(f"{overall(found)}  {sum(one.count for one in found.values()):7d}  all")
    for topic, one in found.items():
        if one.raw:
            say(f"note: {one.raw} messages on {topic} cannot be decoded: their bytes are hashed as they are")
    return damage_code(bag.damage)
