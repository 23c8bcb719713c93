"""The buoy tracker's inputs as the world sends them: positions one by one, no std, wrong units, two vehicles."""

import dataclasses
import math

import numpy as np
import pytest

from test.buoy_runs import CONFIG, HARBOUR, inputs_of, run
from uw_acoustic_loc.config import changed
from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.types import Arrivals, NodePositions, Odometry, Pressure
from uw_acoustic_loc.stages.runner import Refusal, Runner
from uw_acoustic_loc.stages.toa_tracker import ToaTrackerStage

MESSAGES = inputs_of(HARBOUR)
NODES, ARRIVALS = MESSAGES[0][1], [value for _, value in MESSAGES[1:] if isinstance(value, Arrivals)]
assert isinstance(NODES, NodePositions)
WEIGHT = CONFIG.pressure.water_density * 9.80665  # Pa/m


def rows_of(nodes: NodePositions, rows: list[int], **changes: object) -> NodePositions:
    columns = {name: getattr(nodes, name)[rows] for name in ("id", "role", "x", "y", "z")}
    return dataclasses.replace(nodes, **columns | changes)  # type: ignore[arg-type]


def runner_of(told: list[Refusal] | None = None, config: ToaConfig = CONFIG) -> Runner:
    return Runner(lambda: ToaTrackerStage(config), 0.5, (told if told is not None else []).append)


def positions(runner: Runner, arrivals: list[Arrivals]) -> list[np.ndarray]:
    out = [e for value in arrivals for e in runner.push("buoys/arrivals", value)] + runner.flush()
    return [value.position for topic, value in out if topic == "target/odometry"]


def test_positions_come_together_from_a_message_per_buoy() -> None:
    whole, apart = runner_of(), runner_of()
    whole.push("buoys/positions", NODES)
    for k in (2, 0, 3, 1):
        apart.push("buoys/positions", rows_of(NODES, [k]))
    for expected, found in zip(positions(whole, ARRIVALS[:30]), positions(apart, ARRIVALS[:30]), strict=True):
        assert found == pytest.approx(expected, abs=1e-6)


def test_a_node_moves_stays_when_it_is_not_mentioned_and_goes_when_it_is_removed() -> None:
    stage = ToaTrackerStage(CONFIG)
    handle = stage.inputs[0].handle
    list(handle(NODES))
    list(handle(rows_of(NODES, [1], x=np.array([500.0]))))
    assert stage._nodes is not None
    assert stage._nodes[0] == [1, 2, 3, 4]
    assert stage._nodes[1][:, 0].tolist() == [-370.0, 500.0, -370.0, 430.0]
    list(handle(rows_of(NODES, [2], role=np.array([NodePositions.REMOVED], np.uint8), x=np.array([math.nan]))))
    assert stage._nodes[0] == [1, 2, 4]


def test_a_refused_table_does_not_take_the_place_of_the_good_one_when_the_clock_restarts() -> None:
    told: list[Refusal] = []
    runner = runner_of(told)
    for k in range(4):
        runner.push("buoys/positions", rows_of(NODES, [k]))
    before = positions(runner, ARRIVALS[:20])
    runner.push("buoys/positions", rows_of(NODES, [0], x=np.array([math.nan])))
    assert [refusal.sentence for refusal in told] == ["positions must be finite, got [[nan, -380.0, 0.0]]"]
    again = positions(runner, ARRIVALS[:20])  # the stamps go back: a new run
    assert runner.counts["", "restarts"] == 1
    assert len(again) == len(before) == 20
    assert again[-1] == pytest.approx(before[-1], abs=1e-6)


@pytest.mark.parametrize("std", [0.0, -1.0, math.nan])
def test_a_std_that_is_not_given_is_the_parameters(std: float) -> None:
    blank = [dataclasses.replace(a, std=np.full(len(a.time), std, np.float32)) for a in ARRIVALS[:30]]
    said = [dataclasses.replace(a, std=np.full(len(a.time), 1e-3)) for a in ARRIVALS[:30]]
    stage, found = run(CONFIG, [MESSAGES[0], *(("buoys/arrivals", a) for a in blank)])
    _, expected = run(CONFIG, [MESSAGES[0], *(("buoys/arrivals", a) for a in said)])
    assert found[-3][1].position.tobytes() == expected[-3][1].position.tobytes()
    assert stage.status().message == "tracking (arrivals without a std are taken to have 0.001 s)"


@pytest.mark.parametrize("std", [math.inf, 1e30])
def test_an_arrival_of_no_precision_says_nothing(std: float) -> None:
    last = ARRIVALS[29]
    stds, time = last.std.copy(), last.time.copy()
    stds[0], time[0] = std, 0.5
    spoilt = [*ARRIVALS[:29], dataclasses.replace(last, std=stds, time=time)]
    _, found = run(CONFIG, [MESSAGES[0], *(("buoys/arrivals", a) for a in spoilt)])
    less = [
        *ARRIVALS[:29],
        dataclasses.replace(last, **{n: getattr(last, n)[1:] for n in ("receiver", "path", "time", "std", "snr")}),
    ]
    _, expected = run(CONFIG, [MESSAGES[0], *(("buoys/arrivals", a) for a in less)])
    assert found[-3][1].position == pytest.approx(expected[-3][1].position, abs=1e-9)


def test_bad_rows_are_a_warning_that_names_them() -> None:
    last = ARRIVALS[-1]
    bad = Arrivals(
        last.t_ns + 10**9,
        np.concatenate([last.receiver, np.full(500, 77, np.uint16)]),
        np.concatenate([last.path, np.ones(500, np.uint8)]),
        np.concatenate([last.time, np.full(500, -0.1)]),
        np.concatenate([last.std, np.full(500, 1e-3, np.float32)]),
        np.concatenate([last.snr, np.zeros(500, np.float32)]),
    )
    status = run(CONFIG, [*MESSAGES, ("buoys/arrivals", bad)])[0].status()
    assert status.level == Status.WARN
    assert status.message == "tracking; rows of the last message that were not used: 500 negative_time"


def test_the_twist_is_in_the_axes_that_its_frame_is_said_to_have() -> None:
    odometry = next(value for topic, value in run(CONFIG, MESSAGES)[1][-3:] if topic == "target/odometry")
    assert isinstance(odometry, Odometry)
    assert odometry.child_frame_id == "target_enu"  # not base_link: its x is not the vehicle's
    assert odometry.quat_xyzw.tolist() == [0, 0, 0, 1]


def with_pressure(of: float, per: float, count: int = 20) -> list[tuple[str, object]]:
    """The harbour's messages with the pressure of 15 m, less `of` Pa, in units of `per` Pa."""
    out: list[tuple[str, object]] = [MESSAGES[0]]
    for arrivals in ARRIVALS[:count]:
        out.append(("pressure", Pressure(arrivals.t_ns - 10**8, (101_325 + 15 * WEIGHT - of) / per)))
        out.append(("buoys/arrivals", arrivals))
    return out


def test_gauge_pressure_is_named_with_its_figure() -> None:
    stage, _ = run(changed(CONFIG, pressure_std=200.0), with_pressure(101_325, 1.0))
    status = stage.status()
    assert status.level == Status.WARN
    assert "the arrivals fit a target 10.1 m below what the pressure says" in status.message
    assert status.message.endswith("m by themselves: a gauge pressure?")


def test_pressure_as_it_should_be_is_no_warning() -> None:
    stage, _ = run(changed(CONFIG, pressure_std=200.0), with_pressure(0.0, 1.0))
    assert stage.status().level == Status.OK


@pytest.mark.parametrize(("per", "unit"), [(1e3, "kPa"), (1e2, "mbar"), (1e4, "dbar"), (1e5, "bar")])
def test_pressure_in_other_units_is_refused_with_the_likely_one(per: float, unit: str) -> None:
    told: list[Refusal] = []
    runner = runner_of(told, changed(CONFIG, pressure_std=200.0))
    for topic, value in with_pressure(0.0, per, 3):
        runner.push(topic, value)
    runner.flush()
    assert f"in {unit}, or a gauge pressure?" in told[0].sentence
    assert unit in runner.stage.status().message


def test_two_vehicles_on_one_topic_are_named() -> None:
    net, other, truth = NODES.positions, [], np.array([200.0, -160.0, -20.0])
    for arrivals in ARRIVALS[:20]:
        images = np.concatenate([net, net * [1, 1, -1] - [0, 0, 80.0]])
        time = np.linalg.norm(truth - images, axis=1) / 1500
        other.append(dataclasses.replace(arrivals, t_ns=arrivals.t_ns + 4 * 10**8, time=time))
    both = [("buoys/arrivals", a) for pair in zip(ARRIVALS[:20], other, strict=True) for a in pair]
    status = run(CONFIG, [MESSAGES[0], *(("buoys/arrivals", a) for a in ARRIVALS[:8]), *both[16:]])[0].status()
    assert status.level == Status.WARN
    assert "some pings fit another target at (200, -160, -20) m: two vehicles on one topic?" in status.message
