"""What a node says of itself once a second on /diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from ..contract import Status
from ..stages.runner import REFUSED
from .qos import PUBLISHER, overridable

_SILENT_S = 5.0  # no input for so long is STALE


class Diagnostics:
    """Publishes `report()` every second of real time, whatever the simulated clock does."""

    def __init__(self, node: Node, report: Callable[[], Status]) -> None:
        self._node, self._report = node, report
        self._publisher = node.create_publisher(
            DiagnosticArray, "/diagnostics", 10, qos_overriding_options=overridable(node, "/diagnostics", PUBLISHER)
        )
        node.create_timer(1.0, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self) -> None:
        """Publishes the status as it is now."""
        status = self._report()
        pairs = [KeyValue(key=key, value=_text(value)) for key, value in status.values.items()]
        name = self._node.get_fully_qualified_name()
        entry = DiagnosticStatus(
            level=bytes([status.level]), name=name, message=status.message, hardware_id="none", values=pairs
        )
        message = DiagnosticArray(status=[entry])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


class InputWatch:
    """Rates of the inputs, and whether they have gone silent, in real time."""

    STALE = 3

    def __init__(self) -> None:
        self._last_input = time.monotonic()
        self._last_report = time.monotonic()
        self._before: dict[tuple[str, str], int] = {}

    def heard(self) -> None:
        """An input came."""
        self._last_input = time.monotonic()

    def status(
        self, stage: Status, missing: list[str], counts: Mapping[tuple[str, str], int], problems: list[str]
    ) -> Status:
        """The stage's status with the counts, and the worst that is to be said first."""
        silent = time.monotonic() - self._last_input
        fresh = {key: count - self._before.get(key, 0) for key, count in counts.items()}
        seconds = max(time.monotonic() - self._last_report, 1e-3)
        self._before, self._last_report = dict(counts), time.monotonic()
        values: dict[str, Any] = {f"{topic} {what}".strip(): count for (topic, what), count in counts.items()}
        values |= {f"{t} rate (Hz)": fresh[t, w] / seconds for t, w in counts if w == "received"}
        values |= stage.values
        level, message = stage.level, stage.message
        refused = [f"{n} {what} on {topic}" for (topic, what), n in fresh.items() if n > 0 and what in REFUSED]
        if problems:
            level, message = Status.ERROR, "; ".join(problems)
        elif silent > _SILENT_S:
            level, message = self.STALE, f"no input for {silent:.0f} s"
        elif missing:
            level, message = max(level, Status.WARN), f"waiting for {', '.join(missing)}"
        elif refused:
            news = f"in the last second: {', '.join(refused)}"
            level, message = max(level, Status.WARN), f"{news}; {message}" if level > Status.OK else news
        return Status(level, message, values)


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
