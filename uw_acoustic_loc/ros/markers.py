"""What an estimator publishes, drawn for RViz and Foxglove: bearing rays, uncertainty ellipses, tracks."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import Any

import numpy as np
from geometry_msgs.msg import Point as PointMsg
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ..core.types import Array, Bearing, Odometry, Position, Tracks
from ..wire.flat import header
from .qos import PUBLISHER, overridable
from .rclpy_messages import RosMake

_MAKE = RosMake()
_PERIOD_S = 0.5  # real time between two drawings
_RAY_M = 50.0
_TRACK_POINTS = 500


class Markers:
    """Keeps the last drawing of each topic; draws at most twice a second, and only when somebody looks."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(
            MarkerArray, "markers", 10, qos_overriding_options=overridable(node, "markers", PUBLISHER)
        )
        self._tracks: dict[str, deque[PointMsg]] = {}
        self._drawn: dict[str, float] = {}

    def show(self, topic: str, value: Any) -> None:
        """Draws a published value if its kind has a drawing."""
        if isinstance(value, Odometry):
            self._tracks.setdefault(topic, deque(maxlen=_TRACK_POINTS)).append(_point(value.position))
        now = time.monotonic()
        if now - self._drawn.get(topic, -1e9) < _PERIOD_S or not self._publisher.get_subscription_count():
            return
        markers = self._draw(topic, value)
        if markers:
            self._drawn[topic] = now
            self._publisher.publish(MarkerArray(markers=markers))

    def _draw(self, topic: str, value: Any) -> list[Marker]:
        if isinstance(value, Bearing):
            return [_ray(topic, value)]
        if isinstance(value, Position):
            return [_ellipse(topic, value, value.position, value.cov[:2, :2])]
        if isinstance(value, Odometry):
            track = _marker(topic, value, Marker.LINE_STRIP, 0, (0.3, 0.3, 0.3))
            track.points = list(self._tracks[topic])
            return [track, _ellipse(topic, value, value.position, value.pose_cov[:2, :2], number=1)]
        if isinstance(value, Tracks):
            positions = np.stack([value.x, value.y, value.z], axis=1)
            covs = [np.eye(2) * std**2 for std in value.position_std]
            return [_ellipse(topic, value, p, c, int(i)) for p, c, i in zip(positions, covs, value.id, strict=True)]
        return []


def _marker(topic: str, value: Any, kind: int, number: int, rgb: tuple[float, float, float]) -> Marker:
    marker = Marker(header=header(_MAKE, value.t_ns, value.frame_id), ns=topic, id=number, type=kind)
    marker.color = ColorRGBA(r=rgb[0], g=rgb[1], b=rgb[2], a=0.7)
    marker.scale.x = marker.scale.y = marker.scale.z = 0.3
    marker.pose.orientation.w = 1.0
    return marker


def _ray(topic: str, value: Bearing) -> Marker:
    """A fan of one standard deviation to either side."""
    marker = _marker(topic, value, Marker.LINE_STRIP, 0, (0.1, 0.4, 0.8))
    std = math.sqrt(value.variance)
    ends = [
        value.position + _RAY_M * np.array([math.cos(angle), math.sin(angle), 0.0])
        for angle in (value.bearing - std, value.bearing, value.bearing + std)
    ]
    start = _point(value.position)
    marker.points = [start, _point(ends[0]), start, _point(ends[1]), start, _point(ends[2])]
    return marker


def _ellipse(topic: str, value: Any, position: Array, cov: Array, number: int = 0) -> Marker:
    """The two-sigma ellipse, lying flat at the estimate; a small dot while the covariance is unknown."""
    marker = _marker(topic, value, Marker.CYLINDER, number, (0.8, 0.3, 0.1))
    marker.pose.position = _point(position)
    if cov[0, 0] > 0 and cov[1, 1] > 0:
        variances, axes = np.linalg.eigh(cov)
        yaw = math.atan2(axes[1, 1], axes[0, 1])
        marker.scale.x, marker.scale.y = (4 * math.sqrt(max(v, 1e-6)) for v in (variances[1], variances[0]))
        marker.pose.orientation.z, marker.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    marker.scale.z = 0.1
    return marker


def _point(position: Array) -> PointMsg:
    return PointMsg(x=float(position[0]), y=float(position[1]), z=float(position[2]))
