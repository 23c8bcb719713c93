"""Monte Carlo trials of bearing-only SLAM in the setting of Choi, Lee, Choi 2016, section 4."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...core.localizer.triangulation import PlanarFix
from ...core.slam.config import SlamConfig
from ...core.slam.filter import Slam, SourceBearing
from ...core.slam.inertial import YAW
from ...core.slam.relinearise import SlamPasses
from ...core.types import Array
from ...sim.scenario import Pinger, Scenario, Vehicle, Waypoint
from ...sim.trajectory import Trajectory
from ...sim.vehicle import VehicleSource
from .bearings import bearings

PINGERS = (  # their table 1; the third, a misprint there, is ours
    Pinger("s1", 15.66, 23.79, 0.0, 20e3, 24e3),
    Pinger("s2", 18.87, 11.46, 0.0, 25e3, 29e3),
    Pinger("s3", 8.0, 16.0, 0.0, 30e3, 34e3),
)
STD = math.radians(5.0)
CORRELATION = 0.95  # at 10 Hz, of a bearing filter's errors
RANGE_MAX = 100.0  # m
_CORNERS = ((0, 20), (24, 0), (20, -4), (-3, 15))  # upper left to lower right and back
_BOAT = Vehicle(tuple(Waypoint(x, y) for x, y in _CORNERS), speed=0.33, turn_radius=1.5, z=0.0, odometry_rate=5.0)
SCENARIO = Scenario(vehicle=_BOAT, pingers=PINGERS, duration=195.0)


@dataclass(frozen=True)
class NoiseCase:
    """The correlation of the bearings' errors, and the correlation time in s that the filter assumes."""

    correlation: float
    assumed: float


WHITE = NoiseCase(0.0, 0.0)
IGNORED = NoiseCase(CORRELATION, 0.0)
HANDLED = NoiseCase(CORRELATION, -0.1 / math.log(CORRELATION))


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The estimate at an instant, in map."""

    time: float  # s
    vehicle: PlanarFix
    heading: float  # rad
    pingers: dict[str, PlanarFix]  # those that are known


@dataclass(frozen=True, eq=False)
class SlamRun:
    """One run; everything in map, a snapshot per odometry."""

    snapshots: tuple[Snapshot, ...]
    truth: Array  # (n, 2) m
    reckoned: Array  # (n, 2) m, dead reckoning
    heard: dict[str, Array]  # (m, 2) time in s and bearing in rad, by pinger

    @property
    def error(self) -> Array:
        """(n,) m, of the vehicle's position."""
        return _lengths(np.array([s.vehicle.mean for s in self.snapshots]) - self.truth)

    @property
    def drift(self) -> Array:
        """(n,) m, of the dead reckoning."""
        return _lengths(self.reckoned - self.truth)


@dataclass(frozen=True)
class End:
    """What a run comes to; NEES is per dimension. A pinger that was not found counts as RANGE_MAX off, without NEES."""

    distance: dict[str, float]  # m, by pinger
    place: dict[str, tuple[float, float]]  # m, in map
    nees: dict[str, float]  # of the pingers and of `vehicle`
    rmse: float  # m, of the vehicle over the run
    drift: float  # m, of the dead reckoning at the end


def ends(case: NoiseCase, runs: int, seed: int, progress: Callable[[float], None]) -> list[End]:
    """Runs with a seed of their own each; `progress` gets the share that is done."""
    found = []
    for k in range(runs):
        found.append(end(trial(case, k, seed)))
        progress((k + 1) / runs)
    return found


def trial(case: NoiseCase, run: int, seed: int) -> SlamRun:
    """One run with its history."""
    scenario = replace(SCENARIO, seed=int(np.random.SeedSequence([seed, run]).generate_state(1)[0]))
    config = SlamConfig(tuple(PLACES), bearing_correlation_time=case.assumed, range_max=RANGE_MAX)
    passes, frame = SlamPasses(config), _Frame()
    heard: dict[str, list[tuple[float, float]]] = {name: [] for name in PLACES}
    snapshots, reckoned, truth = [], [], []
    for t_ns, topic, value in _events(scenario, case):
        time = (t_ns - scenario.start_ns) * 1e-9
        if topic in ("imu/data", "dvl/twist"):
            passes.take(value)
        elif topic == "odometry":
            snapshots.append(frame.snapshot(passes.slam, time))
            reckoned.append(frame.point(value.position[:2]))
        elif topic in _SOURCES:
            heard[_SOURCES[topic]].append((time, value.bearing))
            passes.take(SourceBearing(_SOURCES[topic], value))
        else:
            truth.append(value.position[:2])
    arrays = {name: np.array(pairs) for name, pairs in heard.items()}
    return SlamRun(tuple(snapshots), np.array(truth), np.array(reckoned), arrays)


def end(run: SlamRun) -> End:
    """The last snapshot against the truth."""
    last = run.snapshots[-1]
    fixes = last.pingers
    distance = {name: math.dist(fixes[name].mean, at) if name in fixes else RANGE_MAX for name, at in PLACES.items()}
    nees = {name: _nees(fix, np.array(PLACES[name])) for name, fix in fixes.items()}
    nees["vehicle"] = _nees(last.vehicle, run.truth[-1])
    place = {name: (float(fix.mean[0]), float(fix.mean[1])) for name, fix in fixes.items()}
    rmse = math.sqrt(float(np.mean(np.square(run.error))))
    return End(distance, place, nees, rmse, float(run.drift[-1]))


class _Frame:
    """odom in map: the true pose at the start."""

    def __init__(self) -> None:
        start = Trajectory(_BOAT).at(0.0)
        self._origin, self._yaw = start.positions[:2, 0], float(start.yaw[0])
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        self._rotation = np.array([[c, -s], [s, c]])

    def point(self, xy: Array) -> Array:
        return np.asarray(self._origin + self._rotation @ xy)

    def fix(self, fix: PlanarFix) -> PlanarFix:
        return PlanarFix(self.point(fix.mean), self._rotation @ fix.cov @ self._rotation.T)

    def snapshot(self, slam: Slam, time: float) -> Snapshot:
        slam.settle()
        mean, cov = slam.joint.mean, slam.joint.cov
        known = {name: slam.position(name) for name in PLACES}
        pingers = {name: self.fix(fix) for name, fix in known.items() if fix is not None}
        return Snapshot(time, self.fix(PlanarFix(mean[:2], cov[:2, :2])), float(mean[YAW]) + self._yaw, pingers)


def _events(scenario: Scenario, case: NoiseCase) -> Iterator[tuple[int, str, Any]]:
    heard = bearings(scenario, STD, case.correlation)
    return heapq.merge(VehicleSource(scenario).events(), heard, key=lambda event: event[0])


def _nees(fix: PlanarFix, true: Array) -> float:
    error = fix.mean - true
    return float(error @ np.linalg.solve(fix.cov, error)) / 2


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.hypot(vectors[:, 0], vectors[:, 1]))


PLACES = {p.id: (p.x, p.y) for p in PINGERS}
_SOURCES = {f"sources/{name}/bearing": name for name in PLACES}
