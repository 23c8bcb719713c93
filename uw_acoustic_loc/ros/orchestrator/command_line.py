"""The command line of each node's process."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...bag.about import about_graph
from ...graph import GraphNode
from ...resolved_graph import ResolvedDriver, ResolvedNode
from ...sim.catalog import SOURCES
from ...stages.catalog import is_stage, stage_names
from ...wire.codec import codec

_PROGRAM = str(__package__).rpartition(".")[0]  # python -m
RECORDER = "/recorder"  # its full name
LEAD_S = 15  # without /clock all drivers start together, when the slowest of them is up


def command_line(node: GraphNode, graph: Path, sim_time: bool, driver: ResolvedDriver | None) -> list[str]:
    """Program and ROS arguments of a node.

    Raises:
        ValueError: the executable is unknown.
    """
    arguments = [
        "--ros-args",
        "--disable-external-lib-logs",
        "-r",
        f"__node:={node.name}",
        "-r",
        f"__ns:={node.namespace}",
    ]
    for old, new in node.remap.items():
        arguments += ["-r", f"{old}:={new}"]
    overrides: dict[str, Any] = {"use_sim_time": str(sim_time).lower()}
    if node.params_file:
        arguments += ["--params-file", str(node.params_file)]
    else:  # made here, not read from a file
        overrides |= node.params
    if driver:
        overrides["scenario"] = driver.scenario_file
        overrides |= {} if sim_time else {"start_time": int(time.time()) + LEAD_S}
    for key, value in overrides.items():
        arguments += ["-p", f"{key}:={value}"]
    return _program(node, graph) + arguments


def recorder_node(bag: Path, wirings: Sequence[ResolvedNode]) -> GraphNode:
    """The recorder of all that a graph publishes. With other packages' nodes in it, it records whatever appears."""
    outputs = [(topic, output) for wiring in wirings for topic, output in wiring.outputs.items()]
    pairs = [f"{topic} {codec(output.kind).msgtype}" for topic, output in outputs]
    pairs.append("/diagnostics diagnostic_msgs/msg/DiagnosticArray")
    latched = [topic for topic, output in outputs if output.latched]
    about = json.dumps(about_graph(wirings))
    params: dict[str, Any] = {"bag": bag, "about": json.dumps(about)}  # as YAML: a string in double quotes
    if all(_ours(wiring.node.executable) for wiring in wirings):
        params |= {"topics": f"[{', '.join(pairs)}]"}
        params |= {"latched": f"[{', '.join(latched)}]"} if latched else {}
    return GraphNode("recorder", RECORDER.strip("/"), "/", None, {}, params)


def _program(node: GraphNode, graph: Path) -> list[str]:
    if _ours(node.executable):
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


def _ours(executable: str) -> bool:
    """Whether this package runs it, if only with another package's stage."""
    return executable in SOURCES or executable in ("recorder", "player") or is_stage(executable)
