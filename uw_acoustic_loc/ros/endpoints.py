"""Publishers and subscriptions of a node by their own names, with counts that say what went through."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ..contract import Output
from ..wire.codec import codec
from .rclpy_messages import message_class, publisher_qos, qos, to_dds
from .report import Sent, Taken


class Publishers:
    """The node's outputs; `send` takes core values."""

    def __init__(self, node: Node, outputs: tuple[Output, ...]) -> None:
        self._publishers = {
            output.topic: node.create_publisher(
                message_class(codec(output.kind).msgtype),
                output.topic,
                publisher_qos(output),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
            for output in outputs
        }
        self._readers = {topic: Peers(node, publisher) for topic, publisher in self._publishers.items()}
        self.sent = dict.fromkeys(self._publishers, 0)

    def send(self, topic: str, value: Any) -> None:
        """Publishes a core value on one of the outputs."""
        self._publishers[topic].publish(to_dds(value))
        self.sent[topic] += 1

    def wait_acknowledged(self) -> None:
        """Waits (at most 3 s each) until readers have what was sent, so that an exit loses nothing."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=3))

    def report(self) -> dict[str, Sent]:
        """What was sent, and whom it reaches, by full topic name."""
        return {
            publisher.topic_name: Sent(self.sent[topic], self._readers[topic].names)
            for topic, publisher in self._publishers.items()
        }


class Subscriptions:
    """The node's inputs: `take(topic, data)` is called with the input's own name and CDR bytes.

    Messages of bytes that cannot be decoded thus come too; rclpy would drop them in silence.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._subscriptions: dict[str, Any] = {}
        self._writers: dict[str, Peers] = {}
        self.taken: dict[str, int] = {}

    def add(self, topic: str, msgtype: str, latched: bool, take: Callable[[str, bytes], None]) -> None:
        """Subscribes."""

        def taken(data: bytes) -> None:
            self.taken[topic] += 1
            take(topic, data)

        self.taken[topic] = 0
        self._subscriptions[topic] = self._node.create_subscription(
            message_class(msgtype),
            topic,
            taken,
            qos(latched),
            raw=True,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._writers[topic] = Peers(self._node, self._subscriptions[topic])

    def report(self) -> dict[str, Taken]:
        """What was taken, and whom it comes from, by full topic name."""
        return {
            subscription.topic_name: Taken(self.taken[topic], self._writers[topic].names)
            for topic, subscription in self._subscriptions.items()
        }


class Peers:
    """The nodes at the other end of a publisher or subscription, by full name, as far as their profiles fit.

    To ask the graph takes some 0.2 ms: it is asked again when the number of matches changes, and after a second.
    """

    def __init__(self, node: Node, endpoint: Publisher | Subscription) -> None:
        self._node, self._endpoint = node, endpoint
        self._names: tuple[str, ...] = ()
        self._matched, self._asked = 0, -1e9

    @property
    def names(self) -> tuple[str, ...]:
        """Sorted."""
        matched, now = self._count(), time.monotonic()
        if matched != self._matched or now - self._asked > _PEERS_S or _NO_NAME_YET in self._names:
            self._names, self._matched, self._asked = self._ask(), matched, now
        return self._names

    def _count(self) -> int:
        if isinstance(self._endpoint, Publisher):
            return self._endpoint.get_subscription_count()
        return self._endpoint.get_publisher_count()

    def _ask(self) -> tuple[str, ...]:
        topic, own = self._endpoint.topic_name, self._endpoint.qos_profile
        if isinstance(self._endpoint, Publisher):
            found = self._node.get_subscriptions_info_by_topic(topic)
            return _names(info for info in found if _fit(own, info.qos_profile))
        found = self._node.get_publishers_info_by_topic(topic)
        return _names(info for info in found if _fit(info.qos_profile, own))


_PEERS_S = 1.0
_NO_NAME_YET = "_NODE_NAMESPACE_UNKNOWN_/_NODE_NAME_UNKNOWN_"  # as rmw has it


def _fit(offered: QoSProfile, requested: QoSProfile) -> bool:
    return bool(qos_check_compatible(offered, requested)[0] != QoSCompatibility.ERROR)


def _names(endpoints: Iterable[TopicEndpointInfo]) -> tuple[str, ...]:
    return tuple(sorted({f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in endpoints}))
