"""The whole graph, live: every section of the score is there, and the numbers are those of the offline run."""

import json
from pathlib import Path

import numpy as np
import yaml

from test.ros.conftest import uwloc
from test.ros.test_replay import messages
from uw_acoustic_loc.resources import resource

HARBOUR = resource("config/harbour")
SECONDS = 20.0
SECTIONS = {"bearing", "localizer", "slam", "toa", "multistatic", "mooring", "latency"}


def test_the_live_graph_gives_what_the_offline_run_gives(domain: int, tmp_path: Path) -> None:
    for file in HARBOUR.glob("*.yaml"):
        (tmp_path / file.name).write_text(file.read_text())
    scenario = yaml.safe_load((tmp_path / "scenario.yaml").read_text()) | {"duration": SECONDS, "seed": 5}
    (tmp_path / "scenario.yaml").write_text(yaml.safe_dump(scenario))
    graph = tmp_path / "graph.yaml"
    launched = uwloc("launch", graph, "--record", tmp_path / "live", "--duration", SECONDS, limit_s=240.0)
    assert launched.returncode == 0, launched.stderr
    processed = uwloc("process", tmp_path / "live", "--graph", graph, "-o", tmp_path / "offline")
    assert processed.returncode == 0, processed.stderr

    live, offline = messages(tmp_path / "live"), messages(tmp_path / "offline")
    assert {"/auv1/slam/odometry", "/target/odometry", "/sonar/fix", "/mooring/buoy1/odometry"} < set(offline)
    for topic, values in offline.items():
        np.testing.assert_equal(live[topic], values, err_msg=topic)

    scored = uwloc("score", tmp_path / "live", "--json")
    assert scored.returncode == 0, scored.stderr
    assert set(json.loads(scored.stdout)) == SECTIONS
    assert "NaN" not in scored.stdout
