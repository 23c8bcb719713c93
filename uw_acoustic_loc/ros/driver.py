"""The adapter for simulated sensors: publishes a scenario's events when the clock reaches them."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.parameter import Parameter

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not on PyPI, but on every ROS machine
    TFMessage = None

from ..config import build
from ..contract import Event, Status
from ..core.types import Odometry
from ..sim.catalog import DriverConfig, configured_scenario, make_source
from ..sim.scenario import Scenario
from ..wire.messages import ODOMETRY
from .diagnostics import Diagnostics
from .endpoints import Publishers
from .parameters import declare, given_parameters, make_node
from .qos import PUBLISHER, overridable
from .rclpy_messages import RosMake
from .report import NodeReport
from .spin import Stop
from .sync import SyncService

_LONG_S = 0.002  # to make an event; a quicker one is made at once
_REST = 0.3  # of the time to the next event
_TURN_S = 0.05  # of publishing what is due, between two looks at signals and services
_MISSED_NS = 1_000_000_000  # a driver that starts late leaves out what is older


class DriverNode:
    """Follows /clock when use_sim_time is set; otherwise real time, with all stamps moved to its start."""

    def __init__(self, executable: str) -> None:
        self.node = make_node(executable)
        config = self._configure()
        scenario = self._scenario(config)
        source = make_source(executable, scenario)
        self._publishers = Publishers(self.node, source.outputs)
        self._transforms = _Transforms(self.node)
        self._events: Iterator[Event] = source.events()
        self._latched = {output.topic for output in source.outputs if output.latched}
        self._started, self._missed, self._reached_ns, self._oldest_ns = False, 0, 0, 0
        self._next: Event | None = next(self._events, None)
        self._took = self._interval = 0.0  # s, of making the next event, and since the one before
        self._shift_ns = self._shift(config, scenario.start_ns)
        self._send_latched()
        Diagnostics(self.node, self._status)
        SyncService(self.node, self._report, self._finish)

    def idle(self) -> float:
        """Publishes all events that are due; returns the time to the next one."""
        now_ns = self._now_ns()
        if now_ns <= 0:
            return 0.1  # simulated time has not started
        if not self._started:
            self._started, self._oldest_ns = True, now_ns - _MISSED_NS
        begun = time.monotonic()
        while self._next is not None and self._next[0] <= now_ns:
            self._take_next(self._next)
            if time.monotonic() - begun > _TURN_S:
                return 0.0  # signals and services must not wait for what is overdue
        self._log_missed()
        self._reached_ns = now_ns
        if self._next is None:
            return 0.1
        return min(0.1, max(0.0005, (self._next[0] - self._now_ns()) * 1e-9))  # making an event takes its time

    def close(self) -> None:
        """Waits until everything that was sent has arrived."""
        self._publishers.wait_acknowledged()

    def _now_ns(self) -> int:
        now_ns: int = self.node.get_clock().now().nanoseconds
        return now_ns - self._shift_ns

    def _configure(self) -> DriverConfig:
        try:
            config = build(DriverConfig, given_parameters(self.node), f"node {self.node.get_fully_qualified_name()}")
        except ValueError as error:
            raise Stop(1, str(error)) from None
        declare(self.node, config)
        return config

    def _scenario(self, config: DriverConfig) -> Scenario:
        try:
            return configured_scenario(config, Path())
        except ValueError as error:
            raise Stop(1, f"node {self.node.get_fully_qualified_name()}: {error}") from None

    def _shift(self, config: DriverConfig, start_ns: int) -> int:
        if (
            self.node.get_parameter("use_sim_time").type_ == Parameter.Type.BOOL
            and self.node.get_parameter("use_sim_time").value
        ):
            return 0
        now_ns: int = self.node.get_clock().now().nanoseconds
        return (config.start_time * 1_000_000_000 or now_ns) - start_ns

    def _send_latched(self) -> None:
        while self._next is not None and self._next[1] in self._latched:
            self._publish(self._next)
            self._next = next(self._events, None)

    def _take_next(self, event: Event) -> None:
        if event[0] < self._oldest_ns:
            self._missed += 1
            self._next = next(self._events, None)
        else:
            self._publish(event)
            self._make_next(event[0])

    def _log_missed(self) -> None:
        if self._missed:
            self.node.get_logger().warning(f"started late: left out {self._missed} messages of the past")
            self._missed = 0

    def _make_next(self, last_ns: int) -> None:
        """In real time not at once, if it takes long: a real sensor leaves the processors to those who listen."""
        if self._shift_ns and self._took > _LONG_S:
            time.sleep(_REST * self._interval)
        begun = time.monotonic()
        self._next = next(self._events, None)
        self._took = time.monotonic() - begun
        self._interval = (self._next[0] - last_ns) * 1e-9 if self._next else 0.0

    def _publish(self, event: Event) -> None:
        _, topic, value = event
        if self._shift_ns:
            value = dataclasses.replace(value, t_ns=value.t_ns + self._shift_ns)
        self._publishers.send(topic, value)
        if topic == "odometry" and isinstance(value, Odometry):
            self._transforms.send(value)

    def _finish(self) -> None:
        self._next = None

    def _status(self) -> Status:
        values = {f"{topic} sent": sent for topic, sent in self._publishers.sent.items()}
        if not self._started:
            return Status(Status.WARN, "waiting for /clock", values)
        return Status(Status.OK, "running" if self._next else "the scenario is over", values)

    def _report(self) -> NodeReport:
        return NodeReport(self._publishers.report(), reached_ns=self._reached_ns)


class _Transforms:
    """Broadcasts odometry as a transform on /tf; does nothing where tf2_msgs is not installed."""

    def __init__(self, node: Node) -> None:
        overrides: dict[str, Any] = {"qos_overriding_options": overridable(node, "/tf", PUBLISHER)}
        self._publisher: Any = node.create_publisher(TFMessage, "/tf", 100, **overrides) if TFMessage else None

    def send(self, value: Odometry) -> None:
        """Broadcasts frame_id -> child_frame_id."""
        if self._publisher is None:
            return
        message = ODOMETRY.encode(RosMake(), value)
        transform = TransformStamped(header=message.header, child_frame_id=value.child_frame_id)
        place = message.pose.pose.position
        transform.transform.translation.x, transform.transform.translation.y = place.x, place.y
        transform.transform.translation.z = place.z
        transform.transform.rotation = message.pose.pose.orientation
        self._publisher.publish(TFMessage(transforms=[transform]))
