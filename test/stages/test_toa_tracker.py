import dataclasses

import numpy as np
import pytest

from test.buoy_runs import CONFIG, HARBOUR, inputs_of, run
from uw_acoustic_loc.config import changed
from uw_acoustic_loc.contract import Emission, Status
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.types import Arrivals, NodePositions, Odometry, Pressure, Scalar
from uw_acoustic_loc.sim.buoys import BuoySource
from uw_acoustic_loc.sim.scenario import Scenario
from uw_acoustic_loc.stages.runner import Refusal, Runner
from uw_acoustic_loc.stages.toa_tracker import ToaTrackerStage


def errors(scenario: Scenario, config: ToaConfig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance (n,), NEES of the position (n,) and error of the sound speed (n,) per ping."""
    truth = {v.t_ns: v for _, t, v in BuoySource(scenario).events() if t == "/truth/target/odometry"}
    speed = {v.t_ns: v.value for _, t, v in BuoySource(scenario).events() if t == "/truth/target/sound_speed"}
    _, emissions = run(config, inputs_of(scenario))
    found = [v for t, v in emissions if t == "target/odometry"]
    offsets = [v.position - truth[v.t_ns].position for v in found]
    nees = [d @ np.linalg.solve(v.pose_cov[:3, :3], d) / 3 for d, v in zip(offsets, found, strict=True)]
    heard = [v.value - speed[v.t_ns] for t, v in emissions if t == "target/sound_speed"]
    return np.linalg.norm(offsets, axis=1), np.array(nees), np.array(heard)


@pytest.mark.parametrize("cold_start", [True, False])
@pytest.mark.parametrize("outliers", [0.0, 0.1])
def test_harbour(cold_start: bool, outliers: float) -> None:
    config = changed(CONFIG, cold_start=cold_start, initial_position=(0.0, 0.0, -15.0))
    assert HARBOUR.buoys
    buoys = dataclasses.replace(HARBOUR.buoys, outlier_fraction=outliers)
    results = [errors(dataclasses.replace(HARBOUR, seed=seed, buoys=buoys), config) for seed in range(1, 9)]
    assert all(len(distance) == 121 for distance, _, _ in results)
    assert np.mean([distance[10:].mean() for distance, _, _ in results]) < 4.0
    assert 0.7 < np.mean([nees[10:].mean() for _, nees, _ in results]) < 1.4
    assert np.mean([np.sqrt(np.mean(np.square(speed[10:]))) for _, _, speed in results]) < 1.5


def test_outputs_carry_the_stamp_frames_and_unknown_attitude() -> None:
    messages = inputs_of(HARBOUR)[:2]
    stage, emissions = run(CONFIG, messages)
    always = stage.outputs[:3]
    assert [topic for topic, _ in emissions] == [output.topic for output in always]
    assert [type(value) for _, value in emissions] == [output.kind for output in always]
    assert {value.t_ns for _, value in emissions} == {messages[1][1].t_ns}  # type: ignore[attr-defined]
    odometry, speed, std = (value for _, value in emissions)
    assert isinstance(odometry, Odometry)
    assert isinstance(speed, Scalar)
    assert (odometry.frame_id, odometry.child_frame_id) == ("map", "target_enu")
    assert odometry.quat_xyzw.tolist() == [0, 0, 0, 1]
    assert np.all(np.diag(odometry.pose_cov)[3:] >= 1e6)
    assert np.all(np.linalg.eigvalsh(odometry.twist_cov) > 0)
    assert std.value > 0


def test_arrivals_without_a_path_are_told_how_likely_they_came_by_each() -> None:
    messages = [
        (topic, dataclasses.replace(value, path=0 * value.path) if isinstance(value, Arrivals) else value)
        for topic, value in inputs_of(HARBOUR)[:30]
    ]
    told = [value for topic, value in run(CONFIG, messages)[1] if topic == "target/arrival_paths"]
    assert len(told) == 29
    assert told[-1].t_ns == messages[-1][1].t_ns  # type: ignore[attr-defined]
    right = np.array(
        [np.concatenate([v.direct[:4], v.bottom[4:]]) for v in told]
    )  # the simulator puts direct ones first
    assert np.median(right) > 0.95
    assert right.mean() > 0.85
    assert max(np.max(v.direct + v.bottom + v.surface) for v in told) < 1 + 1e-6


def test_receivers_from_parameters_replace_the_topic() -> None:
    assert HARBOUR.buoys
    nodes = HARBOUR.buoys.nodes
    config = changed(
        CONFIG,
        receiver_ids=tuple(n.id for n in nodes),
        receiver_positions=tuple(value for n in nodes for value in (n.x, n.y, n.z)),
    )
    stage, emissions = run(config, inputs_of(HARBOUR))
    assert [i.topic for i in stage.inputs] == ["buoys/arrivals"]
    reference = run(CONFIG, inputs_of(HARBOUR))[1]
    assert [v.position.tobytes() for t, v in emissions if t == "target/odometry"] == [
        v.position.tobytes() for t, v in reference if t == "target/odometry"
    ]


def test_bad_rows_are_counted_under_their_names_and_the_rest_is_used() -> None:
    messages = inputs_of(HARBOUR)
    last = messages[-1][1]
    assert isinstance(last, Arrivals)
    time, receiver = last.time.copy(), last.receiver.copy()
    time[0], time[1], receiver[2] = np.nan, -0.1, 99
    messages[-1] = ("buoys/arrivals", dataclasses.replace(last, time=time, receiver=receiver))
    stage, emissions = run(CONFIG, messages)
    values = stage.status().values
    assert (values["not_finite"], values["negative_time"], values["unknown_receiver"]) == (1, 1, 1)
    assert values["last_used"] == 5
    assert np.all(np.isfinite(emissions[-3][1].position))


def test_a_bag_with_every_kind_of_bad_row_gives_the_track_of_the_good_ones() -> None:
    """Through the runner, as from a bag: messages swapped, repeated and too late; rows shuffled and spoilt."""
    told: list[Refusal] = []
    clean, spoilt = (Runner(lambda: ToaTrackerStage(CONFIG), 0.5, told.append) for _ in range(2))
    rng, messages = np.random.default_rng(4), inputs_of(HARBOUR)
    expected = [e for message in messages for e in clean.push(*message)]
    bad = [messages[0], *(("buoys/arrivals", _spoilt(value, rng)) for _, value in messages[1:])]
    bad[30], bad[31] = bad[31], bad[30]
    again = dataclasses.replace(bad[40][1], snr=bad[40][1].snr + 1)  # type: ignore[type-var, attr-defined]
    bad[50:50] = [bad[49], ("buoys/arrivals", again)]  # once more, and far too late
    found = [e for message in bad for e in spoilt.push(*message)]
    last, true = _track(found), _track(expected)
    assert len(last) == len(true) - 1  # the one that came late has no output of its own
    assert all(last[t_ns] == pytest.approx(true[t_ns], abs=1e-3) for t_ns in last)
    values, epochs = spoilt.stage.status().values, len(messages) - 1
    names = ("not_finite", "negative_time", "no_information", "unknown_receiver", "path_not_modelled")
    assert {name: values[name] for name in names} == dict.fromkeys(names, epochs)
    assert values["from_the_future"] == epochs
    assert values["repeated"] == epochs
    assert spoilt.counts["buoys/arrivals", "repeated"] == 1  # one message came twice
    assert values["late_used"] == 1
    assert spoilt.counts["buoys/arrivals", "stray"] == 1
    (refusal,) = told
    assert "s behind the topic's course" in refusal.sentence


def test_a_stamp_from_the_future_does_not_stop_the_node() -> None:
    runner, messages = Runner(lambda: ToaTrackerStage(CONFIG), 0.5, lambda _: None), inputs_of(HARBOUR)
    ahead = dataclasses.replace(messages[20][1], t_ns=messages[20][1].t_ns + 10**13)  # type: ignore[type-var, attr-defined]
    found = [e for m in [*messages[:20], ("buoys/arrivals", ahead), *messages[20:]] for e in runner.push(*m)]
    expected = run(CONFIG, messages)[1]
    end = messages[-1][1].t_ns  # type: ignore[attr-defined]
    assert _track(found)[end] == pytest.approx(_track(expected)[end], abs=1e-9)
    assert runner.counts["", "restarts"] == 0 and runner.counts["buoys/arrivals", "stray"] == 1


def _track(emissions: list[Emission]) -> dict[int, np.ndarray]:
    """The last position for each stamp."""
    return {v.t_ns: v.position for topic, v in emissions if topic == "target/odometry"}


def _spoilt(arrivals: Arrivals, rng: np.random.Generator) -> Arrivals:
    """The rows in another order, one of them twice, and a bad one of each kind."""
    n, nan = len(arrivals.time), float("nan")
    columns = {name: getattr(arrivals, name) for name in ("receiver", "path", "time", "std", "snr")}
    rows = rng.permutation([*range(n), 0])
    kept = {name: column[rows] for name, column in columns.items()}
    bad = {
        "receiver": [1, 1, 1, 99, 1, 1],
        "path": [1, 1, 1, 1, 3, 1],  # a buoy at the surface has no surface path
        "time": [nan, -0.1, 0.3, 0.3, 0.3, 1e3],
        "std": [1e-3, 1e-3, 1e9, 1e-3, 1e-3, 1e-3],
        "snr": [20.0] * 6,
    }
    return Arrivals(arrivals.t_ns, *(np.append(kept[k], np.array(bad[k], kept[k].dtype)) for k in columns))


@pytest.mark.parametrize("variance", [0.0, 4e4])
def test_a_pressure_sensor_gives_the_depth(variance: float) -> None:
    """200 Pa are 2 cm; the arrivals alone leave metres."""
    config = changed(CONFIG, pressure_std=200.0)
    rng, weight = np.random.default_rng(8), config.pressure.water_density * 9.80665
    messages = inputs_of(HARBOUR)
    for k in range(len(messages) - 1, 0, -1):
        reading = Pressure(messages[k][1].t_ns - 10**8, 101_325 + 15 * weight + rng.normal(0, 200), variance)  # type: ignore[attr-defined]
        messages.insert(k, ("pressure", reading))
    found = [v for t, v in run(config, messages)[1] if t == "target/odometry"]
    off = np.array([v.position[2] + 15 for v in found])
    assert np.abs(off).max() < 0.15
    assert 0.5 < np.mean([d**2 / v.pose_cov[2, 2] for d, v in zip(off, found, strict=True)]) < 1.5


def test_a_broken_pressure_sensor_is_refused() -> None:
    stage = ToaTrackerStage(changed(CONFIG, pressure_std=200.0))
    assert [i.topic for i in stage.inputs] == ["buoys/positions", "pressure", "buoys/arrivals"]
    with pytest.raises(ValueError, match="pressure must be absolute and in Pa, from that of the air"):
        list(stage.inputs[1].handle(Pressure(1, -1.0)))


def test_drifting_buoys_are_followed() -> None:
    assert HARBOUR.buoys
    drifting = dataclasses.replace(HARBOUR, buoys=dataclasses.replace(HARBOUR.buoys, drift_speed=1.0))
    truth = {v.t_ns: v.position for _, t, v in BuoySource(drifting).events() if t == "/truth/target/odometry"}
    config = changed(CONFIG, moving_receivers=True)
    runner = Runner(lambda: ToaTrackerStage(config), 0.5, lambda _: None)
    found = [e for message in inputs_of(drifting) for e in runner.push(*message)] + list(runner.flush())
    errors = {t_ns: np.linalg.norm(position - truth[t_ns]) for t_ns, position in _track(found).items()}
    assert len(errors) == 121
    assert np.mean(list(errors.values())[10:]) < 4.0
    stale = run(CONFIG, [m for k, m in enumerate(inputs_of(drifting)) if k == 0 or m[0] == "buoys/arrivals"])[1]
    last = max(truth)
    assert np.linalg.norm(_track(stale)[last] - truth[last]) > 10.0


def test_transmitters_are_no_receivers() -> None:
    positions = inputs_of(HARBOUR)[0][1]
    assert isinstance(positions, NodePositions)
    role = positions.role.copy()
    role[3] = NodePositions.TRANSMITTER
    stage, _ = run(CONFIG, [("buoys/positions", dataclasses.replace(positions, role=role)), inputs_of(HARBOUR)[1]])
    assert stage.status().values["unknown_receiver"] == 2


def test_status_tells_what_it_is_doing() -> None:
    messages = inputs_of(HARBOUR)
    assert ToaTrackerStage(CONFIG).status().message == "waiting for buoys/positions"
    assert run(CONFIG, messages[:2])[0].status().level == Status.WARN  # acquiring
    tracking = run(CONFIG, messages)[0].status()
    assert (tracking.level, tracking.message) == (Status.OK, "tracking")
    assert 0.5 < float(tracking.values["nis_per_arrival"]) < 3


def test_clocks_are_told_in_the_status() -> None:
    assert HARBOUR.buoys
    fast = dataclasses.replace(HARBOUR, buoys=dataclasses.replace(HARBOUR.buoys, clock_offset_std=0.01))
    stage, _ = run(changed(CONFIG, buoy_clock_offset_std=0.01), inputs_of(fast))
    told = np.array([float(stage.status().values[f"clock_offset_s.{name}"]) for name in (1, 2, 3, 4)])
    errors = np.array([v.time for t, v in inputs_of(fast) if t == "buoys/arrivals"]) - np.array(
        [v.time for t, v in inputs_of(HARBOUR) if t == "buoys/arrivals"]
    )
    assert told - told.mean() == pytest.approx(errors[0, :4] - errors[0, :4].mean(), abs=2e-3)


def test_arrivals_without_positions_are_refused() -> None:
    with pytest.raises(ValueError, match="no buoys/positions yet"):
        run(CONFIG, inputs_of(HARBOUR)[1:2])


def test_a_narrower_gate_rejects_more_from_then_on() -> None:
    messages = inputs_of(HARBOUR)
    stage, _ = run(CONFIG, messages[:40])
    before = int(stage.status().values["gated"])
    stage.change(changed(CONFIG, gate_sigma=0.5))
    handle = stage.inputs[1].handle
    for _, message in messages[40:42]:
        list(handle(message))
    assert int(stage.status().values["gated"]) > before + 2


def test_same_messages_same_bits() -> None:
    first, second = (run(CONFIG, inputs_of(HARBOUR))[1][-3][1] for _ in range(2))
    assert first.pose_cov.tobytes() == second.pose_cov.tobytes()
