"""The harbour's buoys and what the buoy tracker's stage makes of their messages."""

from pathlib import Path

from uw_acoustic_loc.config import configured
from uw_acoustic_loc.contract import Emission
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.sim.buoys import BuoySource
from uw_acoustic_loc.sim.scenario import Scenario, load_scenario
from uw_acoustic_loc.stages.toa_tracker import ToaTrackerStage

HARBOUR = load_scenario(Path(__file__).parents[1] / "config/harbour/scenario.yaml")
CONFIG = configured(ToaConfig, bottom_depth=40.0, acceleration_noise=0.18, vertical_acceleration_noise=0.01)


def inputs_of(scenario: Scenario) -> list[tuple[str, object]]:
    return [(t, v) for _, t, v in BuoySource(scenario).events() if t.startswith("buoys/")]


def run(config: ToaConfig, messages: list[tuple[str, object]]) -> tuple[ToaTrackerStage, list[Emission]]:
    stage = ToaTrackerStage(config)
    handlers = {i.topic: i.handle for i in stage.inputs}
    return stage, [e for topic, value in messages if topic in handlers for e in handlers[topic](value)]
