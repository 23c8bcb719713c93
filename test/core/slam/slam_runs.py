"""Runs of the setting of Choi, Lee, Choi 2016 for the tests of EKF-SLAM."""

from __future__ import annotations

import math

import numpy as np

from uw_acoustic_loc.config import build
from uw_acoustic_loc.core.geometry import wrap_angle
from uw_acoustic_loc.core.localizer.triangulation import PlanarFix
from uw_acoustic_loc.core.slam.config import SlamConfig
from uw_acoustic_loc.core.slam.filter import Slam, SourceBearing
from uw_acoustic_loc.core.slam.relinearise import SlamPasses
from uw_acoustic_loc.core.types import Bearing
from uw_acoustic_loc.sim.scenario import Scenario, Vehicle, Waypoint
from uw_acoustic_loc.sim.trajectory import Trajectory
from uw_acoustic_loc.sim.vehicle import VehicleSource

STD = math.radians(5)
PINGERS = {"a": (15.66, 23.79), "b": (18.87, 11.46), "c": (8.0, 16.0)}  # Choi et al. 2016, table 1; c is ours
PATH = tuple(Waypoint(x, y) for x, y in ((0, 20), (24, 0), (20, -4), (-3, 15)))
BOAT = Vehicle(waypoints=PATH, speed=0.33, turn_radius=1.5, z=0.0)
SCENARIO = Scenario(vehicle=BOAT, duration=195.0)  # upper left to lower right and back
ZERO = np.zeros(2)


def config(**values):
    return build(
        SlamConfig, {"source_ids": tuple(PINGERS), "bearing_std": STD, "bearing_correlation_time": 0.0} | values, "test"
    )


def start_frame(scenario: Scenario) -> tuple[np.ndarray, np.ndarray, float]:
    start = Trajectory(scenario.vehicle).at(0.0)
    yaw = float(start.yaw[0])
    return start.positions[:2, 0], np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]]), yaw


def measurements(scenario: Scenario, std: float = STD, pingers=PINGERS) -> list[tuple[int, str, object]]:
    events = [e for e in VehicleSource(scenario).events() if e[1] in ("imu/data", "dvl/twist")]
    rng = np.random.default_rng([scenario.seed, 77])
    times = np.arange(0.013, scenario.duration, 0.1)
    motion = Trajectory(scenario.vehicle).at(times)
    for name, (x, y) in pingers.items():
        bearings = np.arctan2(y - motion.positions[1], x - motion.positions[0]) - motion.yaw
        bearings += rng.normal(0, std, times.size)
        events += [(scenario.t_ns(t), name, wrap_angle(b)) for t, b in zip(times, bearings, strict=True)]
    return sorted(events, key=lambda event: event[0])


def feed(slam: Slam | SlamPasses, events: list[tuple[int, str, object]], image=lambda bearing: bearing) -> None:
    for t_ns, topic, value in events:
        if topic in ("imu/data", "dvl/twist"):
            slam.take(value)
        else:
            slam.take(SourceBearing(topic, Bearing(t_ns, image(value), math.nan, np.zeros(3))))


def errors(slam: Slam, scenario: Scenario, pingers=PINGERS) -> dict[str, tuple[float, float]]:
    """Distance and NEES per dimension at the end."""
    origin, rotation, _ = start_frame(scenario)
    end = Trajectory(scenario.vehicle).at(scenario.duration).positions[:2, 0]
    fixes = {"vehicle": (PlanarFix(slam.joint.mean[:2], slam.joint.cov[:2, :2]), end)}
    fixes |= {name: (slam.position(name), np.array(at)) for name, at in pingers.items()}
    found = {}
    for name, (fix, true) in fixes.items():
        assert fix is not None, name
        off = fix.mean - rotation @ (true - origin)
        found[name] = math.hypot(*off), float(off @ np.linalg.solve(fix.cov, off)) / 2
    return found
