"""Every estimator with damaged messages: what it cannot use is counted and said, and only numbers come out."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from test.fuzz.damage import HARM, harmed
from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import BagMake, deserialize
from uw_acoustic_loc.graph import load_graph
from uw_acoustic_loc.resolved_graph import ResolvedStage, resolve_stage
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.stages.catalog import STAGES
from uw_acoustic_loc.stages.runner import Refusal, Runner
from uw_acoustic_loc.wire.codec import codec

BAG = Path(__file__).parents[2] / "bags" / "harbour"
LONGEST = {"bearing": 60, "bearing_slam": 300}  # messages

Stream = list[tuple[str, Any, int]]  # the stage's own topic, message, log time


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Bag:
    """The harbour bag with the bearings that the next estimators need."""
    out = tmp_path_factory.mktemp("fuzz") / "out"
    graph = load_graph(resource("config/harbour/graph.yaml"))
    OfflineRun(Bag(BAG), graph, lambda *_: None).run(out, keep_inputs=True, progress=lambda _: None)
    return Bag(out)


@pytest.fixture(scope="module", params=[*STAGES])
def fed(request: pytest.FixtureRequest, full: Bag) -> Fed:
    graph = load_graph(resource("config/harbour/graph.yaml"))
    node = next(node for node in graph.nodes if node.executable == request.param)
    stage = resolve_stage(node)
    stream = [
        (stage.inputs[r.topic].topic, deserialize(r.data, r.msgtype), r.t_ns) for r in full.records([*stage.inputs])
    ]
    return Fed(stage, stream[: LONGEST.get(request.param, 250)])


@dataclasses.dataclass(frozen=True, repr=False)
class Fed:
    """An estimator and what it hears."""

    stage: ResolvedStage
    stream: Stream

    def run(self, stream: Stream) -> tuple[Runner, list[tuple[str, Any]]]:
        told: list[Refusal] = []
        runner = Runner(self.stage.make_stage, self.stage.lateness, told.append)
        kinds = {wanted.topic: wanted.kind for wanted in self.stage.inputs.values()}
        said: list[tuple[str, Any]] = []
        for topic, message, t_ns in stream:
            try:
                value = codec(kinds[topic]).decode(message, t_ns)
            except ValueError as error:
                runner.malformed(topic, str(error))
                continue
            said += runner.push(topic, value)
        said += runner.flush()
        runner.stage.status()
        for refusal in told:
            assert refusal.sentence
        return runner, said


@settings(max_examples=settings.default.max_examples // 4)
@given(
    harm=st.lists(st.tuples(st.floats(0, 1), HARM), min_size=1, max_size=12),
    everything_of=st.one_of(st.none(), st.tuples(st.integers(0, 9), HARM)),
)
def test_damaged_messages_are_refused_or_used_and_only_numbers_come_out(
    fed: Fed, harm: list[tuple[float, Any]], everything_of: Any
) -> None:
    stream = list(fed.stream)
    for where, (kind, place, value) in harm:
        at = int(where * len(stream)) if stream else 0
        for topic, message, t_ns in stream[at : at + 1]:
            stream[at : at + 1] = [(topic, one, t_ns) for one in harmed(message, kind, place, value)]
    if everything_of:  # a sensor that is broken for good
        number, (kind, place, value) = everything_of
        topics = sorted({topic for topic, _, _ in stream})
        broken = topics[number % len(topics)] if topics else ""
        stream = [
            (topic, one, t_ns)
            for topic, message, t_ns in stream
            for one in (harmed(message, kind, place, value) if topic == broken else [message])
        ]
    with np.errstate(all="ignore"):
        _, said = fed.run(stream)
    for topic, value in said:
        check(topic, value)


def test_undamaged_messages_are_all_used(fed: Fed) -> None:
    runner, said = fed.run(fed.stream)
    assert said
    assert not [key for key in runner.counts if key[1] in ("malformed", "rejected")]
    for topic, value in said:
        check(topic, value)


def check(topic: str, value: Any) -> None:
    """Finite, with covariances that may be, and readable by whoever subscribes."""
    for field in dataclasses.fields(value):
        part = getattr(value, field.name)
        if isinstance(part, float | np.ndarray) and np.asarray(part).dtype.kind == "f":
            assert np.isfinite(part).all(), f"{topic}: {field.name} = {part}"
        if field.name in ("cov", "pose_cov", "twist_cov"):
            diagonal = np.diag(part)
            assert ((diagonal >= 0) | (diagonal == -1)).all(), f"{topic}: {field.name} has variances {diagonal}"
    form = codec(type(value))
    form.decode(form.encode(BagMake(), value), getattr(value, "t_ns", 1))
