"""Publishers and subscriptions of a node by their own names, with counts that say what went through."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ..contract import Output
from ..wire.codec import codec
from .qos import (
    PUBLISHER,
    SUBSCRIPTION,
    adapted,
    incompatible,
    overridable,
    overridden,
    publisher_qos,
    subscription_qos,
    words,
)
from .rclpy_messages import message_class, to_dds
from .report import Sent, Taken


class Publishers:
    """The node's outputs; `send` takes core values."""

    def __init__(self, node: Node, outputs: tuple[Output, ...]) -> None:
        self._publishers = {
            output.topic: node.create_publisher(
                message_class(codec(output.kind).msgtype),
                output.topic,
                publisher_qos(output),
                qos_overriding_options=overridable(node, output.topic, PUBLISHER),
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
        """Waits a moment until readers have what was sent, so that an exit loses nothing; a dead one never has it."""
        limit = time.monotonic() + _ACKNOWLEDGED_S
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=max(limit - time.monotonic(), 0.0)))

    def report(self) -> dict[str, Sent]:
        """What was sent, and whom it reaches, by full topic name."""
        return {
            publisher.topic_name: Sent(self.sent[topic], self._readers[topic].names)
            for topic, publisher in self._publishers.items()
        }


class Subscriptions:
    """The node's inputs: `take(topic, data)` is called with the input's own name and CDR bytes.

    Messages of bytes that cannot be decoded thus come too; rclpy would drop them in silence. Profiles follow the
    publishers that are there, and those that come later.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._subscriptions: dict[str, _Following] = {}
        self.taken: dict[str, int] = {}
        node.create_timer(_FOLLOW_S, self._follow, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def add(self, topic: str, msgtype: str, latched: bool, take: Callable[[str, bytes], None]) -> None:
        """Subscribes."""

        def taken(data: bytes) -> None:
            self.taken[topic] += 1
            take(topic, data)

        self.taken[topic] = 0
        self._subscriptions[topic] = _Following(self._node, topic, msgtype, latched, taken)

    def report(self) -> dict[str, Taken]:
        """What was taken, and whom it comes from, by full topic name."""
        return {
            subscription.topic_name: Taken(self.taken[topic], subscription.writers)
            for topic, subscription in self._subscriptions.items()
        }

    def problems(self) -> list[str]:
        """A sentence for each publisher whose messages cannot be had."""
        return [sentence for subscription in self._subscriptions.values() for sentence in subscription.problems()]

    def _follow(self) -> None:
        for subscription in self._subscriptions.values():
            subscription.follow()


class _Following:
    """An input's subscription, replaced by others when its publishers offer less than it asks for."""

    def __init__(self, node: Node, topic: str, msgtype: str, latched: bool, take: Callable[[bytes], None]) -> None:
        self._node, self._topic, self._msgtype, self._take = node, topic, msgtype, take
        self._last = b""
        self._subscriptions: dict[str, tuple[Subscription, Peers]] = {}
        self._pinned = overridden(node, topic, SUBSCRIPTION)
        options = overridable(node, topic, SUBSCRIPTION)
        self._own = self._open(subscription_qos(latched), options).qos_profile  # with the user's overrides
        self.topic_name = node.resolve_topic_name(topic)

    @property
    def writers(self) -> tuple[str, ...]:
        """Full names of the nodes whose messages come."""
        return tuple(sorted({name for _, peers in self._subscriptions.values() for name in peers.names}))

    def follow(self) -> None:
        """Looks at the publishers that are there; opens what their profiles need, and closes what is not needed."""
        heard = sum(subscription.get_publisher_count() for subscription, _ in self._subscriptions.values())
        if [*self._subscriptions] == [words(self._own)] and heard >= self._node.count_publishers(self.topic_name):
            return
        offers = [offer.qos_profile for offer in self._offers() if offer.topic_type == self._msgtype]
        if not offers:
            return
        wanted = {words(profile): profile for profile in adapted(self._own, offers, self._pinned)}
        for name in wanted.keys() - self._subscriptions.keys():
            self._open(wanted[name])
            self._node.get_logger().info(f"{self._topic}: subscribed as {name}, as its publishers are")
        for name in self._subscriptions.keys() - wanted.keys():
            self._node.destroy_subscription(self._subscriptions.pop(name)[0])

    def problems(self) -> list[str]:
        """A sentence for each publisher that stays incompatible."""
        found = []
        for offer in self._offers():
            who, profile = f"{self._topic}: {_name(offer)}", offer.qos_profile
            reasons = [incompatible(profile, sub.qos_profile) for sub, _ in self._subscriptions.values()]
            if offer.topic_type != self._msgtype:
                found.append(f"{who} publishes {offer.topic_type}, expected is {self._msgtype}")
            elif all(reasons):
                asked = " or ".join(self._subscriptions)
                found.append(f"{who} offers {words(profile)}, this node asks for {asked} ({reasons[0]})")
        return found

    def _offers(self) -> list[TopicEndpointInfo]:
        return list(self._node.get_publishers_info_by_topic(self.topic_name))

    def _open(self, profile: QoSProfile, options: QoSOverridingOptions | None = None) -> Subscription:
        subscription = self._node.create_subscription(
            message_class(self._msgtype),
            self._topic,
            self._taken,
            profile,
            raw=True,
            qos_overriding_options=options,
            # an event of a subscription that has been replaced in the meantime crashes the executor
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._subscriptions[words(subscription.qos_profile)] = subscription, Peers(self._node, subscription)
        return subscription

    def _taken(self, data: bytes) -> None:
        """With two subscriptions a transient-local publisher is heard twice."""
        if len(self._subscriptions) > 1 and data == self._last:
            return
        self._last = data if self._own.durability == DurabilityPolicy.TRANSIENT_LOCAL else b""
        self._take(data)


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
            return _names(info for info in found if not incompatible(own, info.qos_profile))
        found = self._node.get_publishers_info_by_topic(topic)
        return _names(info for info in found if not incompatible(info.qos_profile, own))


_ACKNOWLEDGED_S = 1.0  # of all outputs together
_PEERS_S = 1.0
_FOLLOW_S = 0.2  # between two looks at the publishers
_NO_NAME_YET = "_NODE_NAMESPACE_UNKNOWN_/_NODE_NAME_UNKNOWN_"  # as rmw has it


def _names(endpoints: Iterable[TopicEndpointInfo]) -> tuple[str, ...]:
    return tuple(sorted({_name(info) for info in endpoints}))


def _name(endpoint: TopicEndpointInfo) -> str:
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
