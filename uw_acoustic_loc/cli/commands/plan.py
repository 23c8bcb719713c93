"""`uwloc plan`: maps of the accuracy that a scenario's nets can reach."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..console import say

HELP = "maps of the accuracy that a scenario's nets can reach"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out/plan"), metavar="DIR", help="default %(default)s"
    )


def run(options: Namespace) -> int:
    """Writes maps of every net that the scenario has."""
    from ...planning.maps import write_maps
    from ...sim.scenario import load_scenario

    scenario = load_scenario(options.scenario)
    say(f"{write_maps(scenario, str(options.scenario), options.output)}")
    return 0
