"""`uwloc check`: a bag against a file of expected values."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..bag_and_graph import add_msg_path, given_definitions
from ..console import complain, wide

if TYPE_CHECKING:
    from rich.table import Table

    from ...evaluation.check import Check

HELP = "a bag against a file of expected counts, rates, values and scores"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("expected", type=Path, metavar="EXPECTED.yaml")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_msg_path(parser)


def run(options: Namespace) -> int:
    """Prints what was checked, and one sentence per violation on stderr; exit code 1 when there is one."""
    from ...evaluation.check import checked, load_expected

    checks = list(checked(options.bag, load_expected(options.expected), given_definitions(options)))
    failed = [one for one in checks if not one.passed]
    if options.json:
        listed = [{"what": c.what, "expected": c.expected, "found": c.found, "passed": c.passed} for c in checks]
        print(json.dumps({"passed": not failed, "checks": listed}, indent=2))
    else:
        columns = [[c.what for c in checks], [c.expected for c in checks], [c.found for c in checks]]
        wide(sum(max(map(len, column), default=0) for column in columns) + 20).print(_table(checks))
    for one in failed:
        complain(f"{options.bag}: {one.sentence}")
    return 1 if failed else 0


def _table(checks: Sequence[Check]) -> Table:
    from rich.table import Table
    from rich.text import Text

    drawn = Table("", "check", "expected", "found", box=None, padding=(0, 2, 0, 0), header_style="dim")
    for one in checks:
        verdict = Text("pass", style="green") if one.passed else Text("FAIL", style="bold red")
        drawn.add_row(verdict, Text(one.what), Text(one.expected), Text(one.found))
    return drawn
