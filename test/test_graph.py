"""Graph files and params-files: names resolve as rcl resolves them, mistakes are one sentence."""

from pathlib import Path

import pytest

from uw_acoustic_loc.graph import load_graph
from uw_acoustic_loc.resolved_graph import resolve_node, upstream_first
from uw_acoustic_loc.resources import resource


def write(folder: Path, graph: str, params: str = "") -> Path:
    (folder / "params.yaml").write_text(params)
    (folder / "graph.yaml").write_text(graph)
    return folder / "graph.yaml"


def test_names_take_namespace_and_remaps(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        "nodes: [{executable: bearing, name: ears, namespace: auv2, remap: {odometry: /nav/odom, /x: y}}]",
    )
    node = load_graph(path).nodes[0]
    assert node.full_name == "/auv2/ears"
    assert node.resolve("odometry") == "/nav/odom"
    assert node.resolve("hydrophones/info") == "/auv2/hydrophones/info"
    assert node.resolve("/x") == "/auv2/y"
    assert node.resolve("~/sync") == "/auv2/ears/sync"


def test_params_sections_match_like_rcl(tmp_path: Path) -> None:
    params = """
/**: {ros__parameters: {seed: 1, lateness: 0.1}}
/auv1/toa_tracker: {ros__parameters: {seed: 2}}
auv1: {toa_tracker: {ros__parameters: {gate_sigma: 4.0}}}
/*/toa_tracker: {ros__parameters: {lateness: 0.2}}
"""
    node = load_graph(
        write(tmp_path, "nodes: [{executable: toa_tracker, namespace: auv1, params: params.yaml}]", params)
    ).nodes[0]
    assert node.params == {"seed": 2, "lateness": 0.2, "gate_sigma": 4.0}


@pytest.mark.parametrize(
    ("graph", "params", "sentence"),
    [
        ("nodes: [{executable: bearing, parms: x}]", "", "nodes[0]: unknown key 'parms', did you mean 'params'?"),
        ("nodes: [{executable: bearing}, {executable: bearing}]", "", "two nodes are named /bearing"),
        ("nodes: [{executable: bearing, params: no.yaml}]", "", "no.yaml cannot be read: No such file"),
        ("nodes: [", "", "is not valid YAML"),
        ("clock_rate: -1\nnodes: []", "", "clock_rate must be from 0 to 1000 x real time, got -1.0"),
        (
            "nodes: [{executable: bearing, params: params.yaml}]",
            "beering: {ros__parameters: {seed: 1}}",
            "section '/beering' is none of its nodes /bearing",
        ),
        (
            "nodes: [{executable: bearing, params: params.yaml}]",
            "bearing: {seed: 1}",
            "'/bearing/seed' must hold ros__parameters, got 1",
        ),
        ("nodes: [{executable: bearing, name: grün}]", "", "node name 'grün' must be letters"),
        ("nodes: [{executable: bearing, namespace: 1auv}]", "", "namespace '1auv' of node bearing must be letters"),
        ("nodes: [{executable: bearing, remap: {odometry: a b}}]", "", "remap of node bearing: 'a b' must be letters"),
        ("nodes: [{executable: bearing}]\nnodes: []", "", "line 2: key 'nodes' is there twice"),
        (
            "nodes: [{executable: bearing, params: params.yaml}]",
            "bearing: {ros__parameters: {seed: 1}}\nbearing: {ros__parameters: {seed: 2}}",
            "line 2: key 'bearing' is there twice",
        ),
        (
            "nodes: [{executable: bearing, params: params.yaml}]",
            "bearing: {ros__parameters: {seed: &s 1, b: *s}}",
            "an alias (*) must not be used",
        ),
    ],
)
def test_mistakes_are_one_sentence(tmp_path: Path, graph: str, params: str, sentence: str) -> None:
    with pytest.raises(ValueError) as caught:
        load_graph(write(tmp_path, graph, params))
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_harbour_graph_is_valid_and_ordered_along_the_data_flow() -> None:
    nodes = upstream_first([resolve_node(node) for node in load_graph(resource("config/harbour/graph.yaml")).nodes])
    order = [resolved.node.name for resolved in nodes]
    assert order.index("hydrophone_driver") < order.index("bearing") < order.index("bearing_slam")
    published = [topic for resolved in nodes for topic in resolved.outputs]
    assert len(published) == len(set(published)), "two nodes publish one topic"
    for resolved in nodes:
        assert set(resolved.inputs) <= set(published), f"{resolved.node.full_name} has an input that nobody publishes"
