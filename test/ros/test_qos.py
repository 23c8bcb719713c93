"""Subscriptions follow the profiles of the publishers that are there; what stays incompatible is named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from test.ros.conftest import Bench, uwloc
from test.ros.test_bearing_node import INFO, PARAMS, A, frame
from uw_acoustic_loc.bag.fingerprint import fingerprints
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.types import Bearing, Point
from uw_acoustic_loc.ros.rclpy_messages import RosMake, message_class
from uw_acoustic_loc.wire.codec import codec

REPO = Path(__file__).parents[2]
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=10)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
MOORING = "/**: {ros__parameters: {mooring_ids: [m1], filter: kalman}}"


def publisher(bench: Bench, topic: str, kind: type, profile: QoSProfile) -> Publisher:
    return bench.node.create_publisher(message_class(codec(kind).msgtype), topic, profile)


def send(publisher: Publisher, value: Any) -> None:
    publisher.publish(codec(type(value)).encode(RosMake(), value))


def taken(bench: Bench, name: str, topic: str) -> int:
    return bench.report(name).taken[topic].count


def reached(bench: Bench, *publishers: Publisher) -> None:
    bench.wait(lambda: all(p.get_subscription_count() > 0 for p in publishers), "a reader")


def status_of(bench: Bench, name: str) -> list[DiagnosticStatus]:
    """Fills with what the node says of itself."""
    found: list[DiagnosticStatus] = []
    bench.node.create_subscription(
        DiagnosticArray, "/diagnostics", lambda m: found.extend(s for s in m.status if s.name == name), 10
    )
    return found


def test_a_best_effort_driver_without_a_latched_topic_is_heard(bench: Bench, tmp_path: Path) -> None:
    bench.start("bearing", params=PARAMS, folder=tmp_path)
    bench.listen("/sources/a/bearing", Bearing)
    info = publisher(bench, "/hydrophones/info", type(INFO), RELIABLE)
    samples = publisher(bench, "/hydrophones/samples", type(frame(0)), BEST_EFFORT)
    reached(bench, info, samples)
    send(info, INFO)
    for k in range(8):
        send(samples, frame(k, (A, 1.0)))
        bench.executor.spin_once(timeout_sec=0.01)
    bench.wait(lambda: len(bench.received["/sources/a/bearing"]) >= 5, "bearings")


def test_a_latched_value_is_taken_beside_a_volatile_publisher(bench: Bench, tmp_path: Path) -> None:
    name = bench.start("bearing", params=PARAMS, folder=tmp_path)
    volatile = publisher(bench, "/hydrophones/info", type(INFO), RELIABLE)
    reached(bench, volatile)
    latched = publisher(bench, "/hydrophones/info", type(INFO), LATCHED)
    send(latched, INFO)  # before anybody can have matched
    bench.wait(lambda: taken(bench, name, "/hydrophones/info") == 1, "the latched value, once")


@pytest.mark.parametrize("first", [RELIABLE, BEST_EFFORT], ids=["reliable", "best effort"])
def test_a_publisher_that_comes_later_may_offer_less(bench: Bench, first: QoSProfile, tmp_path: Path) -> None:
    name = bench.start("mooring_tracker", params=MOORING, folder=tmp_path)
    topic = "/mooring/m1/offset"
    one = publisher(bench, topic, Point, first)
    reached(bench, one)
    other = publisher(bench, topic, Point, BEST_EFFORT)
    reached(bench, one, other)
    bench.wait(lambda: "/bench" in bench.report(name).taken[topic].writers, "the node to hear")
    send(one, Point(1, np.zeros(3)))
    send(other, Point(2, np.zeros(3)))
    bench.wait(lambda: taken(bench, name, topic) == 2, "both messages")


def test_what_stays_incompatible_is_an_error_with_both_profiles(bench: Bench, tmp_path: Path) -> None:
    pinned = (
        "/**:\n  ros__parameters:\n    mooring_ids: [m1]\n"
        "    qos_overrides: {/mooring/m1/offset: {subscription: {reliability: reliable}}}\n"
    )
    said = status_of(bench, bench.start("mooring_tracker", params=pinned, folder=tmp_path))
    publisher(bench, "/mooring/m1/offset", Point, BEST_EFFORT)
    sentence = "mooring/m1/offset: /bench offers best effort, volatile, this node asks for reliable, volatile"
    bench.wait(lambda: any(s.level == DiagnosticStatus.ERROR and sentence in s.message for s in said), "the error")


def test_another_type_on_the_topic_is_an_error(bench: Bench, tmp_path: Path) -> None:
    said = status_of(bench, bench.start("mooring_tracker", params=MOORING, folder=tmp_path))
    publisher(bench, "/mooring/m1/offset", Bearing, RELIABLE)
    sentence = "publishes geometry_msgs/msg/PoseWithCovarianceStamped, expected is geometry_msgs/msg/PointStamped"
    bench.wait(lambda: any(s.level == DiagnosticStatus.ERROR and sentence in s.message for s in said), "the error")


def test_every_policy_of_every_topic_can_be_overridden(bench: Bench, tmp_path: Path) -> None:
    params = (
        "/**:\n  ros__parameters:\n    mooring_ids: [m1]\n    qos_overrides:\n"
        "      /mooring/m1/offset: {subscription: {durability: transient_local, deadline: 2000000000}}\n"
        "      /mooring/m1/odometry: {publisher: {durability: transient_local, lifespan: 3000000000}}\n"
        "      /diagnostics: {publisher: {reliability: best_effort}}\n"
        "      /markers: {publisher: {durability: transient_local}}\n"
    )
    bench.start("mooring_tracker", params=params, folder=tmp_path)
    (read,) = bench.node.get_subscriptions_info_by_topic("/mooring/m1/offset")
    assert read.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert read.qos_profile.deadline.nanoseconds == 2_000_000_000
    (written,) = bench.node.get_publishers_info_by_topic("/mooring/m1/odometry")
    assert written.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert written.qos_profile.lifespan.nanoseconds == 3_000_000_000
    (diagnostics,) = bench.node.get_publishers_info_by_topic("/diagnostics")
    assert diagnostics.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    (markers,) = bench.node.get_publishers_info_by_topic("/markers")
    assert markers.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_the_recorder_records_best_effort_publishers(bench: Bench, tmp_path: Path) -> None:
    topic = "topics:=[/p geometry_msgs/msg/PointStamped]"
    bench.start("recorder", "-p", f"bag:={tmp_path / 'bag'}", "-p", topic)
    sender = publisher(bench, "/p", Point, BEST_EFFORT)
    reached(bench, sender)
    for k in range(5):
        send(sender, Point(k + 1, np.zeros(3)))
        bench.wait(lambda: taken(bench, "/recorder", "/p") > 0, "a message") if k == 0 else None
    bench.wait(lambda: bench.report("/recorder").recorded["/p"] == 5, "all messages in the bag")


def test_a_bag_whose_latched_topics_carry_no_profile_is_replayed(domain: int, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for record in Bag(REPO / "bags" / "harbour").records(["/buoys/positions", "/buoys/arrivals"]):
            writer.add_topic(record.topic, record.msgtype, latched=False)
            writer.write(record.topic, record.t_ns, record.data)
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: toa_tracker}]")
    given = ("--graph", tmp_path / "graph.yaml")
    live = uwloc("replay", tmp_path / "bag", *given, "--rate", 0, "-o", tmp_path / "live")
    assert live.returncode == 0, live.stderr
    offline = uwloc("process", tmp_path / "bag", *given, "-o", tmp_path / "offline")
    assert offline.returncode == 0, offline.stderr
    expected = fingerprints(Bag(tmp_path / "offline"))
    got = fingerprints(Bag(tmp_path / "live"))
    assert got["/target/odometry"] == expected["/target/odometry"]
    assert got["/target/odometry"].count > 10
