"""CDR written and read at once is what rosbags writes and reads, message by message."""

from typing import Any

import numpy as np
import pytest

from test.wire.test_codec import T_NS, VALUES, assert_same
from uw_acoustic_loc.bag.rosbags_messages import BagMake, decode, deserialize, encode, serialize
from uw_acoustic_loc.core import types as t
from uw_acoustic_loc.wire.codec import codec

DIRECT = [value for value in VALUES if codec(type(value)).cdr]


def written(value: Any) -> bytes:
    form = codec(type(value))
    return serialize(form.encode(BagMake(), value), form.msgtype)


@pytest.mark.parametrize("value", DIRECT, ids=lambda v: type(v).__name__)
@pytest.mark.parametrize("frame", ["map", "odom", "", "auv1/base_link", "ärger"])
def test_bytes_are_those_of_rosbags(value: Any, frame: str) -> None:
    named = type(value)(**{**vars(value), "frame_id": frame})
    data = written(named)
    assert encode(named) == data
    form = codec(type(value))
    expected = read(form, data)
    got = form.cdr.unpack(data) if form.cdr else None
    assert_same(expected, got)


def test_all_types_but_the_one_without_a_stamp_need_no_message_object() -> None:
    assert [type(value) for value in VALUES if value not in DIRECT] == [t.Scalar]


def test_another_layout_is_left_to_the_general_decoder() -> None:
    value = t.Point(T_NS, np.array([1.0, 2.0, 3.0]))
    data, flat = written(value), codec(t.Point).cdr
    assert flat is not None
    for other in (b"\0\0" + data[2:], data[:-1], data[:14], data + b"\0", data[:12] + b"\xff" * 4 + data[16:], b""):
        assert flat.unpack(other) is None
    assert_same(decode(t.Point, data, T_NS), value)
    with pytest.raises(ValueError, match="geometry_msgs/msg/PointStamped: 14 bytes cannot be decoded"):
        decode(t.Point, data[:14], T_NS)


@pytest.mark.parametrize("value", DIRECT, ids=lambda v: type(v).__name__)
def test_damaged_bytes_say_what_the_general_decoder_makes_of_them(value: Any) -> None:
    """Any other byte, and any cut: refused alike, left to it, or the same value."""
    form, data, rng = codec(type(value)), written(value), np.random.default_rng(1)
    for at in range(min(len(data), 400)):
        flipped = data[:at] + bytes([data[at] ^ int(rng.integers(1, 256))]) + data[at + 1 :]
        for damaged in (flipped, data[:at]):
            assert form.cdr is not None
            direct, general = outcome(lambda d=damaged: form.cdr.unpack(d)), outcome(lambda d=damaged: read(form, d))
            if isinstance(direct, str) or isinstance(general, str):
                assert direct in (None, general), at
            elif direct is not None:
                assert_same(general, direct)


def read(form: Any, data: bytes) -> Any:
    return form.decode(deserialize(data, form.msgtype), T_NS)


def outcome(act: Any) -> Any:
    """What it returns, or the sentence with which it refuses."""
    try:
        return act()
    except ValueError as error:
        return str(error)


def test_refusals_are_those_of_the_message() -> None:
    with pytest.raises(ValueError, match=r"header\.stamp must be set, got 0 ns"):
        decode(t.Point, written(t.Point(0, np.zeros(3))), T_NS)
    bad = t.Imu(T_NS, np.array([0.0, np.nan, 0.0]), np.zeros(3))
    with pytest.raises(ValueError, match=r"angular_velocity must be finite, got \[0\.0, nan, 0\.0\]"):
        decode(t.Imu, written(bad), T_NS)
