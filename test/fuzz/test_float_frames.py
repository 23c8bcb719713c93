"""Hydrophone frames in float32 with damaged samples: refused with a sentence or used, and only numbers come out."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import BagMake, decode
from uw_acoustic_loc.core.types import HydrophoneInfo, Samples
from uw_acoustic_loc.graph import load_graph
from uw_acoustic_loc.resolved_graph import resolve_stage
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.stages.bearing import BearingStage
from uw_acoustic_loc.wire.codec import codec

from .test_stages import BAG, check

FRAMES = 30  # 0.1 s each; the noise floor forgets a loud beginning within 2 s
TINY, HUGE = float(np.finfo(np.float32).smallest_subnormal), float(np.finfo(np.float32).max)
SAMPLES = [np.nan, np.inf, -np.inf, TINY, -TINY, 1e-38, 0.0, 1e3, 1e10, -1e20, HUGE, -HUGE]
PLACES = st.tuples(st.integers(0, 1), st.floats(0, 1), st.sampled_from([1, 2, 50, 3000, 10_000]))
HARM = st.one_of(
    st.tuples(st.just("set"), PLACES, st.sampled_from(SAMPLES)),
    st.tuples(st.just("scale"), PLACES, st.sampled_from([0.0, TINY, 1e-38, 1e-20, 1e10, 1e30, 1e38])),
    st.tuples(st.just("alternate"), PLACES, st.sampled_from([TINY, 1e10, 1e20, HUGE])),
)


@pytest.fixture(scope="module")
def recorded() -> tuple[HydrophoneInfo, list[Samples]]:
    bag = Bag(BAG)
    (info,) = (decode(HydrophoneInfo, r.data, r.t_ns) for r in bag.records(["/auv1/hydrophones/info"]))
    counts = [decode(Samples, r.data, r.t_ns) for r in bag.records(["/auv1/hydrophones/samples"])][:FRAMES]
    scale = np.float32(info.scale)
    return info, [dataclasses.replace(frame, h0=frame.h0 * scale, h1=frame.h1 * scale) for frame in counts]


def harmed(frame: Samples, kind: str, place: tuple[int, float, int], value: float) -> Samples:
    channels = [frame.h0.copy(), frame.h1.copy()]
    channel, where, length = place
    begin = int(where * (channels[channel].size - 1))
    part = channels[channel][begin : begin + length]
    if kind == "set":
        part[:] = value
    elif kind == "scale":
        part *= np.float32(value)
    else:
        part[::2], part[1::2] = value, -value
    return dataclasses.replace(frame, h0=channels[0], h1=channels[1])


def run(info: HydrophoneInfo, frames: list[Samples]) -> tuple[BearingStage, list[tuple[int, str, Any]]]:
    """The stage, and what it says with each frame's number; a refused frame had samples that no hydrophone has."""
    graph = load_graph(resource("config/harbour/graph.yaml"))
    stage = resolve_stage(next(node for node in graph.nodes if node.executable == "bearing")).make_stage()
    assert isinstance(stage, BearingStage)
    handlers = {wanted.kind: wanted.handle for wanted in stage.inputs}
    list(handlers[HydrophoneInfo](info))
    form = codec(Samples)

    def said() -> Iterator[tuple[int, str, Any]]:
        for k, frame in enumerate(frames):
            received = form.decode(form.encode(BagMake(), frame), frame.t_ns)
            assert received.h0.dtype == np.float32
            try:
                yield from ((k, topic, value) for topic, value in handlers[Samples](received))
            except ValueError as error:
                assert "must be finite" in str(error) or "must be within 1e+10 Pa" in str(error)
                assert not (np.abs([frame.h0, frame.h1]) <= 1e10).all()

    return stage, list(said())


@pytest.mark.xfail(strict=False, reason="after some damage the detector's statistics need longer than this run")
@given(harm=st.lists(st.tuples(st.integers(0, FRAMES - 25), HARM), min_size=1, max_size=4))
@example(harm=[(2, ("set", (0, 0.0, 10_000), HUGE))])
@example(harm=[(2, ("alternate", (0, 0.0, 10_000), HUGE)), (2, ("alternate", (1, 0.0, 10_000), HUGE))])
@example(harm=[(2, ("scale", (0, 0.0, 10_000), TINY)), (2, ("scale", (1, 0.0, 10_000), TINY))])
def test_damaged_samples(recorded: tuple[HydrophoneInfo, list[Samples]], harm: list[tuple[int, Any]]) -> None:
    info, frames = recorded[0], list(recorded[1])
    with np.errstate(all="ignore"):
        for at, (kind, place, value) in harm:
            frames[at] = harmed(frames[at], kind, place, value)
        stage, said = run(info, frames)
    for _, topic, value in said:
        check(topic, value)
    numbers = [value for value in stage.status().values.values() if isinstance(value, float)]
    assert np.isfinite(numbers).all(), stage.status().values
    assert any(k == FRAMES - 1 and "bearing" in topic for k, topic, _ in said), "it hears again"
