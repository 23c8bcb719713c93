"""Graph files and ROS params-files: which nodes run, with which parameters and names, all checked before use."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .config import build, param
from .yaml_file import load_yaml

_TOKEN = "[A-Za-z_][A-Za-z0-9_]*"
_LETTERS = "letters, digits and underscores, and not begin with a digit"


@dataclass(frozen=True)
class NodeEntry:
    """A node as the graph file writes it."""

    executable: str = param(doc="one of ours, or package/executable")
    name: str = param("", doc="default: the executable's name")
    namespace: str = param("")
    params: str = param("", doc="ROS params-file, relative to the graph file")
    remap: Mapping[str, str] | None = param(None)


@dataclass(frozen=True)
class GraphFile:
    """The graph file's content."""

    nodes: tuple[NodeEntry, ...] = param()
    clock_rate: float = param(0.0, unit="x real time", low=0.0, high=1000.0, doc="0 = no /clock")


@dataclass(frozen=True)
class GraphNode:
    """A node with all names resolved."""

    executable: str
    name: str
    namespace: str  # starts with "/"
    params_file: Path | None
    remap: Mapping[str, str]
    params: Mapping[str, Any]

    @property
    def base(self) -> Path:
        """The folder from which the node's relative paths are taken."""
        return self.params_file.parent if self.params_file else Path()

    @property
    def full_name(self) -> str:
        """The name with its namespace, for example `/auv1/bearing`."""
        return f"{self.namespace.rstrip('/')}/{self.name}"

    def resolve(self, topic: str) -> str:
        """Returns the topic's name in the graph: namespace and remappings are applied as rcl does."""
        renamed = {self._absolute(old): self._absolute(new) for old, new in self.remap.items()}
        return renamed.get(self._absolute(topic), self._absolute(topic))

    def _absolute(self, topic: str) -> str:
        if topic.startswith("~/"):
            return f"{self.full_name}/{topic[2:]}"
        return topic if topic.startswith("/") else f"{self.namespace.rstrip('/')}/{topic}"


@dataclass(frozen=True)
class Graph:
    """All nodes of a graph file."""

    path: Path
    nodes: tuple[GraphNode, ...]
    clock_rate: float


def load_graph(path: Path) -> Graph:
    """Reads a graph file and the params-files that it names.

    Raises:
        ValueError: one sentence naming the file, the key and what is allowed.
    """
    content = build(GraphFile, load_yaml(path, "graph"), f"graph {path}")
    nodes = tuple(_node(entry, path) for entry in content.nodes)
    seen: set[str] = set()
    for node in nodes:
        if node.full_name in seen:
            raise ValueError(f"graph {path}: two nodes are named {node.full_name}, give one another name or namespace")
        seen.add(node.full_name)
    for file in {node.params_file for node in nodes if node.params_file}:
        _check_sections(file, nodes)
    return Graph(path, nodes, content.clock_rate)


def _node(entry: NodeEntry, graph: Path) -> GraphNode:
    name = entry.name or entry.executable.split("/")[-1]
    if not re.fullmatch(_TOKEN, name):
        raise ValueError(f"graph {graph}: node name '{name}' must be {_LETTERS}")
    namespace = "/" + entry.namespace.strip("/")
    if not (namespace == "/" or _is_topic(namespace)):
        raise ValueError(f"graph {graph}: namespace '{entry.namespace}' of node {name} must be {_LETTERS}")
    for topic in (text for pair in (entry.remap or {}).items() for text in pair):
        if not _is_topic(f"/{topic.removeprefix('~').removeprefix('/')}"):
            raise ValueError(f"graph {graph}: remap of node {name}: '{topic}' must be {_LETTERS}, with '/' between")
    file = graph.parent / entry.params if entry.params else None
    full_name = f"{namespace.rstrip('/')}/{name}"
    params = params_of(file, full_name) if file else {}
    return GraphNode(entry.executable, name, namespace, file, entry.remap or {}, params)


def check_topics(names: Iterable[str], where: str) -> None:
    """Raises ValueError for a full topic name that ROS would not take."""
    for name in names:
        if not _is_topic(name):
            raise ValueError(f"{where}: {name} is no topic of ROS: ids must be {_LETTERS}")


def _is_topic(name: str) -> bool:
    return re.fullmatch(f"(/{_TOKEN})+", name) is not None


def own_parameters(params: Mapping[str, Any]) -> dict[str, Any]:
    """Without those of every ROS node, which are rclpy's business."""
    return {
        key: value for key, value in params.items() if key not in _OF_RCLPY and not key.startswith("qos_overrides.")
    }


_OF_RCLPY = ("use_sim_time", "start_type_description_service")


def params_of(file: Path, full_name: str) -> dict[str, Any]:
    """Returns the parameters that a params-file gives to a node; later sections win, as in rcl."""
    params: dict[str, Any] = {}
    for pattern, values in _sections(file):
        if _matches(pattern, full_name):
            params |= values
    return params


def check_params_file(file: Path) -> None:
    """Raises a ValueError with one sentence for a params-file that cannot be read."""
    _sections(file)


def _sections(file: Path) -> list[tuple[str, Mapping[str, Any]]]:
    """Returns node name patterns with their parameters, as in the file; nested namespaces are joined with slashes."""
    content = load_yaml(file, "params-file", of_node=True)
    found: list[tuple[str, Mapping[str, Any]]] = []

    def visit(prefix: str, level: Any) -> None:
        if not isinstance(level, Mapping):
            raise ValueError(f"params-file {file}: '{prefix or '/'}' must hold ros__parameters, got {level!r}")
        for key, value in level.items():
            if key == "ros__parameters":
                if not isinstance(value, Mapping):
                    raise ValueError(f"params-file {file}: '{prefix}' ros__parameters must be a mapping, got {value!r}")
                if not prefix:
                    raise ValueError(f"params-file {file}: ros__parameters must stand below the name of a node")
                found.append((prefix, _flat(value, file)))
            else:
                visit(f"{prefix}/{key.strip('/')}", value)

    visit("", {} if content is None else content)
    return found


def _flat(values: Mapping[str, Any], file: Path, prefix: str = "") -> dict[str, Any]:
    """Joins the keys of nested parameter mappings by dots, as rcl does."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            if not value:
                raise ValueError(f"params-file {file}: parameter '{prefix}{key}' must have a value, got {{}}")
            flat |= _flat(value, file, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _matches(pattern: str, full_name: str) -> bool:
    """Matches as rcl does: `/**` is any number of names, `/*` one; a bare name is a node of the root namespace."""
    tokens = re.split(r"(/\*\*|/\*)", pattern)
    expression = "".join({"/**": r"(/\w+)*", "/*": r"/\w+"}.get(token, re.escape(token)) for token in tokens)
    return re.fullmatch(expression, full_name) is not None


def _check_sections(file: Path, nodes: tuple[GraphNode, ...]) -> None:
    """Refuses sections for no node: a misspelt node name would silently leave a node at its defaults."""
    users = sorted(node.full_name for node in nodes if node.params_file == file)
    for pattern, _ in _sections(file):
        if not any(_matches(pattern, name) for name in users):
            raise ValueError(f"params-file {file}: section '{pattern}' is none of its nodes {', '.join(users)}")
