"""SLAM with sensors that pause, jump, repeat themselves or stand still: it says so, stays honest, and recovers."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.core.slam.config import SlamConfig
from uw_acoustic_loc.core.types import BodyVelocity, Imu
from uw_acoustic_loc.sim.trajectory import Trajectory
from uw_acoustic_loc.sim.vehicle import VehicleSource
from uw_acoustic_loc.stages.bearing_slam import BearingSlamStage
from uw_acoustic_loc.stages.runner import Refusal, Runner
from uw_acoustic_loc.studies.slam.bearings import bearings
from uw_acoustic_loc.studies.slam.trials import SCENARIO, STD

IDS = tuple(p.id for p in SCENARIO.pingers)
Event = tuple[int, str, object]


class Faulty:
    """A run of the study's setting through a runner, with some messages changed or left out."""

    def __init__(
        self, change: Callable[[float, str, object], Iterable[object]], duration: float, seed: int = 3
    ) -> None:
        self.scenario = replace(SCENARIO, seed=seed, duration=duration)
        self.refused: list[Refusal] = []
        self.messages: dict[float, str] = {}
        config = SlamConfig(IDS, bearing_correlation_time=0.0, range_max=100.0)
        self.runner = Runner(lambda: BearingSlamStage(config), 0.5, self.refused.append)
        topics = {i.topic for i in self.runner.stage.inputs}
        last = -1.0
        for t_ns, topic, value in heapq.merge(
            VehicleSource(self.scenario).events(), bearings(self.scenario, STD), key=lambda e: e[0]
        ):
            time = (t_ns - self.scenario.start_ns) * 1e-9
            for changed in change(time, topic, value) if topic in topics else ():
                list(self.runner.push(topic, changed))
            if time - last >= 1.0:
                self.messages[time], last = self.runner.stage.status().message, time
        list(self.runner.flush())
        self.status = self.runner.stage.status()

    @property
    def error(self) -> tuple[float, float]:
        """Of the vehicle's position at the end: m, and NEES per dimension."""
        trajectory = Trajectory(self.scenario.vehicle)
        start, now = trajectory.at(0.0), trajectory.at(self.scenario.duration)
        c, s = math.cos(start.yaw[0]), math.sin(start.yaw[0])
        true = np.array([[c, s], [-s, c]]) @ (now.positions[:2, 0] - start.positions[:2, 0])
        joint = self.runner.stage._slam.joint
        off = joint.mean[:2] - true
        return math.hypot(*off), float(off @ np.linalg.solve(joint.cov[:2, :2], off)) / 2


def silent(topic: str, begin: float, end: float):
    return lambda time, name, value: () if name == topic and begin < time < end else (value,)


def test_a_gap_of_the_imu_is_named_and_survived():
    run = Faulty(silent("imu/data", 60.0, 63.0), 100.0)
    assert {r.topic for r in run.refused} == {"dvl/twist", *(f"sources/{name}/bearing" for name in IDS)}
    assert all("the IMU is" in r.sentence and "behind" in r.sentence for r in run.refused)
    assert any("the IMU is silent for" in m for t, m in run.messages.items() if 60 < t < 64)
    assert run.status.values["imu.gaps"] == 1 and run.status.message == "running"
    assert run.error[0] < 3.0 and run.error[1] < 6.0


def test_a_gap_of_the_doppler_log_is_named_and_survived():
    run = Faulty(silent("dvl/twist", 50.0, 65.0), 100.0)
    assert any("no velocity for" in m for t, m in run.messages.items() if 53 < t < 65)
    assert not run.refused and run.status.message == "running"
    assert run.error[0] < 3.0 and run.error[1] < 6.0


def test_without_a_doppler_log_it_says_so():
    run = Faulty(silent("dvl/twist", -1.0, 1e9), 10.0)
    assert run.status.level == Status.WARN and "no velocity for 10.0 s" in run.status.message


def test_spikes_are_refused_by_name_or_gated():
    def change(time: float, topic: str, value: object) -> Iterable[object]:
        if isinstance(value, Imu) and abs(time - 20.0) < 0.004:
            return (replace(value, angular=np.array([0.0, 0.0, 50.0])),)
        if isinstance(value, Imu) and abs(time - 21.0) < 0.004:
            return (replace(value, acceleration=np.array([0.0, 500.0, 9.81])),)
        if isinstance(value, BodyVelocity) and 24.9 < time < 25.3:
            return (replace(value, linear=value.linear + np.array([2.0, 0.0, 0.0])),)
        return (value,)

    run, clean = Faulty(change, 40.0), Faulty(lambda *_: (_[2],), 40.0)
    assert [r.sentence for r in run.refused] == [
        "angular rate must be at most 10 rad/s on each axis, got 50",
        "specific force must be at most 100 m/s^2 on each axis, got 500",
    ]
    assert run.status.values["dvl.unused"] == 2
    assert run.error[0] == pytest.approx(clean.error[0], abs=0.05)


@pytest.mark.parametrize("topic", ["imu/data", "dvl/twist"])
def test_a_stopped_clock_is_refused_by_name(topic):
    """The sensor goes on with the stamp of 110 s for 5 s: such readings neither move the vehicle nor count again."""
    held: list[int] = []

    def change(time: float, name: str, value: object) -> Iterable[object]:
        if name != topic or not 110.0 < time < 115.0:
            return (value,)
        held.append(value.t_ns)
        return (replace(value, t_ns=held[0]),)

    run = Faulty(change, 150.0)
    mine = [r.sentence for r in run.refused if r.topic == topic]
    assert len(mine) == len(held) - 1
    assert run.error[0] < 3.0 and run.error[1] < 6.0


def test_an_imu_stamp_far_ahead_is_refused_and_a_clock_set_forward_is_a_gap():
    stage, level = BearingSlamStage(SlamConfig(IDS)), np.array([0.0, 0.0, 9.81])

    def reading(seconds: float) -> None:
        list(stage._on_imu(Imu(round(seconds * 1e9), np.zeros(3), level)))

    for k in range(100):
        reading(10.0 + 0.01 * k)
    before = stage._slam.joint.cov.copy()
    with pytest.raises(ValueError, match=r"IMU stamp is 3600\.0 s after the last one, at most 60 s are believed"):
        reading(3610.99)
    np.testing.assert_array_equal(stage._slam.joint.cov, before)
    assert stage.status().values["imu.ahead"] == 1 and "far ahead" in stage.status().message
    reading(11.0)  # it was one bad stamp
    assert stage.status().values["imu.ahead"] == 0
    for k in range(3):
        with pytest.raises(ValueError, match="at most 60 s"):
            reading(4000.0 + 0.01 * k)
    reading(4000.03)
    status = stage.status()
    assert status.values["imu.gaps"] == 1 and status.values["imu.ahead"] == 0
    assert status.values["position_std_m"] > 300.0  # odom stays what it was, and the vehicle may be far off in it


def test_a_sensor_whose_readings_stand_still_is_gated():
    """The log repeats a wrong velocity under new stamps: it cannot be honest then, but recovers."""

    def change(time: float, name: str, value: object) -> Iterable[object]:
        wrong = isinstance(value, BodyVelocity) and 40.0 < time < 41.0
        return (replace(value, linear=np.full(3, 1e-3)) if wrong else value,)

    run = Faulty(change, 60.0)
    assert run.status.values["dvl.unused"] >= 4  # on the way in and on the way out
    speed = run.runner.stage._slam.joint.mean[6]
    assert speed == pytest.approx(0.33, abs=0.03)
