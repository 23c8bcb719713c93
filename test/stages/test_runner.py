"""The runner: latched inputs first, refusals counted, a new run of the clock starts a new stage."""

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np
import pytest

from uw_acoustic_loc.contract import Emission, Input, Output, Status
from uw_acoustic_loc.core.types import NodePositions, Point
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
        "header.frame_id must be 'map', got 'odom'",
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
