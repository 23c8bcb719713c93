"""How a bag was made, which it stores as MCAP metadata beside the package's version."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable

from ..resolved_graph import Wiring
from ..sim.scenario import Scenario


def about_scenario(scenario: Scenario) -> dict[str, str]:
    """Returns seed and effective configuration of a simulation."""
    return {"seed": str(scenario.seed), "config": json.dumps(dataclasses.asdict(scenario))}


def about_graph(wirings: Iterable[Wiring]) -> dict[str, str]:
    """Returns seeds and effective parameters of a graph's nodes, defaults included."""
    config = {wiring.node.full_name: wiring.settings for wiring in wirings if wiring.settings}
    seeds = sorted({int(settings["seed"]) for settings in config.values() if "seed" in settings})
    return {"seed": ", ".join(map(str, seeds)), "config": json.dumps(config)}
