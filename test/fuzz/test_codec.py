"""The codec with any bytes and any damage: a core value, or ValueError with a sentence."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from test.fuzz.damage import HARM, harmed
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import deserialize
from uw_acoustic_loc.core.types import Arrivals, Detections, HydrophoneInfo, Imu, NodePositions, Odometry, Samples
from uw_acoustic_loc.wire.codec import codec

from .test_stages import BAG

KINDS = {
    "/auv1/hydrophones/info": HydrophoneInfo,
    "/auv1/hydrophones/samples": Samples,
    "/auv1/imu/data": Imu,
    "/auv1/odometry": Odometry,
    "/buoys/arrivals": Arrivals,
    "/buoys/positions": NodePositions,
    "/sonar/detections": Detections,
}
FIRST = {topic: next(Bag(BAG).records([topic])) for topic in KINDS}


def read(topic: str, make: Any) -> None:
    try:
        value = codec(KINDS[topic]).decode(make(), 1)
    except ValueError as error:
        assert str(error)
        return
    assert value.t_ns > 0


@pytest.mark.parametrize("topic", KINDS)
@given(harm=st.lists(HARM, min_size=1, max_size=3))
def test_damaged_messages(topic: str, harm: list[Any]) -> None:
    message = deserialize(FIRST[topic].data, FIRST[topic].msgtype)
    for one in harm:
        message = next(iter(harmed(message, *one)), message)
    read(topic, lambda: message)


@pytest.mark.parametrize("topic", KINDS)
@given(where=st.floats(0, 1), piece=st.binary(max_size=8), cut=st.booleans())
def test_damaged_bytes(topic: str, where: float, piece: bytes, cut: bool) -> None:
    data = bytearray(FIRST[topic].data)
    at = int(where * min(len(data), 400))  # where the fields are, not in the middle of the samples
    data[at : at + len(piece)] = piece
    read(topic, lambda: deserialize(bytes(data[:at] if cut else data), FIRST[topic].msgtype))
