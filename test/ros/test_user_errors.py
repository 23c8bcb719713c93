"""What a user may get wrong ends in one sentence before any process starts; what only looks odd reaches the nodes."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from test.ros.conftest import LIMIT_S, uwloc
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.resources import resource

TRACKER = "nodes: [{executable: mooring_tracker, params: params.yaml}]"
OFFSET = "qos_overrides./mooring/a/offset.subscription"


def check_refused(
    folder: Path, graph: str, parameters: object, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """In this process: nothing is started."""
    (folder / "params.yaml").write_text(json.dumps({"/**": {"ros__parameters": parameters}}))
    (folder / "graph.yaml").write_text(graph)
    assert main(["launch", str(folder / "graph.yaml"), "--duration", "1"]) == 1
    text = capsys.readouterr().err
    assert sentence in text
    assert len(text.strip().splitlines()) == 1, text


def launch(folder: Path, graph: str, parameters: object, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    (folder / "params.yaml").write_text(json.dumps({"/**": {"ros__parameters": parameters}}))
    (folder / "graph.yaml").write_text(graph)
    return uwloc("launch", folder / "graph.yaml", "--duration", 1, *arguments)


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"mooring_ids": ["1"]}, "/mooring/1/offset is no topic of ROS: ids must be letters, digits and underscores"),
        ({"mooring_ids": ["a-b"]}, "/mooring/a-b/offset is no topic of ROS"),
        ({"mooring_ids": [""]}, "mooring_ids must be distinct names"),
        ({"mooring_ids": [1]}, "mooring_ids[0] must be a string, got 1"),
        ({"mooring_ids": []}, "mooring_ids must be distinct names, at least one"),
        ({"mooring_ids": None}, "mooring_ids must be a list of str, got 'null'"),
        ({"mooring_ids": ["a"], "mass": None}, "mass must be a number, got 'null'"),
        (
            {"mooring_ids": ["a"], f"{OFFSET}.reliability": "sometimes"},
            "reliability must be reliable, best_effort, got",
        ),
        ({"mooring_ids": ["a"], f"{OFFSET}.depth": "10"}, "depth must be a whole number (times in ns), got '10'"),
        ({"mooring_ids": ["a"], f"{OFFSET}.deapth": 10}, f"{OFFSET}.deapth must be qos_overrides.<topic>."),
        ({"mooring_ids": ["a"], OFFSET: 10}, f"{OFFSET}"),
        ({"mooring_ids": ["b"], f"{OFFSET}.depth": 10}, "the node has no topic /mooring/a/offset, only /clock"),
    ],
)
def test_a_bad_parameter(parameters: object, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check_refused(tmp_path, TRACKER, parameters, sentence, capsys)


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ("namespace: a-b", "namespace 'a-b' of node mooring_tracker must be letters, digits and underscores"),
        ("namespace: auv1/2", "namespace 'auv1/2' of node mooring_tracker must be"),
        ("name: möwe", "node name 'möwe' must be letters, digits and underscores"),
        ("remap: {a-b: c}", "remap of node mooring_tracker: 'a-b' must be"),
        ("remap: {mooring/a/offset: '*'}", "remap of node mooring_tracker: '*' must be"),
        ("params: gone.yaml", "gone.yaml cannot be read: No such file or directory"),
    ],
)
def test_a_bad_entry_of_a_graph(entry: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check_refused(tmp_path, f"nodes: [{{executable: mooring_tracker, {entry}}}]", {}, sentence, capsys)


def test_a_sonar_driver_without_a_sonar(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = yaml.safe_load((resource("config/harbour") / "scenario.yaml").read_text())
    del scenario["sonar"]
    (tmp_path / "dry.yaml").write_text(yaml.safe_dump(scenario))
    graph = "nodes: [{executable: sonar_driver, params: params.yaml}]"
    check_refused(tmp_path, graph, {"scenario": "dry.yaml"}, "node /sonar_driver: scenario has no sonar", capsys)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--params-file", "gone.yaml"), "gone.yaml"),
        (("--foo",), "--foo"),
        (("-p", "mooring_ids:=['1']"), "/mooring/1/offset is no topic of ROS"),
        (("-p", "mass:=[1, 2.5]"), "mass"),
        (("-r", "__ns:=/a-b"), "a-b"),
        (("-p", f"{OFFSET}.reliability:=sometimes"), "reliability must be reliable, best_effort, got 'sometimes'"),
    ],
)
def test_a_node_that_is_started_alone(domain: int, arguments: tuple[str, ...], sentence: str) -> None:
    command = [sys.executable, "-m", "uw_acoustic_loc.ros", "mooring_tracker", "--ros-args", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert sentence in done.stderr.strip().splitlines()[-1], "behind what rcl itself logs"


@pytest.mark.parametrize("name", ["20240601", "1e5", "dive #2", "reef: north", "[a", "{a", "*a", "yes", "é"])
def test_odd_names_reach_the_nodes_as_they_are(domain: int, name: str, tmp_path: Path) -> None:
    folder = tmp_path / name
    folder.mkdir()
    scenario = yaml.safe_load((resource("config/harbour") / "scenario.yaml").read_text())
    (folder / name).write_text(yaml.safe_dump(scenario))
    graph = "{clock_rate: 10.0, nodes: [{executable: buoy_driver, params: params.yaml}]}"
    done = launch(folder, graph, {"scenario": name}, "--record", folder / f"{name} bag")
    assert done.returncode == 0, done.stderr
    assert "/buoys/positions" in Bag(folder / f"{name} bag").topics


def test_a_scenario_of_1200_waypoints_is_recorded_with_its_configuration(domain: int, tmp_path: Path) -> None:
    scenario = yaml.safe_load((resource("config/harbour") / "scenario.yaml").read_text())
    scenario["vehicle"]["waypoints"] = [{"x": 20.0 * k, "y": 1e-7 * k} for k in range(1200)]
    (tmp_path / "long.yaml").write_text(yaml.safe_dump(scenario))
    graph = "{clock_rate: 10.0, nodes: [{executable: vehicle_driver, params: params.yaml}]}"
    done = launch(tmp_path, graph, {"scenario": "long.yaml"}, "--record", tmp_path / "bag")
    assert done.returncode == 0, done.stderr
    stored = json.loads(Bag(tmp_path / "bag").metadata["uw_acoustic_loc"]["config"])
    assert len(stored["/vehicle_driver"]["vehicle"]["waypoints"]) == 1200
