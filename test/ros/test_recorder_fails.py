"""A recorder that is killed, or whose disk is full: estimators and bag go on, a replay fails."""

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from test.ros.conftest import LIMIT_S, Bench
from test.ros.test_launch import node_processes
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.core.types import Odometry

REPO = Path(__file__).parents[2]
PARAMS = (
    "/**/buoy_driver: {ros__parameters: {scenario: harbour}}\n"
    "/**/mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}\n"
)
GRAPH = (
    "clock_rate: 5.0\nnodes:\n"
    "  - {executable: buoy_driver, params: params.yaml}\n"
    "  - {executable: mooring_tracker, params: params.yaml}\n"
)


def write_graph(folder: Path) -> Path:
    (folder / "params.yaml").write_text(PARAMS)
    (folder / "graph.yaml").write_text(GRAPH)
    return folder / "graph.yaml"


def recorder(domain: int) -> int | None:
    """The recorder's process."""
    for pid in node_processes(f"ROS_DOMAIN_ID={domain}"):
        if "recorder" in Path(f"/proc/{pid}/cmdline").read_text().split("\0"):
            return pid
    return None


def killed(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)


def with_a_full_disk(pid: int) -> None:
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (1500, 1500))


@pytest.mark.parametrize("fail", [killed, with_a_full_disk])
def test_a_vehicle_goes_on_and_the_bag_gets_another_file(
    bench: Bench, domain: int, fail: Callable[[int], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")  # a limit of file sizes holds for shared memory too
    bag, said = tmp_path / "bag", list[DiagnosticStatus]()
    command = [sys.executable, "-m", "uw_acoustic_loc", "launch", str(write_graph(tmp_path)), "--record", str(bag)]
    bench.node.create_subscription(DiagnosticArray, "/diagnostics", lambda m: said.extend(m.status), 100)
    launcher = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    estimates = bench.received["/mooring/buoy1/odometry"]
    try:
        bench.listen("/mooring/buoy1/odometry", Odometry)
        bench.wait(lambda: len(estimates) > 20, "estimates")
        pid = recorder(domain)
        assert pid is not None
        fail(pid)
        bench.wait((bag / "bag_1.mcap").exists, "a new file of the bag")
        before = len(estimates)
        bench.wait(lambda: len(estimates) > before + 50, "estimates after that")
        bench.wait(lambda: any(s.level == DiagnosticStatus.ERROR and "/recorder" in s.message for s in said), "ERROR")
        launcher.send_signal(signal.SIGINT)
        _, text = launcher.communicate(timeout=LIMIT_S)
    finally:
        launcher.kill()
    assert launcher.returncode == 1
    assert "/recorder had to be started again" in text
    found = Bag(bag)
    stamps = [record.t_ns for record in found.records(["/mooring/buoy1/odometry"])]
    assert [file.name for file in found.files] == ["bag_0.mcap", "bag_1.mcap"]
    assert stamps == sorted(stamps)
    assert len(stamps) > 30, "of both files"


def test_a_replay_fails_when_its_recorder_is_killed(domain: int, tmp_path: Path) -> None:
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: toa_tracker}]")
    given = ("replay", REPO / "bags" / "harbour", "--graph", tmp_path / "graph.yaml", "-o", tmp_path / "out")
    command = [sys.executable, "-m", "uw_acoustic_loc", *map(str, given)]
    launcher = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert launcher.stderr is not None
        for line in launcher.stderr:
            if "nodes are ready" in line:
                break
        pid = recorder(domain)
        assert pid is not None
        killed(pid)
        _, text = launcher.communicate(timeout=2 * LIMIT_S)
    finally:
        launcher.kill()
    assert launcher.returncode == 1
    assert "/recorder was ended by SIGKILL: stopping" in text


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_driver_stops_at_once_whose_reader_is_dead(bench: Bench, number: int, tmp_path: Path) -> None:
    bench.start("recorder", "-p", f"bag:={tmp_path / 'bag'}")
    name = bench.start("buoy_driver")
    bench.wait(lambda: "/recorder" in bench.report(name).sent["/mooring/buoy1/offset"].readers, "a reader")
    bench.stop("/recorder", signal.SIGKILL)
    before = bench.report(name).sent["/mooring/buoy1/offset"].count
    bench.wait(lambda: bench.report(name).sent["/mooring/buoy1/offset"].count > before + 2, "what nobody takes")
    begun = time.monotonic()
    code, text = bench.stop(name, number)
    assert time.monotonic() - begun < 4.0, "1 s, and the end of an interpreter on a busy machine"
    assert (code, "Traceback" in text) == (0, False)
