import dataclasses

import numpy as np
import pytest

from uw_acoustic_loc.core.mooring.estimator import discretise
from uw_acoustic_loc.core.types import Arrivals, NodePositions, Odometry, Scalar
from uw_acoustic_loc.sim.buoys import BuoySource
from uw_acoustic_loc.sim.scenario import Buoys, Environment, Impulses, Mooring, Node, Scenario, Vehicle, Waypoint

NODES = (Node(1, -370.0, -380.0), Node(2, 430.0, -380.0), Node(3, -370.0, 420.0, -4.0), Node(4, 430.0, 420.0))
SCENARIO = Scenario(
    environment=Environment(depth=40.0),
    vehicle=Vehicle(waypoints=(Waypoint(0.0, 0.0), Waypoint(60.0, 0.0), Waypoint(60.0, 40.0))),
    buoys=Buoys(NODES, toa_std=1e-3),
    moorings=(Mooring("m1"), Mooring("m2", period=0.7)),
    duration=40.0,
    seed=3,
)


def with_buoys(scenario: Scenario = SCENARIO, **changes: object) -> Scenario:
    assert scenario.buoys
    return dataclasses.replace(scenario, buoys=dataclasses.replace(scenario.buoys, **changes))


def values(scenario: Scenario, topic: str) -> list:
    return [value for _, name, value in BuoySource(scenario).events() if name == topic]


def test_events_are_in_order_and_among_the_outputs() -> None:
    source = BuoySource(with_buoys(outlier_fraction=0.3, outlier_mean=2.0))
    events = list(source.events())
    assert events[0][:2] == (SCENARIO.start_ns, "buoys/positions")
    instants = [t for t, _, _ in events]
    assert instants == sorted(instants)
    assert all(t >= value.t_ns for t, _, value in events)
    kinds = {output.topic: output.kind for output in source.outputs}
    assert {topic for _, topic, _ in events} == set(kinds)
    assert all(type(value) is kinds[topic] for _, topic, value in events)


def test_a_message_is_available_after_its_last_arrival() -> None:
    for available, topic, value in BuoySource(SCENARIO).events():
        if topic == "buoys/arrivals":
            assert available >= value.t_ns + value.time.max() * 1e9


def test_arrivals_follow_the_geometry_of_the_emission() -> None:
    truth = {v.t_ns: v for v in values(SCENARIO, "/truth/target/odometry")}
    speed = {v.t_ns: v.value for v in values(SCENARIO, "/truth/target/sound_speed")}
    residuals = []
    for arrivals in values(SCENARIO, "buoys/arrivals"):
        for receiver, path, time in zip(arrivals.receiver, arrivals.path, arrivals.time, strict=True):
            node = NODES[receiver - 1]
            p = truth[arrivals.t_ns].position
            z = node.z - p[2] if path == Arrivals.DIRECT else (40 + node.z) + (40 + p[2])  # down to the seabed and up
            flat = np.hypot(p[0] - node.x, p[1] - node.y)
            residuals.append(time - np.hypot(flat, z) / speed[arrivals.t_ns])
    assert len(residuals) == 41 * 8
    assert np.mean(residuals) == pytest.approx(0.0, abs=4e-3 / np.sqrt(len(residuals)))
    assert np.std(residuals) == pytest.approx(1e-3, rel=0.15)


def test_truth_moves_as_the_vehicle_does() -> None:
    truth = values(SCENARIO, "/truth/target/odometry")
    assert [v.t_ns - SCENARIO.start_ns for v in truth] == [k * 10**9 for k in range(41)]
    assert truth[10].position == pytest.approx([15.0, 0.0, -15.0])
    assert truth[10].linear == pytest.approx([1.5, 0.0, 0.0])
    assert (truth[0].frame_id, truth[0].child_frame_id) == ("map", "base_link")


def test_outliers_are_late_and_misses_are_missing() -> None:
    clean = values(with_buoys(toa_std=1e-9), "buoys/arrivals")
    late = values(with_buoys(toa_std=1e-9, outlier_fraction=0.25, outlier_mean=0.2), "buoys/arrivals")
    delays = np.concatenate([b.time - a.time for a, b in zip(clean, late, strict=True)])
    hit = delays > 1e-6
    assert np.all(delays > -1e-7)
    assert hit.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / hit.size))
    assert delays[hit].mean() == pytest.approx(0.2, rel=0.45)
    missing = values(with_buoys(miss_fraction=0.5), "buoys/arrivals")
    heard = np.mean([len(m.time) for m in missing])
    assert heard == pytest.approx(4.0, abs=4 * np.sqrt(8 * 0.25 / len(missing)))


def test_all_arrivals_may_be_missing() -> None:
    assert all(len(m.time) == 0 for m in values(with_buoys(miss_fraction=1.0), "buoys/arrivals"))


def test_a_seabed_without_reflection_has_no_path() -> None:
    silent = dataclasses.replace(SCENARIO, environment=Environment(bottom_reflection=0.0))
    assert {int(p) for m in values(silent, "buoys/arrivals") for p in m.path} == {Arrivals.DIRECT}


def test_positions_are_latched_and_true() -> None:
    (positions,) = values(SCENARIO, "buoys/positions")
    assert isinstance(positions, NodePositions)
    assert positions.positions == pytest.approx(np.array([[n.x, n.y, n.z] for n in NODES]))
    assert positions.role.tolist() == [NodePositions.RECEIVER] * 4
    assert [o.topic for o in BuoySource(SCENARIO).outputs if o.latched] == ["buoys/positions"]


def test_mooring_truth_obeys_its_system() -> None:
    truth = values(SCENARIO, "/truth/mooring/m1/odometry")
    states = np.array([[v.position[0], v.linear[0]] for v in truth])
    assert states[0] == pytest.approx([2.0, 0.0])
    F, drive = discretise(1.0, 0.5, 1.0, 0.5, 0.5)
    noise = states[1:] - states[:-1] @ F.T - drive
    assert np.abs(noise[:, 1]).max() < 1e-12
    assert noise[:, 0].std() == pytest.approx(0.05, rel=0.4)


def test_mooring_measurements_have_impulses() -> None:
    offsets = np.array([v.position[0] for v in values(SCENARIO, "mooring/m1/offset")])
    truth = np.array([v.position[0] for v in values(SCENARIO, "/truth/mooring/m1/odometry")])
    error = np.abs(offsets - truth)
    assert len(offsets) == 81
    assert 0.05 < np.mean(error > 2.0) < 0.45  # 30 % impulses, most of them beyond 4 sigma
    assert np.median(error) < 0.8


def test_each_part_may_be_absent() -> None:
    assert [o.topic for o in BuoySource(Scenario()).outputs] == []
    assert list(BuoySource(Scenario()).events()) == []
    moorings = dataclasses.replace(SCENARIO, buoys=None, vehicle=None)
    assert values(moorings, "mooring/m2/offset")
    assert not values(moorings, "/truth/target/odometry")


def test_other_sensors_do_not_change_these() -> None:
    alone = dataclasses.replace(SCENARIO, moorings=SCENARIO.moorings[:1])
    for topic in ("buoys/arrivals", "mooring/m1/offset"):
        for a, b in zip(values(SCENARIO, topic), values(alone, topic), strict=True):
            column = "time" if topic == "buoys/arrivals" else "position"
            assert getattr(a, column).tobytes() == getattr(b, column).tobytes()


def test_same_seed_same_bits_other_seed_other_bits() -> None:
    first, again = (values(SCENARIO, "buoys/arrivals") for _ in range(2))
    other = values(dataclasses.replace(SCENARIO, seed=4), "buoys/arrivals")
    assert [a.time.tobytes() for a in first] == [a.time.tobytes() for a in again]
    assert first[0].time.tobytes() != other[0].time.tobytes()


def test_buoys_need_a_vehicle() -> None:
    with pytest.raises(ValueError, match="the scenario must have a vehicle, whose ping they time"):
        BuoySource(dataclasses.replace(SCENARIO, vehicle=None))


def test_truth_kinds() -> None:
    assert isinstance(values(SCENARIO, "/truth/target/sound_speed")[0], Scalar)
    assert isinstance(values(SCENARIO, "/truth/mooring/m2/odometry")[0], Odometry)


def times(scenario: Scenario) -> np.ndarray:
    """(pings, arrivals)."""
    return np.array([arrivals.time for arrivals in values(scenario, "buoys/arrivals")])


def test_a_gradient_bends_the_arrivals() -> None:
    water = dataclasses.replace(SCENARIO.environment, sound_speed_gradient=-0.02)
    bent = times(dataclasses.replace(SCENARIO, environment=water)) - times(SCENARIO)
    assert np.all(bent[:, 4:] > bent[:, :4])  # the seabed's path leads through the slower water
    mean_speed = 1500 - 0.02 * 7.5  # over the direct path from z = -15 to 0
    assert bent[0, 0] == pytest.approx(times(SCENARIO)[0, 0] * (1500 / mean_speed - 1), rel=0.05)


def test_each_buoys_clock_has_its_own_offset_and_drift() -> None:
    errors = times(with_buoys(clock_offset_std=0.01, clock_drift_std=1e-4)) - times(SCENARIO)
    assert errors[:, :4] == pytest.approx(errors[:, 4:])  # the same clock for both paths
    assert np.diff(errors, axis=0) == pytest.approx(np.tile(errors[1] - errors[0], (40, 1)))
    assert len(np.unique(np.round(errors[0, :4], 9))) == 4
    assert 0.002 < np.std(errors[0, :4]) < 0.03
    assert 1e-5 < np.std((errors[1] - errors[0])[:4]) < 4e-4


def test_impulses_replace_some_errors_and_leave_the_others_alone() -> None:
    """alpha = 1, beta = 0 is Cauchy: half of the impulses are beyond its scale."""
    impulses = Impulses(fraction=0.2, alpha=1.0, beta=0.0, scale=50.0, location=0.0)
    noisy = with_buoys(toa_std=1e-3)
    errors = times(with_buoys(noisy, impulses=impulses)) - times(with_buoys(toa_std=1e-9))
    hit = times(with_buoys(noisy, impulses=impulses)) != times(noisy)
    assert hit.mean() == pytest.approx(0.2, abs=3 * np.sqrt(0.16 / hit.size))
    assert (errors[hit] > 0).mean() == pytest.approx(0.5, abs=3 * np.sqrt(0.25 / hit.sum()))
    assert np.median(np.abs(errors[hit])) == pytest.approx(0.05, rel=0.4)
    assert np.std(errors[~hit]) == pytest.approx(1e-3, rel=0.2)


def test_weak_arrivals_are_lost() -> None:
    scenario = with_buoys(snr_distance=100.0, detection_threshold=-10.0)  # 20 dB at 100 m
    assert all(len(arrivals.time) == 8 and arrivals.snr.min() > -10 for arrivals in values(scenario, "buoys/arrivals"))
    far = values(with_buoys(scenario, detection_threshold=0.0), "buoys/arrivals")
    assert {int(path) for arrivals in far for path in arrivals.path} == {Arrivals.DIRECT}  # the seabed takes 8 dB
    direct = far[0].path == Arrivals.DIRECT
    assert far[0].snr[direct][0] == pytest.approx(20 - 20 * np.log10(np.hypot(np.hypot(370, 380), 15) / 100), abs=1e-4)


def test_drifting_buoys_say_where_they_are() -> None:
    scenario = with_buoys(drift_speed=0.5)
    positions = np.array([value.positions for value in values(scenario, "buoys/positions")])
    assert positions.shape == (41, 4, 3)
    assert np.linalg.norm(positions[-1] - positions[0], axis=1) == pytest.approx(np.full(4, 20.0))
    moved = times(scenario) - times(SCENARIO)
    assert np.abs(moved[0]).max() < 1e-12
    assert 0.5 * 20 / 1500 < np.abs(moved[-1]).max() < 20 / 1490
