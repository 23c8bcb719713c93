"""The runner: latched inputs first, refusals counted, a new run of the clock starts a new stage."""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import pytest

from uw_acoustic_loc.contract import Emission, Input, Output, Status
from uw_acoustic_loc.core.types import NodePositions, Point
from uw_acoustic_loc.stages.inputs.settings import InputConfig
from uw_acoustic_loc.stages.runner import Refusal, Runner

SECOND = 1_000_000_000


class Echo:
    """Says every point again, with the number of points that this stage has seen; refuses x < 0."""

    Config: ClassVar[type] = object

    def __init__(self) -> None:
        self.seen = 0
        self.buoys = 0

    @property
    def inputs(self) -> tuple[Input, ...]:
        return (
            Input("buoys", NodePositions, self._on_buoys, latched=True),
            Input("point", Point, self._on_point, frame="map"),
        )

    @property
    def outputs(self) -> tuple[Output, ...]:
        return (Output("echo", Point),)

    def _on_buoys(self, value: NodePositions) -> list[Emission]:
        self.buoys = len(value.id)
        return []

    def _on_point(self, value: Point) -> Iterator[Emission]:
        if value.position[0] < 0:
            raise ValueError(f"x must not be negative, got {value.position[0]:g}")
        self.seen += 1
        yield "echo", Point(value.t_ns, np.array([self.seen, self.buoys, 0.0]))

    def status(self) -> Status:
        return Status()

    def change(self, config: Any) -> None:
        raise NotImplementedError


BUOYS = NodePositions(1, *(np.zeros(4) for _ in range(5)))


def point(second: float, x: float = 0.0, frame: str = "map") -> Point:
    return Point(int(second * SECOND), np.array([x, 0.0, 0.0]), frame)


@pytest.fixture
def told() -> list[Refusal]:
    return []


@pytest.fixture
def runner(told: list[Refusal]) -> Runner:
    return Runner(Echo, 0.5, told.append)


def test_streams_wait_for_latched_inputs(runner: Runner) -> None:
    assert list(runner.push("point", point(1))) == []
    assert runner.missing == ["buoys"]
    out = list(runner.push("buoys", BUOYS))
    assert [value.position.tolist() for _, value in out] == [[1, 4, 0]]
    assert runner.missing == []


def test_refusals_are_counted_by_kind_and_nothing_else_is_lost(runner: Runner, told: list[Refusal]) -> None:
    list(runner.push("buoys", BUOYS))
    list(runner.push("point", point(1)))
    list(runner.push("point", point(2, x=-3)))
    list(runner.push("point", point(3, frame="odom")))
    list(runner.push("point", point(4, frame="ship/map")))
    list(runner.push("point", point(3.5)))
    runner.malformed("point", "data must have 4 bytes, got 3")
    assert {what: n for (topic, what), n in runner.counts.items() if topic == "point"} == {
        "received": 6,
        "used": 2,
        "rejected": 1,
        "malformed": 2,
        "late": 1,
    }
    assert runner.counts["echo", "published"] == 2
    assert [refusal.sentence for refusal in told] == [
        "x must not be negative, got -3",
        "header.frame_id must be 'map', got 'odom': if that is right, set inputs.point.accept_frames, and where the"
        " sensor sits",
        "stamp 3500000000 ns came after one of the same topic at 4000000000 ns",
        "data must have 4 bytes, got 3",
    ]


def test_a_new_run_of_the_clock_starts_a_new_stage(runner: Runner, told: list[Refusal]) -> None:
    list(runner.push("buoys", BUOYS))
    for second in range(100, 105):
        list(runner.push("point", point(second)))
    again = [emission for second in range(1, 6) for emission in runner.push("point", point(second))]
    assert [int(value.position[0]) for _, value in again] == [1, 2, 3, 4, 5]
    assert all(value.position[1] == 4 for _, value in again), "latched inputs are given to the new stage"
    assert any("the clock was set back" in refusal.sentence for refusal in told)
    assert runner.counts["", "restarts"] == 1
    assert runner.counts["point", "late"] == 0


def test_a_bug_is_not_swallowed() -> None:
    class Broken(Echo):
        def _on_point(self, value: Point) -> Iterator[Emission]:
            raise KeyError("bug")

    runner = Runner(Broken, 0.5, print)
    list(runner.push("buoys", BUOYS))
    with pytest.raises(KeyError):
        list(runner.push("point", point(1)))


# --- what inputs are told and say -------------------------------------------------------------------------------------


def buoys(x: float, t_ns: int = 1) -> NodePositions:
    return NodePositions(t_ns, *(np.full(4, x) for _ in range(5)))


def test_a_latched_message_that_repeats_itself_changes_nothing(runner: Runner) -> None:
    calls = []
    runner.stage._on_buoys = lambda value: calls.append(value) or []  # type: ignore[method-assign]
    runner._inputs = {i.topic: i for i in runner.stage.inputs}
    for second in range(1, 6):
        runner.push("buoys", buoys(3.0, second * SECOND))
        runner.push("point", point(second))
    assert len(calls) == 1
    assert runner.counts["buoys", "repeated"] == 4 and runner.counts["buoys", "received"] == 5
    runner.push("buoys", buoys(4.0, 5 * SECOND))
    assert len(calls) == 2
    assert "what it says has changed" in str(runner.status().values["buoys note"])


def test_a_refused_latched_message_does_not_replace_the_good_one(told: list[Refusal]) -> None:
    class Careful(Echo):
        def _on_buoys(self, value: NodePositions) -> list[Emission]:
            if not np.isfinite(value.x).all():
                raise ValueError("x must be finite")
            return super()._on_buoys(value)

    runner = Runner(Careful, 0.5, told.append)
    runner.push("buoys", buoys(np.nan))
    assert runner.missing == ["buoys"], "what was refused is not there"
    runner.push("buoys", buoys(3.0))
    for second in range(100, 105):
        runner.push("point", point(second))
    runner.push("buoys", buoys(np.inf))
    again = [emission for second in range(1, 6) for emission in runner.push("point", point(second))]
    assert runner.counts["", "restarts"] == 1
    assert [value.position[1] for _, value in again] == [4.0] * 5


def test_a_stamp_offset_moves_the_stamps_of_one_input(told: list[Refusal]) -> None:
    runner = Runner(Echo, 0.5, told.append, {"point": InputConfig(stamp_offset=-18.0)})
    runner.push("buoys", BUOYS)
    assert [value.t_ns for _, value in runner.push("point", point(20))] == [2 * SECOND]


def test_it_says_why_it_used_nothing(runner: Runner) -> None:
    assert runner.idle_reason() == ""
    runner.push("point", point(1))
    assert runner.idle_reason() == "used none of 1 messages: it waits for buoys"
    runner.push("buoys", BUOYS)
    assert runner.idle_reason() == ""


class Pair(Echo):
    """Two inputs, of which it does without one."""

    @property
    def inputs(self) -> tuple[Input, ...]:
        return (
            Input("point", Point, self._on_point),
            Input("other", Point, lambda _: []),
            Input("extra", Point, lambda _: [], optional=True),
        )


def faults_of(offset: float, seconds: float = 8.0, topics: tuple[str, ...] = ("other", "extra")) -> str:
    runner = Runner(Pair, 0.5, lambda _: None)
    for k in range(int(seconds * 20)):
        runner.push("point", point(100 + 0.05 * k + offset))
        for topic in topics:
            runner.push(topic, point(100 + 0.05 * k))
    return runner.status().message


def test_healthy_inputs_are_not_doubted() -> None:
    assert faults_of(0.0) == faults_of(0.1) == "running"


def test_a_clock_that_is_off_is_named_with_its_offset_and_the_cure() -> None:
    """To within the interval of the messages."""
    assert "stamps of point are 0.350 s ahead of other, extra" in faults_of(0.3)
    assert "stamps of point are 18.050 s ahead of other, extra" in faults_of(18.0)
    assert "set inputs.point.stamp_offset to 18.000" in faults_of(-18.0)
    assert "behind other, extra" in faults_of(-18.0)


def test_an_input_that_never_comes_is_named() -> None:
    said = faults_of(0.0, topics=("other",))
    assert said == "nothing on extra for 8 s: the estimator does without"
    assert "nothing on other for 8 s" in faults_of(0.0, topics=("extra",))


def test_the_lateness_that_would_have_done_is_said() -> None:
    runner = Runner(Pair, 0.5, lambda _: None)
    for k in range(100):
        runner.push("point", point(100 + 0.05 * k))
        if k >= 20 and k % 2:
            runner.push("other", point(100 + 0.05 * (k - 20)))
    assert "other came too late: with a lateness of 1.0 s nothing would have been lost" in runner.status().message
