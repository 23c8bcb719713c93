"""`uwloc reproduce`: the papers' tables and figures, theirs beside ours."""
# ruff: noqa: PLC0415

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from ..console import progress, say

if TYPE_CHECKING:
    from ...studies.outcome import Outcome

HELP = "the papers' tables and figures, theirs beside ours"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("name", metavar="NAME", help="a study, or all")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/reproduce"), metavar="DIR", help="default %(default)s"
    )
    parser.add_argument("--runs", type=int, default=0, metavar="N", help="of the Monte Carlo; 0 = the study's own")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="print the numbers and draw nothing")


def run(options: Namespace) -> int:
    """Runs one study or all.

    Raises:
        ValueError: there is no such study, or fewer than one run.
    """
    from ...studies.catalog import NAMES, write_page

    if options.name not in (*NAMES, "all"):
        raise ValueError(f"reproduce: NAME must be one of {', '.join((*NAMES, 'all'))}, got '{options.name}'")
    if options.runs < 0 or options.seed < 0:
        raise ValueError(f"reproduce: --runs and --seed must not be negative, got {options.runs} and {options.seed}")
    names = NAMES if options.name == "all" else (options.name,)
    outcomes = {name: _measured(name, options.runs, options.seed) for name in names}
    if options.json:
        found = {name: outcome.numbers for name, outcome in outcomes.items()}
        print(json.dumps(found if options.name == "all" else found[options.name], indent=2))
    else:
        say(f"{write_page(outcomes, options.seed, options.output)}")
    return 0


def _measured(name: str, runs: int, seed: int) -> Outcome:
    from ...studies.catalog import study

    found = study(name)
    with progress(f"reproduce {name}", 100.0, "%") as bar:
        return found.measure(runs or found.RUNS, seed, lambda share: bar(100.0 * share))
