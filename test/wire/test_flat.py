"""CDR written and read at once is what rosbags writes and reads, message by message."""

from typing import Any

import numpy as np
import pytest

from test.wire.test_codec import T_NS, VALUES, assert_same
from uw_acoustic_loc.bag.types import BagMake, decode, deserialize, encode, serialize
from uw_acoustic_loc.core import types as t
from uw_acoustic_loc.wire.codec import codec

FLAT = [value for value in VALUES if codec(type(value)).flat]


def written(value: Any) -> bytes:
    form = codec(type(value))
    return serialize(form.encode(BagMake(), value), form.msgtype)


@pytest.mark.parametrize("value", FLAT, ids=lambda v: type(v).__name__)
@pytest.mark.parametrize("frame", ["map", "odom", "", "auv1/base_link", "ärger"])
def test_bytes_are_those_of_rosbags(value: Any, frame: str) -> None:
    named = type(value)(**{**vars(value), "frame_id": frame})
    data = written(named)
    assert encode(named) == data
    form = codec(type(value))
    expected = form.decode(deserialize(data, form.msgtype), T_NS)
    got = form.flat.unpack(data) if form.flat else None
    assert_same(expected, got)


def test_seven_types_have_no_message_object() -> None:
    assert len(FLAT) == 7


def test_another_layout_is_left_to_the_general_decoder() -> None:
    value = t.Point(T_NS, np.array([1.0, 2.0, 3.0]))
    data, flat = written(value), codec(t.Point).flat
    assert flat is not None
    for other in (b"\0\0" + data[2:], data[:-1], data[:14], data + b"\0", data[:12] + b"\xff" * 4 + data[16:], b""):
        assert flat.unpack(other) is None
    assert_same(decode(t.Point, data, T_NS), value)
    with pytest.raises(ValueError, match="geometry_msgs/msg/PointStamped: 14 bytes cannot be decoded"):
        decode(t.Point, data[:14], T_NS)


def test_refusals_are_those_of_the_message() -> None:
    with pytest.raises(ValueError, match=r"header\.stamp must be set, got 0 ns"):
        decode(t.Point, written(t.Point(0, np.zeros(3))), T_NS)
    bad = t.Imu(T_NS, np.array([0.0, np.nan, 0.0]), np.zeros(3))
    with pytest.raises(ValueError, match=r"angular_velocity must be finite, got \[0\.0, nan, 0\.0\]"):
        decode(t.Imu, written(bad), T_NS)
