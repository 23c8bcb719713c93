"""The recorder node: what it stores, what a kill and a full disk leave."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from test.ros.conftest import LIMIT_S, Bench, uwloc
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import deserialize
from uw_acoustic_loc.core.types import Point

TOPIC = "topics:=[/p geometry_msgs/msg/PointStamped]"


def record(bench: Bench, bag: Path) -> None:
    bench.start("recorder", "-p", f"bag:={bag}", "-p", TOPIC)


def publish(bench: Bench, count: int) -> None:
    for k in range(count):
        bench.publish("/p", Point(k + 1, np.zeros(3)))
        bench.executor.spin_once(timeout_sec=0.0)


def test_a_killed_recorder_leaves_all_but_the_last_second(bench: Bench, tmp_path: Path) -> None:
    record(bench, tmp_path / "bag")
    publish(bench, 300)
    bench.wait(lambda: bench.report("/recorder").recorded.get("/p") == 300, "all to be recorded")
    written = next((tmp_path / "bag").glob("*.mcap"))
    bench.wait(lambda: written.stat().st_size > 1500, "the recorder to flush")
    time.sleep(1.2)  # the last of them
    bench.report("/recorder")
    bench.stop("/recorder", signal.SIGKILL)
    bag = Bag(tmp_path / "bag")
    assert sum(1 for _ in bag.records(["/p"])) == 300
    assert len(bag.damage) == 1


def test_a_full_disk_ends_the_recording_with_a_sentence(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # shared memory is limited too: plain UDP instead
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    record(bench, tmp_path / "bag")
    process = bench.processes["/recorder"]
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (1500, 1500))
    publish(bench, 2000)
    assert process.wait(LIMIT_S) == 1
    _, text = bench.stop("/recorder")
    assert f"bag {tmp_path / 'bag'}: recording stopped: File too large; what was written is kept" in text
    assert "Traceback" not in text
    bag = Bag(tmp_path / "bag")
    stamps = [deserialize(record.data, record.msgtype).header.stamp.nanosec for record in bag.records()]
    assert stamps == list(range(1, len(stamps) + 1)), "what is kept is what came first"
    assert bag.damage == []


def test_a_recording_tells_how_it_was_made(domain: int, tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(
        "/**/buoy_driver: {ros__parameters: {scenario: harbour, seed: 3}}\n"
        "/**/mooring_tracker: {ros__parameters: {mooring_ids: [buoy1], mass: 2.5}}\n"
    )
    (tmp_path / "graph.yaml").write_text(
        "clock_rate: 5.0\nnodes:\n"
        "  - {executable: buoy_driver, params: params.yaml}\n"
        "  - {executable: mooring_tracker, params: params.yaml}\n"
    )
    done = uwloc("launch", tmp_path / "graph.yaml", "--record", tmp_path / "bag", "--duration", "3")
    assert done.returncode == 0, done.stderr
    stored = Bag(tmp_path / "bag").metadata["uw_acoustic_loc"]
    config = json.loads(stored["config"])
    assert stored["made_by"] == "recorder"
    assert config["/mooring_tracker"]["mass"] == 2.5
    assert config["/mooring_tracker"]["lateness"] == 0.5, "defaults are stored too"
    assert config["/buoy_driver"]["seed"] == 3
    assert "3" in stored["seed"].split(", ")


@pytest.mark.parametrize("about", ["[1]", "no JSON"])
def test_what_is_stored_must_be_texts(domain: int, about: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "uw_acoustic_loc.ros", "recorder", "--ros-args"]
    command += ["-p", f"bag:={tmp_path / 'bag'}", "-p", f"about:='{about}'"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False, env=os.environ)
    assert done.returncode == 1
    assert "about must be" in done.stderr
    assert "Traceback" not in done.stderr
