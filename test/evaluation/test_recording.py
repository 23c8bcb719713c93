"""Which topic is which, whatever namespace it stands in, and what becomes of messages that cannot be read."""

from __future__ import annotations

import math

import numpy as np
import pytest

from test import known_run as run
from uw_acoustic_loc.bag.rosbags_messages import BagMake, serialize
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.types import Bearing, Point, Position, Scalar
from uw_acoustic_loc.evaluation.recording import load
from uw_acoustic_loc.wire.codec import codec


def odometry(time=1.0):
    return run.odometry(time, np.zeros(3), 0.0, np.eye(3), "odom")


def bearing():
    return Bearing(run.t_ns(1.0), 0.5, 1e-4, np.zeros(3))


@pytest.mark.parametrize(
    ("topic", "value", "expected"),
    [
        ("/auv1/sources/a/bearing", bearing(), ("bearing", "/auv1", "a")),
        ("/sources/a/bearing", bearing(), ("bearing", "", "a")),
        ("/fleet/auv1/sources/a/bearing", bearing(), ("bearing", "/fleet/auv1", "a")),
        ("/auv1/sources/a/position", Position(1, np.zeros(3)), ("source", "/auv1", "a")),
        ("/auv1/sources/a/mirror_position", Position(1, np.zeros(3)), ("mirror", "/auv1", "a")),
        ("/auv1/slam/sources/a/position", Position(1, np.zeros(3)), ("slam_source", "/auv1", "a")),
        ("/auv1/slam/odometry", odometry(), ("slam", "/auv1", "")),
        ("/auv1/odometry", odometry(), ("odometry", "/auv1", "")),
        ("/odometry", odometry(), ("odometry", "", "")),
        ("/target/odometry", odometry(), ("target", "", "")),
        ("/net2/target/sound_speed", Scalar(1, 1500.0), ("sound_speed", "/net2", "")),
        ("/mooring/m1/odometry", odometry(), ("mooring", "", "m1")),
        ("/mooring/m1/offset", Point(1, np.zeros(3)), ("offset", "", "m1")),
        ("/truth/auv1/odometry", odometry(), ("true_vehicle", "", "auv1")),
        ("/truth/target/odometry", odometry(), ("true_target", "", "")),
        ("/truth/mooring/m1/odometry", odometry(), ("true_mooring", "", "m1")),
        ("/truth/sources/a/position", Point(1, np.zeros(3)), ("true_source", "", "a")),
    ],
)
def test_roles(recorded, topic, value, expected):
    (series,) = recorded([(run.t_ns(1.0), topic, value)]).series
    assert (series.role, series.space, series.id) == expected


def test_truth_is_never_an_estimate(recorded):
    assert recorded([(run.t_ns(1.0), "/truth/auv1/slam/odometry", odometry())]).series == ()


def test_a_name_of_ours_with_another_type_is_left_alone(recorded):
    recording = recorded([(run.t_ns(1.0), "/auv1/odometry", bearing())])
    assert recording.series == ()
    assert recording.traffic["/auv1/odometry"].log_ns.size == 1


def test_values_in_stamp_order_with_their_log_times(recorded):
    events = [(run.t_ns(5.0), "/odometry", odometry(2.0)), (run.t_ns(6.0), "/odometry", odometry(1.0))]
    (series,) = recorded(events).series
    assert series.t_ns.tolist() == [run.t_ns(1.0), run.t_ns(2.0)]
    assert series.log_ns.tolist() == [run.t_ns(6.0), run.t_ns(5.0)]


def test_without_a_header_the_log_time_is_the_stamp(recorded):
    (series,) = recorded([(run.t_ns(3.0), "/target/sound_speed", Scalar(0, 1500.0))]).series
    assert series.t_ns.tolist() == [run.t_ns(3.0)]


def test_messages_that_cannot_be_read_are_counted(tmp_path):
    form = codec(Bearing)
    good = serialize(form.encode(BagMake(), bearing()), form.msgtype)
    bad = serialize(form.encode(BagMake(), Bearing(run.t_ns(1.0), math.nan, 0.1, np.zeros(3))), form.msgtype)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/sources/a/bearing", form.msgtype)
        for k, data in enumerate((bad, good, b"\x00\x01", bad)):
            writer.write("/sources/a/bearing", run.t_ns(k), data)
    recording = load(tmp_path / "bag")
    assert len(recording.series[0].values) == 1
    assert recording.traffic["/sources/a/bearing"].log_ns.size == 4
    assert recording.refused == {
        "/sources/a/bearing": "3 not read: pose.orientation must be finite, got [0.0, 0.0, nan, nan]"
    }


def test_a_damaged_bag_is_read_as_far_as_it_goes(tmp_path):
    events = [(run.t_ns(k), "/odometry", odometry(k)) for k in range(1, 9000)]
    path = run.write_bag(tmp_path / "bag", events)
    file = path / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    recording = load(path)
    assert 0 < len(recording.series[0].values) < 9000
    assert len(recording.damage) == 1


def test_no_bag(tmp_path):
    with pytest.raises(ValueError, match="does not exist"):
        load(tmp_path / "nothing")


def test_span_and_name(recorded):
    recording = recorded([(run.t_ns(1.0), "/odometry", odometry()), (run.t_ns(9.0), "/odometry", odometry())])
    assert recording.span == (run.t_ns(1.0), run.t_ns(9.0))
    assert recording.name == "bag"
