"""`uwloc simulate`: a scenario straight into a bag, without DDS."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..console import progress, say

HELP = "measurements and truth of a scenario straight into a bag"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("scenario", type=Path, metavar="SCENARIO.yaml")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="BAG")
    parser.add_argument("--seed", type=int, default=-1, help="instead of the scenario's own")


def run(options: Namespace) -> int:
    """Writes a scenario into a bag."""
    import dataclasses

    from ...bag.simulate import simulate
    from ...sim.scenario import load_scenario

    scenario = load_scenario(options.scenario)
    if options.seed >= 0:
        scenario = dataclasses.replace(scenario, seed=options.seed)
    with progress("simulate", scenario.duration) as bar:
        counts = simulate(scenario, options.output, lambda t_ns: bar((t_ns - scenario.start_ns) * 1e-9))
    say(f"{sum(counts.values())} messages on {len(counts)} topics in {options.output}")
    return 0
