"""`uwloc score`: errors of a bag."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..bag_and_graph import add_msg_path, given_definitions
from ..console import SafeConsole, damage_code, say

HELP = "errors of a bag's estimates against its truth"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_msg_path(parser)


def run(options: Namespace) -> int:
    """Prints the errors of a bag."""
    from ...evaluation.recording import load
    from ...evaluation.score import score

    recording = load(options.bag, given_definitions(options))
    print_score(score(recording), options.json)
    return damage_code(recording.damage)


def print_score(scored: dict[str, object], as_json: bool) -> None:
    """Prints the score on stdout, as JSON or as tables."""
    from ...evaluation.score import table

    if as_json:
        print(json.dumps(scored, indent=2))
    elif scored:
        SafeConsole().print(table(scored))
    else:
        say("nothing to score: none of the bag's topics has the name of an estimate (docs/contract.md, section 2)")
