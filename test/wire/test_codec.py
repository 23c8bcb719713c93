"""Round trips of every core type through rosbags' and rclpy's message classes, and CDR between the two."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from uw_acoustic_loc.bag.rosbags_messages import BagMake, deserialize, serialize
from uw_acoustic_loc.core import types as t
from uw_acoustic_loc.core.geometry import quat_from_rpy
from uw_acoustic_loc.ros.rclpy_messages import RosMake, message_class
from uw_acoustic_loc.wire.codec import codec
from uw_acoustic_loc.wire.record import layout

RNG = np.random.default_rng(1)
T_NS = 1_780_272_000_123_456_789


def cov(size: int) -> np.ndarray:
    root = RNG.normal(size=(size, size))
    return root @ root.T


def rows(record: str, count: int = 5) -> dict[str, Any]:
    return {column: (RNG.uniform(0, 100, count)).astype(kind) for column, kind in layout(record).columns}


def counts() -> np.ndarray:
    return RNG.integers(-32768, 32767, 100).astype(np.int16)


VALUES = [
    t.HydrophoneInfo(T_NS, 1e5, 0.6, 1500.0, 1e-3),
    t.Samples(T_NS, RNG.normal(size=100).astype(np.float32), RNG.normal(size=100).astype(np.float32)),
    t.Samples(T_NS, counts(), counts()),
    t.Bearing(T_NS, -2.5, 0.01, np.array([1.0, 2.0, 3.0])),
    t.Odometry(T_NS, RNG.normal(size=3), quat_from_rpy(0.1, -0.2, 3.0), np.ones(3), -np.ones(3), cov(6), cov(6)),
    t.Imu(T_NS, RNG.normal(size=3), RNG.normal(size=3), cov(3), cov(3)),
    t.BodyVelocity(T_NS, RNG.normal(size=3), cov(3)),
    t.Position(T_NS, RNG.normal(size=3), cov(3)),
    t.Point(T_NS, RNG.normal(size=3)),
    t.Scalar(T_NS, 1499.5),
    t.Pressure(T_NS, 251_325.0, 400.0),
    t.Particles(T_NS, **rows("Particle")),
    t.NodePositions(T_NS, **rows("NodePosition")),
    t.Arrivals(T_NS, **rows("Arrival")),
    t.Arrivals(T_NS, **rows("Arrival", 0)),
    t.Detections(T_NS, **rows("BistaticDetection")),
    t.ArrivalPaths(T_NS, **rows("ArrivalPath")),
    t.Tracks(T_NS, **rows("Track")),
]


def assert_same(value: Any, other: Any) -> None:
    assert type(value) is type(other)
    for field in dataclasses.fields(value):
        left, right = getattr(value, field.name), getattr(other, field.name)
        if isinstance(left, np.ndarray):
            assert left.dtype == right.dtype, field.name
        np.testing.assert_allclose(left, right, rtol=0, atol=1e-12) if not isinstance(left, str) else None
        assert not isinstance(left, str) or left == right


@pytest.mark.parametrize("value", VALUES, ids=lambda v: type(v).__name__)
def test_offline_and_live_messages_carry_the_same(value: Any) -> None:
    form = codec(type(value))
    offline = form.encode(BagMake(), value)
    live = form.encode(RosMake(), value)
    assert_same(value, form.decode(offline, T_NS))
    assert_same(value, form.decode(live, T_NS))
    # equal but for the padding between fields, which rclpy leaves as it finds it
    offline_bytes, live_bytes = serialize(offline, form.msgtype), serialize_message(live)
    assert len(offline_bytes) == len(live_bytes)
    assert_same(value, form.decode(deserialize(live_bytes, form.msgtype), T_NS))
    assert_same(value, form.decode(deserialize_message(offline_bytes, message_class(form.msgtype)), T_NS))


def message(value: Any) -> Any:
    return codec(type(value)).encode(RosMake(), value)


def sentence(kind: type, msg: Any) -> str:
    with pytest.raises(ValueError) as caught:
        codec(kind).decode(msg, T_NS)
    return str(caught.value)


def test_a_zero_stamp_is_refused() -> None:
    assert "header.stamp must be set" in sentence(t.Point, message(t.Point(0, np.zeros(3))))


def test_nan_is_refused() -> None:
    assert sentence(t.Point, message(t.Point(T_NS, np.array([0.0, np.nan, 0.0])))) == (
        "point must be finite, got [0.0, nan, 0.0]"
    )
    bad = t.Odometry(T_NS, np.full(3, np.inf), quat_from_rpy(0, 0, 0), np.zeros(3), np.zeros(3))
    assert "pose.position must be finite" in sentence(t.Odometry, message(bad))


def test_a_quaternion_without_length_is_refused() -> None:
    bad = t.Odometry(T_NS, np.zeros(3), np.zeros(4), np.zeros(3), np.zeros(3))
    assert sentence(t.Odometry, message(bad)) == "pose.orientation must have length 1, got 0"


def test_a_missing_column_is_named() -> None:
    msg = message(t.Particles(T_NS, **rows("Particle")))
    assert sentence(t.Arrivals, msg) == "Arrival: column 'receiver' is missing"


def test_a_wrong_column_type_is_named() -> None:
    msg = message(t.Particles(T_NS, **rows("Particle")))
    msg.fields[1].datatype = 8
    assert sentence(t.Particles, msg) == "Particle: column 'y' must be float32, got float64 x 1"


def test_float32_in_the_place_of_float64_is_widened() -> None:
    ids, ones, time = np.array([1, 2], np.uint16), np.ones(2, np.float32), np.array([0.1, 0.30000001], np.float32)
    msg = message(t.Arrivals(T_NS, ids, ones.astype(np.uint8), time.astype(float), ones, ones))
    narrow = np.zeros(2, [("receiver", "<u2"), ("path", "u1"), ("time", "<f4"), ("std", "<f4"), ("snr", "<f4")])
    narrow["receiver"], narrow["path"], narrow["time"], narrow["std"], narrow["snr"] = ids, 1, time, 1, 1
    for field in msg.fields:
        field.offset = narrow.dtype.fields[field.name][1]
        field.datatype = 7 if field.name == "time" else field.datatype
    msg.point_step, msg.row_step, msg.data = narrow.itemsize, narrow.nbytes, np.frombuffer(narrow.tobytes(), np.uint8)
    found = codec(t.Arrivals).decode(msg, T_NS)
    assert found.time.dtype == np.float64
    assert found.time.tolist() == [float(value) for value in time]  # not one bit is lost


def test_a_wrong_length_is_named() -> None:
    msg = message(t.Particles(T_NS, **rows("Particle")))
    msg.width += 1
    assert sentence(t.Particles, msg) == "Particle: data must have 6 x 16 bytes, got 80"


def test_a_column_beyond_the_row_is_named() -> None:
    msg = message(t.Particles(T_NS, **rows("Particle")))
    msg.fields[3].offset = 14
    assert sentence(t.Particles, msg) == "Particle: column 'weight' lies beyond the row of 16 bytes"


def test_columns_may_come_in_any_order_with_padding_and_big_endian() -> None:
    wide = np.zeros(3, dtype=[("extra", ">f4"), ("weight", ">f4"), ("z", ">f4"), ("y", ">f4"), ("x", ">f4")])
    wide["x"], wide["weight"] = [1, 2, 3], [0.5, 0.25, 0.25]
    msg = message(t.Particles(T_NS, **rows("Particle", 3)))
    make = RosMake()
    msg.fields = [
        make("sensor_msgs/msg/PointField", name=name, offset=4 * k, datatype=7, count=1)
        for k, name in enumerate(wide.dtype.names)
    ]
    msg.point_step, msg.row_step, msg.is_bigendian = 20, 60, True
    msg.data = make.uint8_array(wide.tobytes())
    value = codec(t.Particles).decode(msg, T_NS)
    np.testing.assert_array_equal(value.x, [1, 2, 3])
    np.testing.assert_array_equal(value.weight, [0.5, 0.25, 0.25])


def test_bytes_that_are_no_message_are_refused() -> None:
    with pytest.raises(ValueError, match="nav_msgs/msg/Odometry: 3 bytes cannot be decoded"):
        deserialize(b"abc", "nav_msgs/msg/Odometry")
