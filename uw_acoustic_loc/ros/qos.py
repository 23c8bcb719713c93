"""QoS profiles: what topics offer, what subscriptions adapt to, and ROS's `qos_overrides` parameters."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from rclpy.duration import Infinite
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import QoSOverridingOptions

from ..contract import Output
from ..wire.codec import codec
from ..wire.record import RECORD

# So many messages may a subscriber fall behind before it loses any: in its own queue while it is busy, and in the
# publisher's while its process is held up. 10 s of an IMU at 100 Hz, and of a record, which may be long, 100 messages.
STREAM_DEPTH, _RECORD_DEPTH = 1000, 100
PUBLISHER, SUBSCRIPTION = "publisher", "subscription"  # as qos_overrides has them
_POLICIES = [kind for kind in QoSPolicyKind if kind is not QoSPolicyKind.INVALID]
_USUAL = {QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY}  # declared in any case


def publisher_qos(output: Output) -> QoSProfile:
    """Of an output."""
    return qos(output.latched, _RECORD_DEPTH if codec(output.kind).msgtype == RECORD else STREAM_DEPTH)


def subscription_qos(latched: bool) -> QoSProfile:
    """Of an input, while no publisher asks for less; a latched topic may have several publishers, or come in parts."""
    profile = qos(latched)
    profile.depth = _RECORD_DEPTH if latched else STREAM_DEPTH
    return profile


def qos(latched: bool, depth: int = STREAM_DEPTH) -> QoSProfile:
    """Reliable; latched topics keep their last value for whoever comes later. Every policy is named, none left open."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1 if latched else depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        deadline=Infinite,
        lifespan=Infinite,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Infinite,
    )


def overridden(node: Node, topic: str, entity: str) -> set[QoSPolicyKind]:
    """The policies of one of the node's publishers or subscriptions that its `qos_overrides` parameters give."""
    stem = f"{_OVERRIDES}{node.resolve_topic_name(topic)}.{entity}"
    return {kind for kind in _POLICIES if node.has_parameter(f"{stem}.{kind.name.lower()}")}


def overridable(node: Node, topic: str, entity: str) -> QoSOverridingOptions:
    """Every policy that is given by `qos_overrides.<topic>.<entity>.<policy>` replaces ours."""
    return QoSOverridingOptions(_USUAL | overridden(node, topic, entity))


def check_overrides(parameters: Mapping[str, Any], topics: Collection[str], where: str) -> None:
    """Raises ValueError for a `qos_overrides` parameter that rclpy would ignore or stumble over; no topics = any."""
    for key, value in parameters.items():
        if not key.startswith(_OVERRIDES):
            continue
        topic, entity, policy = ["", "", *key.removeprefix(_OVERRIDES).rsplit(".", 2)][-3:]
        allowed = _ALLOWED.get(policy, ())
        if topics and topic not in topics:
            raise ValueError(f"{where}: {key}: the node has no topic {topic}, only {', '.join(sorted(topics))}")
        if entity not in (PUBLISHER, SUBSCRIPTION) or not allowed:
            form = f"{_OVERRIDES}<topic>.publisher|subscription.{'|'.join(_ALLOWED)}"
            raise ValueError(f"{where}: {key} must be {form}")
        if not (value in allowed if isinstance(allowed, list) else type(value) is allowed):
            words = ", ".join(allowed) if isinstance(allowed, list) else _WORDS[allowed]
            raise ValueError(f"{where}: {key} must be {words}, got {value!r}")


_OVERRIDES = "qos_overrides."
_ALLOWED: dict[str, list[str] | type] = {
    "reliability": ["reliable", "best_effort"],
    "durability": ["volatile", "transient_local"],
    "history": ["keep_last", "keep_all"],
    "depth": int,
    "deadline": int,
    "lifespan": int,
    "liveliness": ["automatic", "manual_by_topic"],
    "liveliness_lease_duration": int,
    "avoid_ros_namespace_conventions": bool,
}
_WORDS = {int: "a whole number (times in ns)", bool: "true or false"}


def adapted(own: QoSProfile, offers: Iterable[QoSProfile], pinned: set[QoSPolicyKind]) -> list[QoSProfile]:
    """The profiles with which a subscription gets the messages of all `offers`; `pinned` policies stay as they are.

    As rosbag2 does it: best effort when one publisher is. Transient-local and volatile publishers of a latched topic
    need a subscription each, or the value that the former keep would be missed.
    """
    offers = list(offers)
    reliability, durabilities = own.reliability, [own.durability]
    best_effort = any(offer.reliability == ReliabilityPolicy.BEST_EFFORT for offer in offers)
    if best_effort and QoSPolicyKind.RELIABILITY not in pinned:
        reliability = ReliabilityPolicy.BEST_EFFORT
    if own.durability == DurabilityPolicy.TRANSIENT_LOCAL and QoSPolicyKind.DURABILITY not in pinned:
        durabilities = sorted({offer.durability for offer in offers}) or durabilities
    return [_changed(own, reliability, durability) for durability in durabilities]


def _changed(own: QoSProfile, reliability: ReliabilityPolicy, durability: DurabilityPolicy) -> QoSProfile:
    values: dict[str, Any] = {name.lstrip("_"): getattr(own, name.lstrip("_")) for name in QoSProfile.__slots__}
    return QoSProfile(**{**values, "reliability": reliability, "durability": durability})


def incompatible(offered: QoSProfile, requested: QoSProfile) -> str:
    """Why a subscription gets nothing from a publisher; empty when it does."""
    result, reason = qos_check_compatible(offered, requested)
    return reason.replace("ERROR: ", "").strip("; ") if result == QoSCompatibility.ERROR else ""


def words(profile: QoSProfile) -> str:
    """For example `reliable, volatile`."""
    return f"{profile.reliability.name}, {profile.durability.name}".lower().replace("_", " ")
