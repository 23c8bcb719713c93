"""Plays a bag to live nodes over DDS, with /clock, and waits until they have processed every message.

The flow is bounded by credit: after each window of messages the player asks the consumers, over `~/sync`, what they
have taken, and goes on when nothing is outstanding. So nothing is lost however slow a node is, whichever middleware
carries the messages, and the nodes never see their inputs further apart than a window.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.validate_full_topic_name import validate_full_topic_name
from rosgraph_msgs.msg import Clock

from ..bag.reader import Bag, Record, Topic
from ..bag.remap import RemappedBag, remaps
from ..config import build, param
from .endpoints import Peers
from .parameters import declare, given_parameters, make_node
from .qos import PUBLISHER, STREAM_DEPTH, overridable, qos
from .rclpy_messages import clock_message, message_class
from .report import Deliveries, NodeReport, Reports, unmatched, unreached
from .spin import Stop
from .sync import SyncClient, SyncService

_WINDOW = 200  # messages outstanding at most: well below the readers' depth


@dataclass(frozen=True)
class PlayerConfig:
    """What is played, how fast, and to whom."""

    bag: str = param(doc="rosbag2 folder or .mcap file")
    rate: float = param(1.0, unit="x real time", low=0.0, high=1000.0, doc="0 = as fast as the consumers go")
    topics: tuple[str, ...] = param((), doc="topics to play; empty = all")
    latched: tuple[str, ...] = param((), doc="topics that consumers want latched, whatever the bag says of them")
    remap: tuple[str, ...] = param((), doc="'theirs ours' pairs: topics of the bag that go by another name")
    consumers: tuple[str, ...] = param((), doc="full names of nodes of this package to wait for")
    window: float = param(0.25, unit="s", low=0.0, doc="of the bag, after which all consumers must have caught up")
    timeout: float = param(60.0, unit="s", low=1.0, doc="how long the consumers may take for a window")


class PlayerNode:
    """Plays once, then exits with code 0; with code 1 and a sentence when consumers do not follow."""

    def __init__(self, executable: str) -> None:
        self.node = make_node(executable)
        try:
            where = f"node {self.node.get_fully_qualified_name()}"
            self._config = build(PlayerConfig, given_parameters(self.node), where)
            self._bag = RemappedBag(Bag(Path(self._config.bag)), remaps(self._config.remap, sign=" "))
        except ValueError as error:
            raise Stop(1, str(error)) from None
        declare(self.node, self._config)
        self._own_executor = SingleThreadedExecutor()
        self._service_node = rclpy.create_node(f"{self.node.get_name()}_sync", use_global_arguments=False)
        self._own_executor.add_node(self._service_node)
        self._sync = SyncClient(self._service_node, self._own_executor, list(self._config.consumers))
        self._clock = self.node.create_publisher(Clock, "/clock", 10)
        self._publishers: dict[str, Publisher] = {}
        self._types: dict[str, str] = {}  # by topic
        for topic in self._bag.topics.values():
            if not self._config.topics or topic.name in self._config.topics:
                self._add(topic)
        self._readers = {topic: Peers(self.node, publisher) for topic, publisher in self._publishers.items()}
        self._sent: Counter[str] = Counter()
        self._skipped: Counter[str] = Counter()
        self._deliveries = Deliveries()
        self._played_s = 0.0  # of the bag
        SyncService(self.node, self._report, lambda: None)
        self._plan = self._play()

    def idle(self) -> float:
        """Plays the next window."""
        wait = next(self._plan, None)
        if wait is None:
            left_out = "".join(f", left out {count} on {topic}" for topic, count in sorted(self._skipped.items()))
            raise Stop(0, f"played {sum(self._sent.values())} messages of {self._config.bag}{left_out}")
        return wait

    def close(self) -> None:
        """Waits until all has arrived."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=3))
        self._own_executor.shutdown()
        self._service_node.destroy_node()

    def _add(self, topic: Topic) -> None:
        """Makes its publisher; none, but a warning, for a type that is not installed or a name that is not ROS's."""
        self._types[topic.name] = topic.msgtype
        try:
            validate_full_topic_name(topic.name)
            self._publishers[topic.name] = self.node.create_publisher(
                message_class(topic.msgtype),
                topic.name,
                _offered(topic.latched or topic.name in self._config.latched),
                qos_overriding_options=overridable(self.node, topic.name, PUBLISHER),
            )
        except (ValueError, NameValidationException) as error:
            self.node.get_logger().warning(f"{topic.name} is not played: {' '.join(str(error).split())}")

    def _records(self) -> Iterator[Record]:
        """What can be played; the rest is counted."""
        for record in self._bag.records([*self._types]):
            if record.topic in self._publishers and record.msgtype == self._types[record.topic]:
                yield record
            else:
                self._skipped[record.topic] += 1

    def _report(self) -> NodeReport:
        return NodeReport(played_s=self._played_s)

    def _play(self) -> Iterator[float]:
        self._await(self._unmatched, "the nodes are not connected")
        begun, first_ns = time.monotonic(), 0
        for window in _windows(self._records(), round(self._config.window * 1e9)):
            first_ns = first_ns or window[0].t_ns
            while (ahead := self._ahead(window[0].t_ns - first_ns, begun)) > 0:
                yield min(ahead, 0.05)
            for record in window:
                self._publishers[record.topic].publish(record.data)
                self._sent[record.topic] += 1
            self._clock.publish(clock_message(window[-1].t_ns))
            self._await(self._outstanding, "messages were not processed")
            self._played_s = (window[-1].t_ns - first_ns) * 1e-9
            yield 0.0
        for damage in self._bag.damage:
            self.node.get_logger().error(damage)
        for name in self._config.consumers:  # in the order of the data flow: each may still hand on what it held
            self._sync.ask([name], finish=True, timeout_s=self._config.timeout)
            self._await(self._outstanding, "messages were not processed")

    def _ahead(self, bag_ns: int, begun: float) -> float:
        """Seconds until an instant of the bag is due."""
        if self._config.rate == 0:
            return 0.0
        return begun + bag_ns * 1e-9 / self._config.rate - time.monotonic()

    def _await(self, wrong_of: Callable[[Reports], list[str]], what: str) -> None:
        wrong = self._sync.until(list(self._config.consumers), wrong_of, self._config.timeout)
        if wrong:
            raise Stop(1, f"player: {what} within {self._config.timeout:g} s: {'; '.join(wrong)}")

    def _unmatched(self, reports: Reports) -> list[str]:
        own = self.node.get_fully_qualified_name()
        wrong = unmatched(reports, dict.fromkeys(self._publishers, own))
        for topic in self._publishers:
            missed = unreached(reports, topic, self._readers[topic].names)
            wrong += [f"{own} does not reach {reader} on {topic}" for reader in missed]
        return wrong

    def _outstanding(self, reports: Reports) -> list[str]:
        return self._deliveries.outstanding(reports, self._sent)


def _offered(latched: bool) -> QoSProfile:
    """As deep as the readers: a window may hold many messages of a latched topic."""
    profile = qos(latched)
    profile.depth = STREAM_DEPTH
    return profile


def _windows(records: Iterator[Record], window_ns: int) -> Iterator[list[Record]]:
    window: list[Record] = []
    for record in records:
        if window and (len(window) >= _WINDOW or record.t_ns - window[0].t_ns >= window_ns):
            yield window
            window = []
        window.append(record)
    if window:
        yield window
