"""The clock's window follows from how long inputs wait for each other: a small lateness loses no order."""

from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message

from test.ros.conftest import uwloc
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.graph import load_graph
from uw_acoustic_loc.resolved_graph import resolve_node
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.ros.orchestrator.window import ordered_nodes, window_s

PARAMS = """
/**/vehicle_driver: {{ros__parameters: {{scenario: harbour}}}}
/**/hydrophone_driver: {{ros__parameters: {{scenario: harbour}}}}
/**/bearing:
  ros__parameters:
    source_ids: [a]
    band_low: [18000.0]
    band_high: [24000.0]
    lateness: {lateness}
"""
GRAPH = """
clock_rate: 40.0
nodes:
  - {executable: vehicle_driver, params: params.yaml}
  - {executable: hydrophone_driver, params: params.yaml}
  - {executable: bearing, params: params.yaml}
"""


def graph(folder: Path, lateness: float) -> Path:
    (folder / "params.yaml").write_text(PARAMS.format(lateness=lateness))
    (folder / "graph.yaml").write_text(GRAPH)
    return folder / "graph.yaml"


@pytest.mark.parametrize(("lateness", "window"), [(0.5, 0.25), (4.0, 0.25), (0.1, 0.05), (0.0, 0.0)])
def test_the_window_is_half_the_smallest_lateness(lateness: float, window: float, tmp_path: Path) -> None:
    wirings = [resolve_node(node) for node in load_graph(graph(tmp_path, lateness)).nodes]
    assert window_s(wirings) == window
    assert ordered_nodes(wirings) == {"/vehicle_driver", "/hydrophone_driver", "/bearing"}


def test_a_graph_without_an_order_to_lose_has_the_longest_window() -> None:
    nodes = load_graph(resource("config/harbour/graph.yaml")).nodes
    assert (
        window_s([resolve_node(node) for node in nodes if node.executable in ("buoy_driver", "mooring_tracker")])
        == 0.25
    )


def test_a_small_lateness_loses_no_input_of_two_drivers(domain: int, tmp_path: Path) -> None:
    arguments = ("launch", graph(tmp_path, 0.1), "--record", tmp_path / "bag", "--duration", 10)
    done = uwloc(*arguments)
    assert done.returncode == 0, done.stderr
    counts = {}
    for record in Bag(tmp_path / "bag").records(["/diagnostics"]):
        for status in deserialize_message(record.data, DiagnosticArray).status:
            if status.name == "/bearing":
                counts = {pair.key: pair.value for pair in status.values}
    assert int(counts["hydrophones/samples used"]) > 20
    assert {key: count for key, count in counts.items() if key.endswith(" late")} == {}
