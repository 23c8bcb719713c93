"""Publishers and subscriptions of a node by their own names, with counts that say what went through."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from std_srvs.srv import SetBool

from ..contract import Output
from ..wire.codec import codec
from .rclpy_messages import message_class, publisher_qos, qos, to_dds


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
        self.sent = dict.fromkeys(self._publishers, 0)

    def send(self, topic: str, value: Any) -> None:
        """Publishes a core value on one of the outputs."""
        self._publishers[topic].publish(to_dds(value))
        self.sent[topic] += 1

    def wait_acknowledged(self) -> None:
        """Waits (at most 3 s each) until readers have what was sent, so that an exit loses nothing."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=3))

    def report(self) -> dict[str, dict[str, int]]:
        """Per full topic name: messages sent and readers matched."""
        return {
            publisher.topic_name: {"sent": self.sent[topic], "readers": publisher.get_subscription_count()}
            for topic, publisher in self._publishers.items()
        }


class Subscriptions:
    """The node's inputs: `take(topic, data)` is called with the input's own name and CDR bytes.

    Messages of bytes that cannot be decoded thus come too; rclpy would drop them in silence.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._subscriptions: dict[str, Any] = {}
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

    def report(self) -> dict[str, dict[str, int]]:
        """Per full topic name: messages taken and writers matched."""
        return {
            subscription.topic_name: {"taken": self.taken[topic], "writers": subscription.get_publisher_count()}
            for topic, subscription in self._subscriptions.items()
        }


class SyncService:
    """`~/sync` (std_srvs/SetBool): answers what the node has taken and sent; data=true first ends its input.

    Whoever feeds the node can wait until everything that was sent has been processed: delivery acknowledged by DDS does
    not say that a callback has run.
    """

    def __init__(self, node: Node, reports: Callable[[], dict[str, Any]], finish: Callable[[], None]) -> None:
        self._reports, self._finish = reports, finish
        node.create_service(SetBool, "~/sync", self._answer)

    def _answer(self, request: Any, response: Any) -> Any:
        if request.data:
            self._finish()
        response.success = True
        response.message = json.dumps(self._reports())
        return response
