"""A scenario's measurements and truth straight into a bag: no DDS, as fast as possible."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from pathlib import Path

from ..contract import Event, Output, Source
from ..sim.catalog import SOURCES, make_source
from ..sim.scenario import Scenario
from ..wire.codec import codec
from .about import about_scenario
from .rosbags_messages import encode
from .writer import BagWriter

# Where the drivers of a scenario live: the vehicle's own topics under its name.
ON_VEHICLE = ("vehicle_driver", "hydrophone_driver")


def simulate(scenario: Scenario, out: Path, progress: Callable[[int], None]) -> dict[str, int]:
    """Writes all events of all drivers in order; returns counts per topic. `progress` gets each event's instant."""
    sources = [(name, make_source(name, scenario)) for name in SOURCES if _simulated(name, scenario)]
    with BagWriter(out, {"made_by": "simulate", **about_scenario(scenario)}) as writer:
        for name, source in sources:
            for output in source.outputs:
                writer.add_topic(_full_name(name, output, scenario), codec(output.kind).msgtype, output.latched)
        streams = [_named_events(name, source, scenario) for name, source in sources]
        for t_ns, topic, value in heapq.merge(*streams, key=lambda event: event[0]):
            writer.write(topic, t_ns, encode(value))
            progress(t_ns)
        return writer.counts


def _simulated(driver: str, scenario: Scenario) -> bool:
    if driver in ON_VEHICLE:
        return scenario.vehicle is not None
    if driver == "buoy_driver":
        return scenario.buoys is not None or bool(scenario.moorings)
    return scenario.sonar is not None


def _full_name(driver: str, output: Output, scenario: Scenario) -> str:
    namespace = f"/{scenario.vehicle.name}" if scenario.vehicle and driver in ON_VEHICLE else ""
    return output.topic if output.topic.startswith("/") else f"{namespace}/{output.topic}"


def _named_events(driver: str, source: Source, scenario: Scenario) -> Iterator[Event]:
    names = {output.topic: _full_name(driver, output, scenario) for output in source.outputs}
    for t_ns, topic, value in source.events():
        yield t_ns, names[topic], value
