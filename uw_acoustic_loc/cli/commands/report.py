"""`uwloc report`: one page about a bag."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..bag_and_graph import add_msg_path, given_definitions
from ..console import damage_code, say

HELP = "one page with tracks, bearings, errors and rates"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("-o", "--output", type=Path, default=Path("report.html"))
    add_msg_path(parser)


def run(options: Namespace) -> int:
    """Writes the report of a bag."""
    from ...evaluation.recording import load
    from ...evaluation.report import write_report
    from ...evaluation.score import score

    recording = load(options.bag, given_definitions(options))
    write_report(recording, score(recording), options.output)
    say(f"report in {options.output}")
    return damage_code(recording.damage)
