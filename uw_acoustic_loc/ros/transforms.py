"""TF from odometry, on machines where tf2_msgs is installed."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not on PyPI, but on every ROS machine
    TFMessage = None

from ..core.types import Odometry
from ..wire.messages import ODOMETRY
from .rclpy_messages import RosMake


class Transforms:
    """Broadcasts odometry as a transform on /tf; does nothing where tf2_msgs is not installed."""

    def __init__(self, node: Node) -> None:
        self._publisher: Any = node.create_publisher(TFMessage, "/tf", 100) if TFMessage else None

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
