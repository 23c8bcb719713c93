"""A vehicle that has lost itself: how far it may be after a gap, and how it is found by known pingers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from slam_runs import BOAT, PINGERS, config, feed, measurements, start_frame

from uw_acoustic_loc.core.geometry import wrap_angle
from uw_acoustic_loc.core.localizer.triangulation import PlanarFix
from uw_acoustic_loc.core.slam.gap import bridge, integrated_variance
from uw_acoustic_loc.core.slam.inertial import SIZE, YAW
from uw_acoustic_loc.core.slam.joint import Joint
from uw_acoustic_loc.core.slam.lines import Pose
from uw_acoustic_loc.core.slam.relinearise import SlamPasses
from uw_acoustic_loc.core.slam.relocation import Relocation, SeenPinger, place
from uw_acoustic_loc.sim.scenario import Scenario, Vehicle, Waypoint
from uw_acoustic_loc.sim.trajectory import Trajectory


def test_the_variance_of_an_integrated_ornstein_uhlenbeck_process():
    rng, dt, n = np.random.default_rng(1), 0.02, 20_000
    rate, total = np.zeros(n), np.zeros(n)
    for _ in range(round(6.0 / dt)):
        total += rate * dt
        rate += -rate * dt / 5.0 + 0.2 * math.sqrt(2 * dt / 5.0) * rng.standard_normal(n)
    assert integrated_variance(0.2, 5.0, 6.0) == pytest.approx(total.var(), rel=0.05)  # 20000 draws: 1 %, and the step


def test_a_gap_moves_the_state_as_its_jacobian_says():
    rng = np.random.default_rng(2)
    for duration in (1.0, 15.0, 60.0):
        state = np.concatenate([rng.normal(size=3), 0.3 * rng.normal(size=3), rng.normal(size=3), np.zeros(6)])

        def moved(mean: np.ndarray, duration: float = duration) -> np.ndarray:
            joint = Joint(mean, np.zeros(SIZE))
            bridge(joint, duration, 0.1)
            return joint.mean

        sharp, wide = Joint(state, np.zeros(SIZE)), Joint(state, np.zeros(SIZE))
        for joint, variance in ((sharp, 0.0), (wide, 1e-2)):
            joint.cov[[0, 1, YAW, 6, 7], [0, 1, YAW, 6, 7]] = variance
            bridge(joint, duration, 0.1)
        columns = [0, 1, YAW, 6, 7]
        J = np.stack([(moved(state + 1e-6 * np.eye(SIZE)[k]) - moved(state)) / 1e-6 for k in columns], axis=1)
        np.testing.assert_allclose((wide.cov - sharp.cov)[:9, :9], 1e-2 * (J @ J.T)[:9, :9], atol=1e-4 * duration**2)
        assert np.linalg.eigvalsh(sharp.cov[:9, :9])[0] >= 0


class Lost:
    """Pingers at random, each known to some decimetres, and a vehicle that drives on anywhere among them."""

    def __init__(self, seed: int, pingers: int, mirror: bool = False) -> None:
        rng = np.random.default_rng([7, seed, pingers])
        size = float(rng.uniform(20, 300))
        self.true = rng.uniform(-size, size, (pingers, 2))
        self.joint = Joint(np.zeros(SIZE), np.full(SIZE, 1e-4))
        root = rng.normal(0, 0.2, (2 * pingers, 2 * pingers)) / math.sqrt(2 * pingers)
        told = self.true.ravel() + root @ rng.standard_normal(2 * pingers)
        slots = [
            self.joint.add(PlanarFix(told[2 * k : 2 * k + 2], np.eye(2)), np.zeros((2, SIZE))) for k in range(pingers)
        ]
        self.joint.cov[SIZE:, SIZE:] = root @ root.T
        x, y, yaw = *rng.uniform(-size, size, 2), rng.uniform(-math.pi, math.pi)
        prior = np.array([x, y, yaw]) + np.array([30.0, 30.0, 1.5]) * rng.standard_normal(3)
        relocation = Relocation("a test", (prior, np.diag([900.0, 900.0, 2.25])), 0.0)
        speed, rate, std = rng.uniform(0.5, 2.5), rng.normal(0, 0.1), math.radians(rng.uniform(0.5, 3.0))
        raw = Pose(*rng.normal(size=2), rng.uniform(-3, 3), 0.0)
        self.found = None
        for _ in range(100):
            for k, slot in enumerate(slots):
                bearing = math.atan2(self.true[k, 1] - y, self.true[k, 0] - x) - yaw + rng.normal(0, std)
                images = (wrap_angle(bearing), wrap_angle(-bearing))[: 1 + mirror]
                relocation.hear(SeenPinger(raw, np.zeros(2), images, std**2, slot))
                self.found = relocation.solve(self.joint)
                if self.found is not None:
                    place(self.joint, self.found)
                    off = self.joint.mean[[0, 1, YAW]] - (x, y, yaw)
                    off[2] = wrap_angle(off[2])
                    P = self.joint.cov[np.ix_([0, 1, YAW], [0, 1, YAW])]
                    self.seconds, self.nees = raw.time, float(off @ np.linalg.solve(P, off)) / 3
                    return
            x, y, yaw = x + 0.1 * speed * math.cos(yaw), y + 0.1 * speed * math.sin(yaw), yaw + 0.1 * rate
            ahead, turned = 0.1 * speed, raw.yaw + 0.1 * rate
            raw = Pose(raw.x + ahead * math.cos(raw.yaw), raw.y + ahead * math.sin(raw.yaw), turned, raw.time + 0.1)


@pytest.mark.parametrize(("pingers", "mirror", "least"), [(3, False, 0.8), (5, False, 0.9), (3, True, 0.4)])
def test_known_pingers_tell_the_pose_and_how_well_it_is_known(pingers, mirror, least):
    """Over random maps: NEES / 3 within four times its mean's spread, and 0.3 for how angles bend; few are wrong."""
    runs = [Lost(seed, pingers, mirror) for seed in range(25)]
    nees = [run.nees for run in runs if run.found is not None]
    assert len(nees) >= least * len(runs)
    assert np.median([run.seconds for run in runs if run.found is not None]) < 3.0
    assert sum(value > 10 for value in nees) <= 1
    assert np.mean([value for value in nees if value <= 10]) < 1.3 + 4 * math.sqrt(2 / 3 / len(nees))


FAR = Vehicle(tuple(Waypoint(*p) for p in ((0, 0), (60, 10), (50, 60), (-10, 50))), speed=2.0, turn_radius=8.0)
FAR_PINGERS = {"p": (30.0, 35.0), "q": (70.0, 40.0), "r": (10.0, 30.0)}


@pytest.mark.parametrize(
    ("vehicle", "pingers", "std", "begin", "gap"),
    [
        (FAR, FAR_PINGERS, 1.0, 45.0, 15.0),
        (FAR, FAR_PINGERS, 1.0, 40.0, 30.0),
        (BOAT, PINGERS, 5.0, 120.0, 15.0),
    ],
)
def test_after_silence_of_all_sensors_known_pingers_bring_the_vehicle_back(vehicle, pingers, std, begin, gap):
    """Within 5 s the error is in the filter's own covariance again, and that is small."""
    std = math.radians(std)
    scenario = Scenario(vehicle=vehicle, duration=begin + gap + 5.0, seed=3)
    passes = SlamPasses(config(bearing_std=std, source_ids=tuple(pingers)))
    begin_ns, end_ns = scenario.t_ns(begin), scenario.t_ns(begin + gap)
    events = measurements(scenario, std, pingers)
    feed(passes, [e for e in events if e[0] <= begin_ns])
    assert sum(p.fix is not None for p in passes.slam.pingers.values()) >= 2
    after = [e for e in events if e[0] >= end_ns]
    feed(passes, after[:2])
    spread = math.sqrt(passes.slam.joint.cov[0, 0] + passes.slam.joint.cov[1, 1])
    assert passes.slam.relocation is not None and spread > 0.3 * gap  # it says what is not known
    feed(passes, after[2:])
    assert passes.slam.relocation is None and passes.slam.relocations == 1
    origin, rotation, _ = start_frame(scenario)
    end = Trajectory(vehicle).at(scenario.duration).positions[:2, 0]
    off = passes.slam.joint.mean[:2] - rotation @ (end - origin)
    assert math.hypot(*off) < 3.0 and off @ np.linalg.solve(passes.slam.joint.cov[:2, :2], off) / 2 < 6.9  # 0.1 %
    assert all(pinger.restarts == 0 for pinger in passes.slam.pingers.values())


def test_a_vehicle_that_is_wrong_is_relocated_and_the_map_kept():
    """The pose is put 9 m and 0.4 rad off, for certain, as a fault that nothing has noticed: no pinger fits."""
    scenario = Scenario(vehicle=FAR, duration=65.0, seed=4)
    passes = SlamPasses(config(bearing_std=math.radians(1), source_ids=tuple(FAR_PINGERS)))
    events, fault = measurements(scenario, math.radians(1), FAR_PINGERS), scenario.t_ns(55.0)
    feed(passes, [e for e in events if e[0] < fault])
    passes.slam.joint.mean[[0, 1, YAW]] += (8.0, -4.0, 0.4)
    feed(passes, [e for e in events if e[0] >= fault])
    assert passes.slam.relocations == 1 and passes.slam.relocation is None
    origin, rotation, _ = start_frame(scenario)
    end = Trajectory(FAR).at(scenario.duration).positions[:2, 0]
    assert math.dist(passes.slam.joint.mean[:2], rotation @ (end - origin)) < 2.0
    assert all(pinger.restarts == 0 for pinger in passes.slam.pingers.values())
