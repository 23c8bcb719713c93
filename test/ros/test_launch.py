"""The orchestrator: nothing starts when anything is wrong; all of it runs, and nothing is left behind."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from test.ros.conftest import LIMIT_S, Bench, uwloc
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.core.types import Odometry
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.ros.orchestrator.shared_memory import SharedMemory

HARBOUR = resource("config/harbour")


def node_processes(marker: str) -> list[int]:
    """Processes of our nodes whose environment has the marker (this test's ROS domain)."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            environment, command = path.read_text(), (path.parent / "cmdline").read_text()
        except OSError:
            continue
        if marker in environment.split("\0") and "uw_acoustic_loc.ros" in command:
            found.append(int(path.parent.name))
    return found


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A graph of a driver and an estimator, following the harbour scenario."""
    (tmp_path / "params.yaml").write_text(
        "/**/buoy_driver: {ros__parameters: {scenario: harbour}}\n"
        "/**/mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}\n"
    )
    graph = tmp_path / "graph.yaml"
    graph.write_text(
        "clock_rate: 5.0\nnodes:\n"
        "  - {executable: buoy_driver, params: params.yaml}\n"
        "  - {executable: mooring_tracker, params: params.yaml}\n"
    )
    return graph


def test_a_graph_runs_is_recorded_and_leaves_nothing_behind(
    bench: Bench, domain: int, small: Path, tmp_path: Path
) -> None:
    memory = SharedMemory()
    done = uwloc("launch", small, "--record", tmp_path / "bag", "--duration", "10")
    assert done.returncode == 0, done.stderr
    counts = Counter(record.topic for record in Bag(tmp_path / "bag").records())
    # 20 periods of 0.5 s and 10 of 1 s, and the one at the very end or not
    assert counts["/mooring/buoy1/offset"] == counts["/mooring/buoy1/odometry"]
    assert 19 <= counts["/mooring/buoy1/offset"] <= 21
    assert 9 <= counts["/buoys/arrivals"] <= 11
    assert counts["/buoys/positions"] == 1
    assert counts["/diagnostics"] > 0
    assert node_processes(f"ROS_DOMAIN_ID={domain}") == []
    bench.wait(lambda: not memory.abandoned(), "shared memory of other tests, which run beside this one, to be cleaned")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            ("executable: mooring_tracker", "executable: moorings, name: mooring_tracker"),
            "executable 'moorings' of node /mooring_tracker is unknown",
        ),
        (("mooring_ids", "mooring_id"), "unknown key 'mooring_id', did you mean 'mooring_ids'?"),
        (("[buoy1]", "buoy1"), "mooring_ids must be a list of str, got 'buoy1'"),
        (("scenario: harbour", "scenario: harbor"), "scenario 'harbor' is neither a file below"),
        (("params: params.yaml", "params: parms.yaml"), "parms.yaml cannot be read: No such file or directory"),
    ],
)
def test_a_mistake_is_one_sentence_and_nothing_starts(
    domain: int, small: Path, change: tuple[str, str], sentence: str
) -> None:
    for file in (small, small.with_name("params.yaml")):
        file.write_text(file.read_text().replace(*change))
    done = uwloc("launch", small, "--duration", "1")
    assert done.returncode == 1
    assert sentence in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize(
    "arguments",
    [
        ("score", "no_such_bag"),
        ("process", "no_such_bag", "--graph", HARBOUR / "graph.yaml", "-o", "out"),
        ("replay", "no_such_bag", "--graph", HARBOUR / "graph.yaml", "-o", "out"),
        ("launch", "no_such_graph.yaml"),
        ("simulate", "no_such_scenario.yaml", "-o", "out"),
    ],
)
def test_a_missing_file_is_one_sentence(arguments: tuple[str | Path, ...]) -> None:
    done = uwloc(*arguments)
    assert done.returncode == 1
    assert "no_such_" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_killed_node_is_started_again_and_the_exit_code_tells(bench: Bench, domain: int, small: Path) -> None:
    command = [sys.executable, "-m", "uw_acoustic_loc", "launch", str(small)]
    launcher = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    estimates = bench.received["/mooring/buoy1/odometry"]
    try:
        bench.listen("/mooring/buoy1/odometry", Odometry)
        bench.wait(lambda: len(estimates) > 3, "estimates")
        victim = tracker(domain)
        assert victim is not None
        os.kill(victim, signal.SIGKILL)
        bench.wait(lambda: tracker(domain) not in (None, victim), "a new process", limit_s=2.0)
        before = len(estimates)
        bench.wait(lambda: len(estimates) > before + 3, "estimates of the new process")
        launcher.send_signal(signal.SIGINT)
        _, text = launcher.communicate(timeout=LIMIT_S)
    finally:
        launcher.kill()
    assert launcher.returncode == 1
    assert "was ended by SIGKILL, starting it again" in text
    assert "/mooring_tracker had to be started again 1 times" in text
    assert node_processes(f"ROS_DOMAIN_ID={domain}") == []


def test_nodes_do_not_outlive_a_killed_launcher(bench: Bench, domain: int, small: Path) -> None:
    launcher = subprocess.Popen(
        [sys.executable, "-m", "uw_acoustic_loc", "launch", str(small)], stderr=subprocess.DEVNULL
    )
    bench.wait(lambda: len(node_processes(f"ROS_DOMAIN_ID={domain}")) == 2, "two node processes")
    launcher.kill()
    launcher.wait()
    bench.wait(lambda: not node_processes(f"ROS_DOMAIN_ID={domain}"), "their end")


def tracker(domain: int) -> int | None:
    """The mooring tracker's process."""
    for pid in node_processes(f"ROS_DOMAIN_ID={domain}"):
        try:
            if "mooring_tracker" in Path(f"/proc/{pid}/cmdline").read_text():
                return pid
        except OSError:
            continue
    return None


@pytest.mark.parametrize("delay_s", [0.01, 0.3, 0.7, 1.2, 1.8, 2.5])
def test_an_early_interrupt_ends_all_without_a_traceback(domain: int, delay_s: float, small: Path) -> None:
    command = [sys.executable, "-m", "uw_acoustic_loc", "launch", str(small)]
    launcher = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    while "yaml" not in Path(f"/proc/{launcher.pid}/maps").read_text():  # before, the interpreter itself is starting
        time.sleep(0.001)
    time.sleep(delay_s)  # the instant itself is what is tried
    launcher.send_signal(signal.SIGINT)
    _, text = launcher.communicate(timeout=LIMIT_S)
    assert "Traceback" not in text
    assert launcher.returncode in (0, 130, -signal.SIGINT)
    assert node_processes(f"ROS_DOMAIN_ID={domain}") == []
