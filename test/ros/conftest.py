"""Real node processes over DDS: started, fed and stopped. Every test has a ROS domain of its own."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from uw_acoustic_loc.ros.orchestrator.shared_memory import SharedMemory
from uw_acoustic_loc.ros.qos import qos
from uw_acoustic_loc.ros.rclpy_messages import RosMake, message_class
from uw_acoustic_loc.ros.report import NodeReport
from uw_acoustic_loc.ros.sync import SyncClient, call
from uw_acoustic_loc.wire.codec import codec

WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
DOMAINS = itertools.cycle(range(1 + 25 * (WORKER % 4), 25 + 25 * (WORKER % 4)))
LIMIT_S = 30.0  # discovery takes milliseconds, or seconds on a loaded machine


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """A ROS domain that no other test of this run uses at the same time."""
    number = next(DOMAINS)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    return number


class Bench:
    """A node of the test's own, and the processes of the nodes under test."""

    def __init__(self) -> None:
        self._memory = SharedMemory()
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("bench")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self.received: dict[str, list[Any]] = defaultdict(list)
        self._publishers: dict[str, Any] = {}

    def start(self, executable: str, *arguments: str, params: str = "", folder: Path | None = None) -> str:
        """Starts a node and waits until it answers; returns its full name."""
        command = [sys.executable, "-m", "uw_acoustic_loc.ros", executable, "--ros-args", *arguments]
        if params:
            assert folder is not None
            file = folder / f"{executable}.yaml"
            file.write_text(params)
            command += ["--params-file", str(file)]
        self.processes[f"/{executable}"] = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self.sync = SyncClient(self.node, self.executor, [f"/{executable}"])
        self.wait(lambda: not self.sync.waiting_for(), f"{executable} to answer")
        return f"/{executable}"

    def publish(self, topic: str, value: Any) -> None:
        """Publishes a core value; waits for a reader the first time."""
        form = codec(type(value))
        self.publish_message(topic, form.msgtype, form.encode(RosMake(), value))

    def publish_message(self, topic: str, msgtype: str, message: Any, latched: bool = False) -> None:
        """Publishes a message."""
        if topic not in self._publishers:
            publisher = self.node.create_publisher(message_class(msgtype), topic, qos(latched))
            self._publishers[topic] = publisher
            self.wait(lambda: publisher.get_subscription_count() > 0, f"a reader of {topic}")
            self.wait(lambda: self._heard(topic), f"{topic} to be heard")
        self._publishers[topic].publish(message)

    def latch(self, topic: str, value: Any) -> None:
        """Publishes a core value that stays."""
        form = codec(type(value))
        self.publish_message(topic, form.msgtype, form.encode(RosMake(), value), latched=True)

    def _heard(self, topic: str) -> bool:
        """Whether the nodes that subscribe see the writer too: each side discovers the other on its own."""
        return all(report.taken[topic].writers for report in self._reports() if topic in report.taken)

    def _reaches(self, topic: str) -> bool:
        """Whether the nodes that publish see the reader too."""
        return all(report.sent[topic].readers for report in self._reports() if topic in report.sent)

    def _reports(self) -> list[NodeReport]:
        names = list(self.processes)
        reports = self.sync.ask(names, finish=False, timeout_s=LIMIT_S) if names else {}
        return [reports[name] for name in names]

    def listen(self, topic: str, kind: type) -> None:
        """Collects core values in `received`; waits for the writer."""
        form = codec(kind)
        subscription = self.node.create_subscription(
            message_class(form.msgtype),
            topic,
            lambda message: self.received[topic].append(form.decode(message, 0)),
            qos(latched=False),
        )
        self.wait(lambda: subscription.get_publisher_count() > 0, f"a writer of {topic}")
        self.wait(lambda: self._reaches(topic), f"{topic} to reach the bench")

    def wait(self, good: Callable[[], bool], what: str, limit_s: float = LIMIT_S) -> None:
        """Spins until something is true."""
        end = time.monotonic() + limit_s
        while not good():
            assert time.monotonic() < end, f"waited {limit_s:g} s for {what}"
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """A service's answer."""
        client = self.node.create_client(kind, service)
        self.wait(client.service_is_ready, service)
        return call({service: client}, request, self.executor, LIMIT_S)[service]

    def report(self, name: str, finish: bool = False) -> NodeReport:
        """What a node says of itself over `~/sync`."""
        return self.sync.ask([name], finish, LIMIT_S)[name]

    def stop(self, name: str, number: int = signal.SIGTERM) -> tuple[int, str]:
        """Ends a node; returns its exit code and what it wrote to stderr."""
        process = self.processes.pop(name)
        process.send_signal(number)
        _, text = process.communicate(timeout=LIMIT_S)
        return process.returncode, text

    def close(self) -> None:
        """Ends everything."""
        for process in self.processes.values():
            process.kill()
            process.communicate()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()
        self._memory.clean()


@pytest.fixture
def bench(domain: int) -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def uwloc(*arguments: str | float | Path, limit_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    """Runs the program `uwloc`."""
    command = [sys.executable, "-m", "uw_acoustic_loc", *[str(argument) for argument in arguments]]
    return subprocess.run(command, capture_output=True, text=True, timeout=limit_s, check=False)
