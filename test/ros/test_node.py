"""The adapter, on the mooring tracker: parameters, refusals, diagnostics, a clean end."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, SetParameters

from test.ros.conftest import LIMIT_S, Bench
from uw_acoustic_loc.core.types import Odometry, Point
from uw_acoustic_loc.ros.rclpy_messages import RosMake
from uw_acoustic_loc.wire.codec import codec

SECOND = 1_000_000_000
START = 1_780_272_000 * SECOND
PARAMS = "/**: {ros__parameters: {mooring_ids: [m1], filter: kalman}}"


def offset(k: int, value: float, frame: str = "map") -> Point:
    return Point(START + k * SECOND // 2, np.array([value, 0.0, 0.0]), frame)


def test_measurements_go_in_and_estimates_come_out(bench: Bench, tmp_path: Path) -> None:
    name = bench.start("mooring_tracker", params=PARAMS, folder=tmp_path)
    bench.listen("/mooring/m1/odometry", Odometry)
    for k in range(20):
        bench.publish("/mooring/m1/offset", offset(k, 1.0))
    bench.wait(lambda: len(bench.received["/mooring/m1/odometry"]) >= 19, "estimates")
    bench.report(name, finish=True)
    bench.wait(lambda: len(bench.received["/mooring/m1/odometry"]) == 20, "the last estimate")
    stamps = [value.t_ns for value in bench.received["/mooring/m1/odometry"]]
    assert stamps == [START + k * SECOND // 2 for k in range(20)], "an estimate has its measurement's stamp"
    code, text = bench.stop(name)
    assert code == 0
    assert "Traceback" not in text


def test_what_is_malformed_is_counted_and_named_in_diagnostics(bench: Bench, tmp_path: Path) -> None:
    name = bench.start("mooring_tracker", params=PARAMS, folder=tmp_path)
    seen: dict[str, str] = {}

    def note(message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == name:
                seen.update({pair.key: pair.value for pair in status.values})

    bench.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
    topic, form = "/mooring/m1/offset", codec(Point)
    bench.publish(topic, offset(0, 1.0))
    bench.publish(topic, offset(1, float("nan")))
    bench.publish(topic, offset(2, 1.0, frame="odom"))
    bench.publish_message(topic, form.msgtype, form.encode(RosMake(), Point(0, np.zeros(3), "map")))
    bench.publish_message(topic, form.msgtype, b"\0\1\0\0no such message")
    bench.publish(topic, offset(3, 1.0))
    key = "mooring/m1/offset malformed"
    bench.wait(lambda: seen.get(key) == "4" and seen.get("mooring/m1/offset received") == "6", "diagnostics")
    assert bench.processes[name].poll() is None, "the node lives"


def test_a_driver_that_is_told_to_finish_sends_no_more(bench: Bench) -> None:
    name = bench.start("buoy_driver")
    bench.wait(lambda: bench.report(name).sent["/mooring/buoy1/offset"].count > 2, "offsets, two per second")
    sent, begun = bench.report(name, finish=True).sent, time.monotonic()
    bench.wait(lambda: time.monotonic() > begun + 1.2, "what else it may send")
    assert bench.report(name).sent == sent


def test_a_node_that_is_held_up_catches_up_and_loses_nothing(bench: Bench, tmp_path: Path) -> None:
    name = bench.start("mooring_tracker", params=PARAMS, folder=tmp_path)
    topic = "/mooring/m1/offset"
    bench.publish(topic, offset(0, 1.0))
    bench.processes[name].send_signal(signal.SIGSTOP)
    for k in range(1, 800):  # more than what DDS holds in shared memory
        bench.publish(topic, offset(k, 1.0))
    bench.processes[name].send_signal(signal.SIGCONT)
    bench.wait(lambda: bench.report(name).taken[topic].count == 800, "all messages")
    assert bench.report(name, finish=True).counts["mooring/m1/offset"]["used"] == 800


def test_parameters_are_declared_with_unit_and_checked_when_changed(bench: Bench, tmp_path: Path) -> None:
    bench.start("mooring_tracker", params=PARAMS, folder=tmp_path)
    request = DescribeParameters.Request(names=["mass"])
    described = bench.call(DescribeParameters, "/mooring_tracker/describe_parameters", request).descriptors[0]
    assert "kg" in described.description
    fixed = Parameter(name="filter", value=ParameterValue(type=4, string_value="particle"))
    answer = bench.call(SetParameters, "/mooring_tracker/set_parameters", SetParameters.Request(parameters=[fixed]))
    assert not answer.results[0].successful
    assert "filter" in answer.results[0].reason


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        ("mas:=2.0", "node /mooring_tracker: unknown key 'mas', did you mean 'mass'?"),
        ("mass:=heavy", "node /mooring_tracker: mass must be a number, got 'heavy'"),
        ("filter:=ukf", "node /mooring_tracker: filter must be one of"),
    ],
)
def test_a_bad_parameter_is_one_sentence_and_exit_code_1(bench: Bench, argument: str, sentence: str) -> None:
    import subprocess
    import sys

    command = [sys.executable, "-m", "uw_acoustic_loc.ros", "mooring_tracker", "--ros-args", "-p", argument]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 1
    assert sentence in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_driver_cleanly(bench: Bench, number: int) -> None:
    name = bench.start("sonar_driver", "-p", "use_sim_time:=true")
    code, text = bench.stop(name, number)
    assert (code, "Traceback" in text) == (0, False)
