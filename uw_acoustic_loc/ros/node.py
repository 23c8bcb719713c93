"""The adapter: any stage as a live node. Messages in, core types through the runner, messages out."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

from ..contract import Stage
from ..graph import check_topics
from ..stages.build import ConfiguredStage, configure
from ..stages.inputs.settings import PREFIX
from ..stages.runner import Refusal, Runner
from ..wire.codec import codec
from .diagnostics import Diagnostics, InputWatch
from .endpoints import Publishers, Subscriptions
from .markers import Markers
from .parameters import declare, given_parameters, make_node, on_change
from .rclpy_messages import from_dds
from .report import NodeReport
from .spin import Stop
from .sync import SyncService


class StageNode:
    """An estimator node; parameters, diagnostics, markers and `~/sync` are the same for all."""

    def __init__(self, executable: str) -> None:
        self.node = make_node(executable.rpartition("/")[2])  # another package's is package/name
        self._configured = self._configure(executable)
        self._log = self.node.get_logger()
        self._logged: dict[str, float] = {}
        lateness = self._configured.runner.lateness
        self._runner = Runner(self._make_stage, lateness, self._log_refusal, self._configured.inputs)
        self._publishers = Publishers(self.node, self._runner.stage.outputs)
        self._subscriptions = Subscriptions(self.node)
        for wanted in self._runner.stage.inputs:
            self._subscriptions.add(wanted.topic, codec(wanted.kind).msgtype, wanted.latched, self._take)
        self._kinds = {wanted.topic: wanted.kind for wanted in self._runner.stage.inputs}
        self._markers = Markers(self.node)
        self._watch = InputWatch()
        Diagnostics(self.node, self._status)
        SyncService(self.node, self._report, self._finish)
        on_change(self.node, self._configured.config, self._check, self._change)

    def idle(self) -> float:
        """Nothing to do between callbacks."""
        return 0.1

    def close(self) -> None:
        """Hands out what the sequencer holds, and waits until it has arrived."""
        self._finish()
        self._publishers.wait_acknowledged()

    def _configure(self, executable: str) -> ConfiguredStage:
        where = f"node {self.node.get_fully_qualified_name()}"
        try:
            configured = configure(executable, given_parameters(self.node), where)
            stage = configured.make()
            topics = [i.topic for i in stage.inputs] + [o.topic for o in stage.outputs]
            check_topics([f"/{topic.lstrip('/')}" for topic in topics], where)
        except ValueError as error:
            raise Stop(1, str(error)) from None
        declare(self.node, configured.config)
        declare(self.node, configured.runner)
        for topic, config in configured.inputs.items():
            declare(self.node, config, f"{PREFIX}{topic}.")
        return configured

    def _make_stage(self) -> Stage:
        return self._configured.make()

    def _take(self, topic: str, data: bytes) -> None:
        self._watch.heard()
        try:
            value = from_dds(self._kinds[topic], data, self.node.get_clock().now().nanoseconds)
        except ValueError as error:
            self._runner.malformed(topic, str(error))
            return
        self._send(self._runner.push(topic, value))

    def _send(self, emissions: Any) -> None:
        for topic, value in emissions:
            self._publishers.send(topic, value)
            self._markers.show(topic, value)

    def _finish(self) -> None:
        self._send(self._runner.flush())

    def _check(self, config: Any) -> None:
        self._runner.stage.check(config)

    def _change(self, config: Any) -> None:
        self._configured = dataclasses.replace(self._configured, config=config)
        self._runner.stage.change(config)
        self._log.info("parameters changed")

    def _log_refusal(self, refusal: Refusal) -> None:
        """One log line per topic and second at most; the counts are complete in diagnostics."""
        now = time.monotonic()
        if now - self._logged.get(refusal.topic, -1e9) > 1.0:
            self._logged[refusal.topic] = now
            self._log.warning(f"{refusal.topic}: {refusal.sentence}")

    def _status(self) -> Any:
        problems = self._subscriptions.problems()
        return self._watch.status(self._runner.status(), self._runner.missing, self._runner.counts, problems)

    def _report(self) -> NodeReport:
        counts: dict[str, dict[str, int]] = {}
        for (topic, what), count in self._runner.counts.items():
            counts.setdefault(topic, {})[what] = count
        return NodeReport(self._publishers.report(), self._subscriptions.report(), counts)
