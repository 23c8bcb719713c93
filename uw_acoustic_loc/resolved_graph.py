"""A graph's nodes with their topics under full names, and everything about them checked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from .config import build
from .contract import Input, Output, Stage
from .graph import GraphNode, check_topics, own_parameters
from .sim.catalog import SOURCES, DriverConfig, configured_scenario, make_source
from .sim.scenario import Scenario, find_scenario
from .stages.build import configure
from .stages.catalog import is_stage
from .stages.inputs.settings import InputConfig
from .wire.codec import codec

R = TypeVar("R")
N = TypeVar("N", bound="ResolvedNode")


@dataclass(frozen=True, eq=False)
class ResolvedNode:
    """A node's inputs and outputs by full topic name, and its effective parameters (a driver's: its scenario)."""

    node: GraphNode
    inputs: Mapping[str, Input] = field(default_factory=dict)
    outputs: Mapping[str, Output] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ResolvedStage(ResolvedNode):
    """An estimator: how its stage is built, and how long its inputs wait for each other."""

    make_stage: Callable[[], Stage] = field(kw_only=True)
    lateness: float = field(kw_only=True)  # s
    input_configs: Mapping[str, InputConfig] = field(kw_only=True)  # by the stage's own topic


@dataclass(frozen=True, eq=False)
class ResolvedDriver(ResolvedNode):
    """A simulated driver and the scenario that it plays."""

    scenario: Scenario = field(kw_only=True)
    scenario_file: Path = field(kw_only=True)


def resolve_stage(node: GraphNode) -> ResolvedStage:
    """An estimator of a graph, its parameters checked.

    Raises:
        ValueError: one sentence naming the node, the key, the value and what is allowed.
    """
    where = f"node {node.full_name}"
    configured = configure(node.executable, _own_parameters(node), where)
    stage = configured.make()
    for kind in {topic.kind for topic in stage.inputs} | {topic.kind for topic in stage.outputs}:
        _named(where, partial(codec, kind))
    inputs = {node.resolve(i.topic): i for i in stage.inputs}
    outputs = {node.resolve(o.topic): o for o in stage.outputs}
    check_topics([*inputs, *outputs], where)
    return ResolvedStage(
        node,
        inputs,
        outputs,
        configured.settings,
        make_stage=configured.make,
        lateness=configured.runner.lateness,
        input_configs=configured.inputs,
    )


def resolve_driver(node: GraphNode) -> ResolvedDriver:
    """A driver of a graph, its scenario read; ValueError as for an estimator."""
    where = f"node {node.full_name}"
    config = build(DriverConfig, _own_parameters(node), where)
    scenario = _named(where, lambda: configured_scenario(config, node.base))
    source = _named(where, lambda: make_source(node.executable, scenario))
    outputs = {node.resolve(o.topic): o for o in source.outputs}
    file = find_scenario(config.scenario, node.base)
    return ResolvedDriver(node, {}, outputs, dataclasses.asdict(scenario), scenario=scenario, scenario_file=file)


def resolve_node(node: GraphNode) -> ResolvedNode:
    """Any node of a graph; of another package's node nothing is known but its entry."""
    if is_stage(node.executable):
        return resolve_stage(node)
    return resolve_driver(node) if node.executable in SOURCES else ResolvedNode(node)


def upstream_first(nodes: Sequence[N]) -> list[N]:
    """In the order of the data flow: nodes before those that they feed."""
    ordered: list[N] = []
    waiting = list(nodes)
    while waiting:
        pending = {topic for node in waiting for topic in node.outputs}
        free = [node for node in waiting if not pending & set(node.inputs)] or waiting  # a loop has no beginning
        ordered += free
        waiting = [node for node in waiting if node not in free]
    return ordered


def _own_parameters(node: GraphNode) -> dict[str, Any]:
    return own_parameters(node.params)


def _named(where: str, make: Callable[[], R]) -> R:
    try:
        return make()
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
