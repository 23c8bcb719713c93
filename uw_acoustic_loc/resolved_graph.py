"""A graph's nodes with their topics under full names, and everything about them checked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from .config import build, values_of
from .contract import Input, Output, Stage
from .graph import GraphNode
from .sim.catalog import SOURCES, DriverConfig, configured_scenario, make_source
from .sim.scenario import Scenario, find_scenario
from .stages.catalog import STAGES, stage_class
from .stages.runner import RunnerConfig, split_config

R = TypeVar("R")
W = TypeVar("W", bound="Wiring")


@dataclass(frozen=True, eq=False)
class Wiring:
    """A node's inputs and outputs by full topic name, and its effective parameters (a driver's: its scenario)."""

    node: GraphNode
    inputs: Mapping[str, Input] = field(default_factory=dict)
    outputs: Mapping[str, Output] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class StageWiring(Wiring):
    """An estimator: how its stage is built, and how long its inputs wait for each other."""

    make_stage: Callable[[], Stage] = field(kw_only=True)
    lateness: float = field(kw_only=True)  # s


@dataclass(frozen=True, eq=False)
class DriverWiring(Wiring):
    """A simulated driver and the scenario that it plays."""

    scenario: Scenario = field(kw_only=True)
    scenario_file: Path = field(kw_only=True)


def wire_stage(node: GraphNode) -> StageWiring:
    """An estimator's wiring, its parameters checked.

    Raises:
        ValueError: one sentence naming the node, the key, the value and what is allowed.
    """
    where = f"node {node.full_name}"
    cls = stage_class(node.executable)
    own, shared = split_config(_own_parameters(node))
    config: Any = build(cls.Config, own, where)
    runner = build(RunnerConfig, shared, where)

    def make_stage() -> Stage:
        return cls(config)  # type: ignore[call-arg]

    stage = _named(where, make_stage)
    inputs = {node.resolve(i.topic): i for i in stage.inputs}
    outputs = {node.resolve(o.topic): o for o in stage.outputs}
    settings = {**values_of(config), **values_of(runner)}
    return StageWiring(node, inputs, outputs, settings, make_stage=make_stage, lateness=runner.lateness)


def wire_driver(node: GraphNode) -> DriverWiring:
    """A driver's wiring, its scenario read; ValueError as for an estimator."""
    where = f"node {node.full_name}"
    config = build(DriverConfig, _own_parameters(node), where)
    scenario = _named(where, lambda: configured_scenario(config, node.base))
    source = _named(where, lambda: make_source(node.executable, scenario))
    outputs = {node.resolve(o.topic): o for o in source.outputs}
    file = find_scenario(config.scenario, node.base)
    return DriverWiring(node, {}, outputs, dataclasses.asdict(scenario), scenario=scenario, scenario_file=file)


def wire(node: GraphNode) -> Wiring:
    """Any node's wiring; what is not ours has none that we know."""
    if node.executable in STAGES:
        return wire_stage(node)
    return wire_driver(node) if node.executable in SOURCES else Wiring(node)


def upstream_first(wirings: Sequence[W]) -> list[W]:
    """In the order of the data flow: nodes before those that they feed."""
    ordered: list[W] = []
    waiting = list(wirings)
    while waiting:
        pending = {topic for wiring in waiting for topic in wiring.outputs}
        free = [wiring for wiring in waiting if not pending & set(wiring.inputs)] or waiting  # a loop has no beginning
        ordered += free
        waiting = [wiring for wiring in waiting if wiring not in free]
    return ordered


def _own_parameters(node: GraphNode) -> dict[str, Any]:
    return {
        key: value for key, value in node.params.items() if key not in OF_RCLPY and not key.startswith("qos_overrides.")
    }


# parameters of every ROS node, which are rclpy's business
OF_RCLPY = ("use_sim_time", "start_type_description_service")


def _named(where: str, make: Callable[[], R]) -> R:
    try:
        return make()
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
