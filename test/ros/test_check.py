"""The small bags through live nodes, checked with the program that users' own tests call."""

from pathlib import Path

from test.ros.conftest import uwloc

REPO = Path(__file__).parents[2]
HARBOUR = REPO / "bags" / "harbour"


def test_live_nodes_say_what_is_expected_of_the_harbour_bag(domain: int, tmp_path: Path) -> None:
    graph = REPO / "config" / "harbour" / "graph.yaml"
    done = uwloc("replay", HARBOUR, "--graph", graph, "-o", tmp_path / "out", "--rate", "0")
    assert done.returncode == 0, done.stderr
    found = uwloc("check", tmp_path / "out", HARBOUR / "expected.yaml")
    assert found.returncode == 0, found.stderr
    assert "FAIL" not in found.stdout


def test_a_node_that_is_missing_is_found_out(domain: int, tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text("mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}")
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: mooring_tracker, params: params.yaml}]")
    done = uwloc("replay", HARBOUR, "--graph", tmp_path / "graph.yaml", "-o", tmp_path / "out", "--rate", "0")
    assert done.returncode == 0, done.stderr
    found = uwloc("check", tmp_path / "out", HARBOUR / "expected.yaml")
    assert found.returncode == 1
    assert "/sonar/fix must be in the bag, got nothing of that name" in found.stderr
    assert "mooring" not in found.stderr
