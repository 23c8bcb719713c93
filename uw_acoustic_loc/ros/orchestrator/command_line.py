"""The command line of each node's process."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...bag.about import about_graph
from ...graph import GraphNode
from ...resolved_graph import ResolvedDriver, ResolvedNode, ResolvedStage
from ...sim.catalog import SOURCES
from ...stages.catalog import is_stage, stage_names
from ...wire.codec import codec

_PROGRAM = str(__package__).rpartition(".")[0]  # python -m
RECORDER = "/recorder"  # its full name
LEAD_S = 15  # without /clock all drivers start together, when the slowest of them is up


def command_line(node: GraphNode, graph: Path, parameters: Sequence[str]) -> list[str]:
    """Program and ROS arguments of a node, `parameters` among them.

    Raises:
        ValueError: the executable is unknown.
    """
    arguments = ["--ros-args", "--disable-external-lib-logs"]
    for old, new in {"__node": node.name, "__ns": node.namespace, **node.remap}.items():
        arguments += ["-r", f"{old}:={new}"]
    return [*_program(node, graph), *arguments, *parameters]


def parameters(resolved: ResolvedNode, sim_time: bool, folder: Path) -> list[str]:
    """The arguments that give a node its parameters: a file in `folder`, with every value as it has been checked.

    The user's file goes to another package's node alone, whose parameters nobody here knows.
    """
    node = resolved.node
    if not is_ours(node.executable):
        given = ["--params-file", str(node.params_file)] if node.params_file else []
        return [*given, "-p", f"use_sim_time:={str(sim_time).lower()}"]
    values = {**node.params, "use_sim_time": sim_time}
    if isinstance(resolved, ResolvedStage):  # [1, 2.5] is [1.0, 2.5]: ROS knows no mixed lists
        values |= {key: resolved.settings[key] for key in node.params if key in resolved.settings}
    if isinstance(resolved, ResolvedDriver):
        values["scenario"] = str(resolved.scenario_file)
        values |= {} if sim_time else {"start_time": int(time.time()) + LEAD_S}
    file = folder / f"{node.full_name.strip('/').replace('/', '.')}.yaml"
    file.write_text(parameter_text(node.full_name, values))
    return ["--params-file", str(file)]


def parameter_text(name: str, values: Mapping[str, Any]) -> str:
    """A ROS params-file for one node. JSON is YAML in which no text can be taken for a number, a date or a list.

    An empty list, which has no type for ROS, is left out: it is the default wherever one is allowed.
    """
    kept = {key: value for key, value in values.items() if not isinstance(value, list | tuple) or len(value)}
    return json.dumps({name: {"ros__parameters": kept}}, ensure_ascii=False)


def recorder_node(bag: Path, nodes: Sequence[ResolvedNode], resume: bool) -> GraphNode:
    """The recorder of all that a graph publishes. With other packages' nodes in it, it records whatever appears."""
    outputs = {topic: output for node in nodes for topic, output in node.outputs.items()}
    params: dict[str, Any] = {"bag": str(bag), "about": json.dumps(about_graph(nodes)), "resume": resume}
    if all(is_ours(node.node.executable) for node in nodes):
        pairs = [f"{topic} {codec(output.kind).msgtype}" for topic, output in outputs.items()]
        params["topics"] = [*pairs, "/diagnostics diagnostic_msgs/msg/DiagnosticArray"]
        params["latched"] = [topic for topic, output in outputs.items() if output.latched]
    return GraphNode("recorder", RECORDER.strip("/"), "/", None, {}, params)


def _program(node: GraphNode, graph: Path) -> list[str]:
    if is_ours(node.executable):
        return [sys.executable, "-m", _PROGRAM, node.executable]
    package, _, executable = node.executable.partition("/")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        path = Path(prefix, "lib", package, executable)
        if executable and prefix and path.is_file():
            return [str(path)]
    raise ValueError(
        f"graph {graph}: executable '{node.executable}' of node {node.full_name} is unknown: it must be one of"
        f" {', '.join([*SOURCES, *stage_names(), 'recorder', 'player'])}, or package/executable of an installed ROS 2"
        " package"
    )


def is_ours(executable: str) -> bool:
    """Whether this package runs it, if only with another package's stage."""
    return executable in SOURCES or executable in ("recorder", "player") or is_stage(executable)
