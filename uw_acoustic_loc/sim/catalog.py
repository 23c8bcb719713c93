"""Which class each simulated driver executable runs, and the parameters that all of them have."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ..config import param
from ..contract import Source

if TYPE_CHECKING:
    from .scenario import Scenario

SOURCES = {
    "vehicle_driver": ("vehicle", "VehicleSource"),
    "hydrophone_driver": ("hydrophones", "HydrophoneSource"),
    "buoy_driver": ("buoys", "BuoySource"),
    "sonar_driver": ("sonar", "SonarSource"),
}


@dataclass(frozen=True)
class DriverConfig:
    """Parameters of every simulated driver."""

    scenario: str = param("harbour", doc="a scenario file, or the name of one that comes with the package")
    seed: int = param(-1, low=-1, doc="-1 = the scenario's own")
    start_time: int = param(0, unit="s since 1970", low=0, doc="without /clock: when the scenario starts; 0 = now")


def configured_scenario(config: DriverConfig, base: Path) -> Scenario:
    """Reads the scenario that a driver's parameters name, with their seed; relative paths are taken from `base`."""
    from .scenario import find_scenario, load_scenario  # noqa: PLC0415  slow to import, and estimators need it not

    scenario = load_scenario(find_scenario(config.scenario, base))
    return scenario if config.seed < 0 else dataclasses.replace(scenario, seed=config.seed)


def make_source(executable: str, scenario: Scenario) -> Source:
    """Makes the simulated sensor of a driver executable."""
    module, name = SOURCES[executable]
    source: Source = getattr(import_module(f"{__package__}.{module}"), name)(scenario)
    return source
