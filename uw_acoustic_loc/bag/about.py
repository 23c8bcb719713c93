"""How a bag was made, which it stores as MCAP metadata beside the package's version."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable

from ..resolved_graph import ResolvedNode
from ..sim.scenario import Scenario


def about_scenario(scenario: Scenario) -> dict[str, str]:
    """Returns seed and effective configuration of a simulation."""
    return {"seed": str(scenario.seed), "config": json.dumps(dataclasses.asdict(scenario))}


def about_graph(nodes: Iterable[ResolvedNode]) -> dict[str, str]:
    """Returns seeds and effective parameters of a graph's nodes, defaults included."""
    config = {resolved.node.full_name: resolved.settings for resolved in nodes if resolved.settings}
    seeds = sorted({int(settings["seed"]) for settings in config.values() if "seed" in settings})
    return {"seed": ", ".join(map(str, seeds)), "config": json.dumps(config)}
