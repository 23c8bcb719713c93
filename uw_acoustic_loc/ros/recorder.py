"""Records topics into an MCAP bag: raw CDR bytes, at the time of the node's clock."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..bag.writer import BagWriter
from ..config import build, param
from ..contract import Status
from .diagnostics import Diagnostics
from .endpoints import Subscriptions
from .parameters import declare, given_parameters, make_node
from .report import NodeReport
from .spin import Stop
from .sync import SyncService

_NOT_RECORDED = ("/clock", "/parameter_events", "/rosout")
_DISCOVERY_S = 0.2
_FLUSH_S = 1.0


@dataclass(frozen=True)
class RecorderConfig:
    """What is recorded, and where to."""

    bag: str = param(doc="folder to be made")
    topics: tuple[str, ...] = param((), doc="'name type' pairs to record; empty = every topic that appears")
    latched: tuple[str, ...] = param((), doc="names among topics that are latched")
    resume: bool = param(False, doc="go on in a further file of a bag that exists")
    about: str = param("{}", doc="JSON of keys and texts that are stored with the bag")


class RecorderNode:
    """A bag with everything that was heard; a full disk ends the recording with exit code 1 and a readable bag."""

    def __init__(self, executable: str) -> None:
        self.node = make_node(executable)
        where = f"node {self.node.get_fully_qualified_name()}"
        try:
            self._config = build(RecorderConfig, given_parameters(self.node), where)
            about = {"made_by": "recorder", **_texts(self._config.about, where)}
            self._writer = BagWriter(Path(self._config.bag), about, self._config.resume)
        except (ValueError, OSError) as error:
            raise Stop(1, str(error)) from None
        self._flushed = time.monotonic()
        declare(self.node, self._config)
        self._subscriptions = Subscriptions(self.node)
        self._known: set[str] = set()
        self._early: list[tuple[str, bytes]] = []  # latched values that come before simulated time starts
        for pair in self._config.topics:
            name, msgtype = pair.split()
            self._add(name, msgtype, name in self._config.latched)
        if not self._config.topics:
            self.node.create_timer(_DISCOVERY_S, self._discover)
        Diagnostics(self.node, self._status)
        SyncService(self.node, self._report, lambda: None)

    def idle(self) -> float:
        """Between callbacks: what is recorded goes to the file, where it outlives this process."""
        if time.monotonic() - self._flushed > _FLUSH_S:
            self._guard(self._writer.flush)
            self._flushed = time.monotonic()
        return 0.1

    def close(self) -> None:
        """Finishes the bag."""
        self._write_early(self.node.get_clock().now().nanoseconds)
        self._guard(self._writer.close)

    def _discover(self) -> None:
        for name, types in self.node.get_topic_names_and_types():
            if name not in self._known and name not in _NOT_RECORDED:
                offers = self.node.get_publishers_info_by_topic(name)
                latched = any(offer.qos_profile.durability.name == "TRANSIENT_LOCAL" for offer in offers)
                if offers:
                    self._add(name, types[0], latched)

    def _add(self, name: str, msgtype: str, latched: bool) -> None:
        self._known.add(name)
        try:
            self._subscriptions.add(name, msgtype, latched, self._take)
        except ValueError as error:
            self.node.get_logger().warning(f"{name} is not recorded: {error}")
            return
        self._writer.add_topic(name, msgtype, latched)

    def _take(self, topic: str, data: bytes) -> None:
        now_ns = self.node.get_clock().now().nanoseconds
        if now_ns <= 0:
            self._early.append((topic, data))
            return
        self._write_early(now_ns)
        self._guard(lambda: self._writer.write(topic, now_ns, data))

    def _write_early(self, now_ns: int) -> None:
        for topic, data in self._early:
            self._guard(partial(self._writer.write, topic, now_ns, data))
        self._early.clear()

    def _guard(self, write: Callable[[], None]) -> None:
        try:
            write()
        except OSError as error:
            raise Stop(1, f"bag {self._config.bag}: recording stopped: {error.strerror}") from None

    def _status(self) -> Status:
        values = {f"{topic} recorded": count for topic, count in self._writer.counts.items()}
        if problems := self._subscriptions.problems():
            return Status(Status.ERROR, "; ".join(problems), values)
        return Status(values=values)

    def _report(self) -> NodeReport:
        return NodeReport(taken=self._subscriptions.report(), recorded=self._writer.counts)


def _texts(about: str, where: str) -> dict[str, str]:
    try:
        found = json.loads(about)
    except json.JSONDecodeError as error:
        raise ValueError(f"{where}: about must be JSON, got {about[:40]!r} ({error})") from None
    if not isinstance(found, dict) or not all(isinstance(value, str) for value in found.values()):
        raise ValueError(f"{where}: about must be a JSON object of texts, got {about[:40]!r}")
    return found
