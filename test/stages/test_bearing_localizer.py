"""The localizer's and the SLAM's stages on the harbour scenario with synthetic bearings."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.core.geometry import mirror_bearing, quat_from_yaw, wrap_angle, yaw_from_quat
from uw_acoustic_loc.core.types import Bearing, Odometry, Particles, Position
from uw_acoustic_loc.sim.scenario import load_scenario
from uw_acoustic_loc.sim.trajectory import Trajectory
from uw_acoustic_loc.sim.vehicle import VehicleSource
from uw_acoustic_loc.stages.bearing_localizer import BearingLocalizerStage
from uw_acoustic_loc.stages.bearing_slam import BearingSlamStage
from uw_acoustic_loc.stages.runner import Refusal, Runner

HARBOUR = load_scenario(Path(__file__).parents[2] / "config" / "harbour" / "scenario.yaml")
STD = math.radians(1)
IDS = tuple(pinger.id for pinger in HARBOUR.pingers)
START_Z = -15.0


def bearings(seed: int) -> list[tuple[int, str, Bearing]]:
    """10 Hz, white."""
    rng = np.random.default_rng([41, seed])
    times = np.arange(0.05, HARBOUR.duration, 0.1)
    motion = Trajectory(HARBOUR.vehicle).at(times)
    found = []
    for pinger in HARBOUR.pingers:
        angles = np.arctan2(pinger.y - motion.positions[1], pinger.x - motion.positions[0]) - motion.yaw
        for t, angle in zip(times, angles + rng.normal(0, STD, times.size), strict=True):
            t_ns = HARBOUR.t_ns(t)
            topic = f"sources/{pinger.id}/bearing"
            found.append((t_ns, topic, Bearing(t_ns, wrap_angle(angle), STD**2, np.zeros(3))))
    return found


def run(stage, events) -> dict[str, list]:
    handle = {i.topic: i.handle for i in stage.inputs}
    published: dict[str, list] = {}
    for _, topic, value in sorted((e for e in events if e[1] in handle), key=lambda e: e[0]):
        for out, answer in handle[topic](value):
            published.setdefault(out, []).append(answer)
    return published


def true_odometry() -> list[tuple[int, str, Odometry]]:
    """The true motion seen from the start, every 50 ms: exact odometry."""
    found = []
    for t_ns, topic, value in VehicleSource(HARBOUR).events():
        if topic.startswith("/truth"):
            seen = replace(value, position=value.position - [0, 0, START_Z], frame_id="odom")
            found.append((t_ns, "odometry", seen))
    return found


def localizer(**values) -> BearingLocalizerStage:
    defaults = {"source_ids": IDS, "bearing_correlation_time": 0.0, "process_noise": 0.0}
    return BearingLocalizerStage(build(BearingLocalizerStage.Config, defaults | values, "test"))


@pytest.mark.parametrize("method", ["triangulation", "ekf", "particle_filter"])
def test_every_pinger_is_found_and_the_covariance_is_honest(method):
    odometry, runs, nees = true_odometry(), 3 if method == "ekf" else 1, []
    for seed in range(runs):
        published = run(localizer(method=method), odometry + bearings(seed))
        for pinger in HARBOUR.pingers:
            last: Position = published[f"sources/{pinger.id}/position"][-1]
            off = last.position[:2] - (pinger.x, pinger.y)
            assert math.hypot(*off) < 0.5
            assert last.cov[2, 2] == -1 and last.frame_id == "odom"
            nees.append(off @ np.linalg.solve(last.cov[:2, :2], off) / 2)
    assert abs(np.mean(nees) - 1) < 4 / math.sqrt(len(nees))


def test_drifting_odometry_is_told_in_the_covariance():
    """A gyro bias turns odom by tens of degrees; the published covariance has to know."""
    nees = []
    for seed in range(3):
        events = [*VehicleSource(replace(HARBOUR, seed=seed)).events(), *bearings(seed)]
        published = run(localizer(process_noise=0.1), events)
        for pinger in HARBOUR.pingers:
            last = published[f"sources/{pinger.id}/position"][-1]
            off = last.position[:2] - (pinger.x, pinger.y)
            nees.append(off @ np.linalg.solve(last.cov[:2, :2], off) / 2)
    assert 0.1 < np.mean(nees) < 3


def test_ordinary_dead_reckoning_has_neither_gaps_nor_leaps_and_a_moving_source_its_speed():
    stage = localizer(source_speed_std=0.2)
    run(stage, [e for e in [*VehicleSource(HARBOUR).events(), *bearings(0)] if e[0] < HARBOUR.t_ns(70.0)])
    values = stage.status().values
    assert values["odometry_gaps"] == values["odometry_jumps"] == 0
    assert all(0 <= values[f"{name}.speed"] < 0.3 for name in IDS)


def test_relative_to_the_drifted_vehicle_the_source_is_right():
    """REP-105: odom drifts, and a position in it is right when it is right seen from the vehicle's pose in it."""
    distances = []
    for seed in range(3):
        events = list(VehicleSource(replace(HARBOUR, seed=seed)).events())
        for method in ("ekf", "particle_filter") if seed == 0 else ("ekf",):
            published = run(localizer(method=method, process_noise=0.1), events + bearings(seed))
            reckoned = [e[2] for e in events if e[1] == "odometry"][-1]
            true = [e[2] for e in events if e[1].startswith("/truth")][-1]
            turn = yaw_from_quat(reckoned.quat_xyzw) - yaw_from_quat(true.quat_xyzw)
            c, s = math.cos(turn), math.sin(turn)
            for pinger in HARBOUR.pingers:
                dx, dy = pinger.x - true.position[0], pinger.y - true.position[1]
                expected = reckoned.position[:2] + np.array([c * dx - s * dy, s * dx + c * dy])
                found = published[f"sources/{pinger.id}/position"][-1].position[:2]
                distances.append(math.dist(found, expected))
    assert np.median(distances) < 1.0 and max(distances) < 3.0


def test_both_sides_are_published_while_both_are_possible():
    stage = localizer()
    straight = HARBOUR.t_ns(30.0)
    published = run(stage, [e for e in true_odometry() + bearings(0) if e[0] < straight])
    last = published["sources/a/mirror_position"][-1]
    np.testing.assert_allclose(last.position[:2], [20, -17], atol=0.5)
    status = stage.status()
    assert status.message == "both sides remain possible of a, b, c"
    assert status.values["a.probability"] + status.values["a.mirror_probability"] == pytest.approx(1)
    one = localizer(mirror=False)
    assert "sources/a/mirror_position" not in {o.topic for o in one.outputs}


def test_array_position_and_yaw():
    """The array 2 m to port and turned by 0.4: the bearing is from there, the mirror about its axis."""
    stage = localizer(array_yaw=0.4, source_ids=("a",))
    handle = {i.topic: i.handle for i in stage.inputs}
    level = Odometry(10**9, np.zeros(3), quat_from_yaw(math.pi / 2), np.array([1.0, 0, 0]), np.zeros(3))
    list(handle["odometry"](level))
    bearing = Bearing(10**9 + 500_000_000, 0.2, 1e-4, np.array([0.0, 2.0, 0.0]))
    found = dict(handle["sources/a/bearing"](bearing))
    for topic, angle in (("position", 0.2), ("mirror_position", mirror_bearing(0.2, 0.4))):
        offset = found[f"sources/a/{topic}"].position[:2] - (-2.0, 0.5)  # half a second at 1 m/s to the north
        assert math.atan2(offset[1], offset[0]) == pytest.approx(wrap_angle(math.pi / 2 + angle), abs=1e-9)


def test_particles_are_few_and_rare():
    early = HARBOUR.t_ns(10.0)
    events = [e for e in true_odometry() + bearings(0) if e[0] < early]
    clouds: list[Particles] = run(localizer(method="particle_filter"), events)["sources/b/particles"]
    assert np.all(np.diff([c.t_ns for c in clouds]) >= 500_000_000)
    assert all(c.x.size <= 200 and c.frame_id == "odom" and c.x.dtype == np.float32 for c in clouds)
    assert all(c.weight.sum() == pytest.approx(1, abs=1e-3) for c in clouds)


def test_refusals():
    stage = localizer()
    assert stage.status().level == Status.WARN and "no bearing yet of a, b, c" in stage.status().message
    handle = {i.topic: i.handle for i in stage.inputs}
    with pytest.raises(ValueError, match="no odometry yet"):
        list(handle["sources/a/bearing"](Bearing(1, 0.1, 0.01, np.zeros(3))))
    list(handle["odometry"](Odometry(1, np.zeros(3), quat_from_yaw(0), np.zeros(3), np.zeros(3))))
    with pytest.raises(ValueError, match=r"odometry is 2\.000 s older, allowed are 1 s"):
        list(handle["sources/a/bearing"](Bearing(2 * 10**9 + 1, 0.1, 0.01, np.zeros(3))))


def run_faulty(fault) -> tuple[BearingLocalizerStage, dict[str, Position], list[Refusal]]:
    """The harbour with true odometry that has gone through `fault`, by way of the runner that every node has."""
    refused: list[Refusal] = []
    runner = Runner(localizer, 0.5, refused.append)
    events = [(t, topic, fault(t, v)) if topic == "odometry" else (t, topic, v) for t, topic, v in true_odometry()]
    events = [event for event in events + bearings(0) if event[2] is not None]
    last: dict[str, Position] = {}
    for _, topic, value in sorted(events, key=lambda event: event[0]):
        last |= runner.push(topic, value)
    last |= runner.flush()
    return runner.stage, last, refused


def test_a_gap_in_odometry_is_told_and_does_no_harm():
    begin, end = HARBOUR.t_ns(88.0), HARBOUR.t_ns(100.0)
    stage, last, refused = run_faulty(lambda t, v: None if begin < t < end else v)
    for pinger in HARBOUR.pingers:
        assert math.dist(last[f"sources/{pinger.id}/position"].position[:2], (pinger.x, pinger.y)) < 0.7
    assert 300 < len(refused) < 400 and all("odometry is" in refusal.sentence for refusal in refused)
    status = stage.status()
    assert status.level == Status.WARN and "odometry paused for 12.0 s" in status.message
    assert (status.values["odometry_gaps"], status.values["odometry_jumps"]) == (1, 0)


def test_a_leap_of_odometry_is_told_and_the_sources_come_along():
    """At 95 s dead reckoning starts again at zero: everything is where it was, seen from the vehicle."""
    leap = HARBOUR.t_ns(95.0)
    at = next(v for t, topic, v in true_odometry() if topic == "odometry" and t >= leap)
    yaw, (x, y) = yaw_from_quat(at.quat_xyzw), at.position[:2]
    c, s = math.cos(yaw), math.sin(yaw)

    def begun_anew(px: float, py: float) -> list[float]:
        return [c * (px - x) + s * (py - y), -s * (px - x) + c * (py - y)]

    def fault(t: int, v: Odometry) -> Odometry:
        if t < leap:
            return v
        turned = quat_from_yaw(yaw_from_quat(v.quat_xyzw) - yaw)
        return replace(v, position=np.array([*begun_anew(*v.position[:2]), v.position[2]]), quat_xyzw=turned)

    stage, last, refused = run_faulty(fault)
    assert not refused
    for pinger in HARBOUR.pingers:
        found = last[f"sources/{pinger.id}/position"]
        assert math.dist(found.position[:2], begun_anew(pinger.x, pinger.y)) < 0.6
        assert math.sqrt(np.trace(found.cov[:2, :2])) < 0.6
    status = stage.status()
    assert status.level == Status.WARN and "sources carried along" in status.message
    assert status.values["odometry_jumps"] == 1 and status.values["a.restarts"] == 0


def test_a_stopped_clock_of_odometry_is_told_and_does_no_harm():
    """From 100 s on its stamps stand still."""
    stop = HARBOUR.t_ns(100.0)
    stage, last, refused = run_faulty(lambda t, v: replace(v, t_ns=min(t, stop)))
    for pinger in HARBOUR.pingers:
        assert math.dist(last[f"sources/{pinger.id}/position"].position[:2], (pinger.x, pinger.y)) < 0.7
    assert any("odometry at" in refusal.sentence and "must come after" in refusal.sentence for refusal in refused)
    assert any("bearing refused: odometry is" in refusal.sentence for refusal in refused)
    status = stage.status()
    assert status.level == Status.WARN and "s behind the bearings" in status.message


def test_the_advice_stands_in_the_diagnostics():
    stage = localizer()
    run(stage, [e for e in true_odometry() + bearings(0) if e[0] < HARBOUR.t_ns(30.0)])
    assert "side not known yet; turn " in stage.status().values["a.advice"]


def slam_stage(**values) -> BearingSlamStage:
    defaults = {"source_ids": IDS, "bearing_correlation_time": 0.0}
    return BearingSlamStage(build(BearingSlamStage.Config, defaults | values, "test"))


def test_slam_in_the_harbour():
    nees = []
    for seed in range(3):
        events = list(VehicleSource(replace(HARBOUR, seed=seed)).events())
        stage = slam_stage()
        published = run(stage, events + bearings(seed))
        true = {e[0]: e[2].position[:2] for e in events if e[1].startswith("/truth")}
        track = published["slam/odometry"]
        off = np.array([o.position[:2] - true[o.t_ns] for o in track if o.t_ns in true])
        reckoned = [e[2] for e in events if e[1] == "odometry"][-1].position[:2] - true[HARBOUR.t_ns(120.0)]
        assert np.sqrt(np.mean(np.square(off).sum(axis=1))) < min(0.6, 0.5 * math.hypot(*reckoned))
        nees.append(off[-1] @ np.linalg.solve(track[-1].pose_cov[:2, :2], off[-1]) / 2)
        for pinger in HARBOUR.pingers:
            last = published[f"slam/sources/{pinger.id}/position"][-1]
            error = last.position[:2] - (pinger.x, pinger.y)
            assert math.hypot(*error) < 0.6
            nees.append(error @ np.linalg.solve(last.cov[:2, :2], error) / 2)
        assert stage.status().level == Status.OK and stage.status().message == "running"
    assert 0.5 < np.mean(nees) < 1.6


def test_slam_rates_frames_and_cost():
    early = HARBOUR.t_ns(60.0)
    events = [e for e in [*VehicleSource(HARBOUR).events(), *bearings(0)] if e[0] < early]
    began = time.process_time()
    published = run(slam_stage(), events)
    assert (time.process_time() - began) / 6000 < 1.5e-3  # s per IMU message, some 0.1e-3 on the machine it was made on
    track = published["slam/odometry"]
    assert np.all(np.diff([o.t_ns for o in track]) == 100_000_000)
    assert (track[0].frame_id, track[0].child_frame_id) == ("odom", "base_link")
    np.testing.assert_allclose(track[0].position, 0, atol=1e-9)
    assert np.all(np.linalg.eigvalsh(track[-1].pose_cov) > 0) and np.all(np.linalg.eigvalsh(track[-1].twist_cov) > 0)
    for name in IDS:
        stamps = [p.t_ns for p in published[f"slam/sources/{name}/position"]]
        assert np.all(np.diff(stamps) >= 500_000_000)


def test_same_input_same_output():
    early = HARBOUR.t_ns(8.0)
    events = [e for e in [*VehicleSource(HARBOUR).events(), *bearings(0)] if e[0] < early]
    for make in (slam_stage, lambda: localizer(method="particle_filter")):
        one, two = run(make(), events), run(make(), events)
        assert one.keys() == two.keys() and len(one) > 0
        for topic in one:
            if not topic.endswith("particles"):
                np.testing.assert_array_equal(one[topic][-1].position, two[topic][-1].position)
