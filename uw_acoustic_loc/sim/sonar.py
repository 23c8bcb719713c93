"""The simulated sonar net: echoes of the targets, misses and false alarms."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from operator import itemgetter

import numpy as np

from ..contract import Event, Output
from ..core.geometry import wrap_angles
from ..core.multistatic.estimator import Noise
from ..core.types import Array, Detections, NodePositions, Tracks
from .environment import SoundSpeed
from .scenario import Node, Scenario, Sonar
from .targets import met_by_ping, states


class SonarSource:
    """Publishes one message per ping with everything that the receivers detected of it, in the order of arrival.

    A ping meets a target where the target is at that instant; the truth is where the targets are at the ping's stamp.
    Range sums are exact in 3-D apart from the scenario's noise, which stands for errors of the sound speed too.

    Raises:
        ValueError: the scenario has no sonar, a receiver is beyond max_range, or turns are out of order.
    """

    def __init__(self, scenario: Scenario) -> None:
        if scenario.sonar is None:
            raise ValueError("scenario has no sonar")
        self._scenario, self._sonar = scenario, scenario.sonar
        self._sound_speed = SoundSpeed(scenario)
        self._transmitter = _position(self._sonar.transmitter)
        self._receivers = np.array([_position(node) for node in self._sonar.receivers]).reshape(-1, 3)
        _check(self._sonar, self._transmitter, self._receivers)

    @property
    def outputs(self) -> tuple[Output, ...]:
        return (
            Output("sonar/positions", NodePositions, latched=True),
            Output("sonar/detections", Detections),
            Output("/truth/sonar/targets", Tracks),
        )

    def events(self) -> Iterator[Event]:
        yield self._scenario.start_ns, "sonar/positions", self._positions()
        yield from heapq.merge(self._truth(), self._pings(), key=itemgetter(0))

    @property
    def _times(self) -> list[float]:
        """When the pings are sent, in s after the start."""
        return [k * self._sonar.period for k in range(math.ceil(self._scenario.duration / self._sonar.period))]

    def _positions(self) -> NodePositions:
        nodes = [self._sonar.transmitter, *self._sonar.receivers]
        ids = np.array([node.id for node in nodes], dtype=np.uint16)
        roles = np.full(len(nodes), NodePositions.RECEIVER, dtype=np.uint8)
        roles[0] = NodePositions.TRANSMITTER
        return NodePositions(self._scenario.start_ns, ids, roles, *np.vstack([self._transmitter, self._receivers]).T)

    def _truth(self) -> Iterator[Event]:
        ids = np.array([target.id for target in self._sonar.targets], dtype=np.uint16)
        zeros = np.zeros(len(ids))
        for time in self._times:
            t_ns = self._scenario.t_ns(time)
            positions, velocities = states(self._sonar.targets, np.full(len(ids), time))
            (x, y, z), (vx, vy, vz) = positions.T, velocities.T
            tracks = Tracks(t_ns, ids, x, y, z, vx, vy, vz, zeros)
            yield t_ns, "/truth/sonar/targets", tracks

    def _pings(self) -> Iterator[Event]:
        """Yields the messages up to the scenario's end; a message never overtakes the one before it."""
        last_ns = self._scenario.start_ns
        for index, time in enumerate(self._times):
            heard, duration = self._ping(index, time)
            last_ns = max(last_ns, self._scenario.t_ns(time + duration))
            if last_ns <= self._scenario.t_ns(self._scenario.duration):
                yield last_ns, "sonar/detections", heard

    def _ping(self, index: int, time: float) -> tuple[Detections, float]:
        """The detections of a ping, and the time in s until the last arrives; if none does, the whole window."""
        sonar, speed = self._sonar, float(self._sound_speed.at(time))
        rng = self._scenario.rng(_KEY, index)
        rows = self._outside_blast(np.vstack([self._echoes(time, speed, rng), self._false_alarms(rng)]))
        receiver, ranges, bearings = rows[np.argsort(rows[:, 1], kind="stable")].T
        ids = np.array([node.id for node in sonar.receivers], dtype=np.uint16)[receiver.astype(int)]
        size = len(ranges)
        std = np.full(size, sonar.range_std), np.full(size, sonar.bearing_std)
        heard = Detections(
            self._scenario.t_ns(time), ids, ranges, std[0], wrap_angles(bearings), std[1], np.full(size, _SNR_DB)
        )
        return heard, float(ranges[-1] if size else sonar.max_range) / speed

    def _echoes(self, time: float, speed: float, rng: np.random.Generator) -> Array:
        """Returns (D, 3): receiver's row, range sum in m and bearing in rad of the targets that are not missed."""
        sonar, count = self._sonar, len(self._receivers)
        targets = met_by_ping(
            self._transmitter, len(sonar.targets), lambda delays: states(sonar.targets, time + delays)[0], speed
        )
        noise = Noise(
            np.full(count, sonar.range_std), np.full(count, sonar.bearing_std), sonar.range_noise == "rayleigh"
        )
        range_errors, bearing_errors = noise.draw(rng, (len(targets),))
        if sonar.range_noise == "gaussian":
            range_errors = sonar.impulses.on(sonar.range_std).strike(rng, range_errors)
        heard = rng.random((count, len(targets))) >= sonar.miss_fraction
        legs = targets - self._receivers[:, None]  # (N, T, 3)
        outward = np.linalg.norm(targets - self._transmitter, axis=1)
        ranges = outward + np.linalg.norm(legs, axis=2) + range_errors
        bearings = np.arctan2(legs[..., 1], legs[..., 0]) + bearing_errors
        row = np.broadcast_to(np.arange(count)[:, None], heard.shape)
        return np.stack([row[heard], ranges[heard], bearings[heard]], axis=1)

    def _false_alarms(self, rng: np.random.Generator) -> Array:
        """Returns (D, 3) as `_echoes` does, uniform over each receiver's ellipse of range sums up to max_range."""
        alarms = [np.empty((0, 3))]
        for row, count in enumerate(rng.poisson(self._sonar.false_alarms, len(self._receivers))):
            baseline = self._receivers[row, :2] - self._transmitter[:2]
            points = _in_ellipse(baseline, self._sonar.max_range, int(count), rng)
            sums = np.hypot(*points.T) + np.hypot(*(points - baseline).T)
            bearings = np.arctan2(*(points - baseline).T[::-1])
            alarms.append(np.stack([np.full(count, float(row)), sums, bearings], axis=1))
        return np.vstack(alarms)

    def _outside_blast(self, rows: Array) -> Array:
        """Returns the rows that the direct blast does not mask: those outside a thin ellipse around the baseline."""
        baselines = np.linalg.norm(self._receivers - self._transmitter, axis=1)
        masked_to = baselines[rows[:, 0].astype(int)] + self._sonar.blanking
        heard: Array = rows[(rows[:, 1] > masked_to) | (self._sonar.blanking == 0)]
        return heard


_KEY = 0x50A4
_SNR_DB = 15.0  # of every detection: it does not separate echoes from false alarms


def _in_ellipse(baseline: Array, longest: float, count: int, rng: np.random.Generator) -> Array:
    """Draws (count, 2) points, uniform in area, whose distances to 0 and to `baseline` sum up to `longest` at most."""
    half = float(np.hypot(*baseline)) / 2
    major = longest / 2
    minor = math.sqrt(major * major - half * half)
    radius, angle = np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    along, across = major * radius * np.cos(angle), minor * radius * np.sin(angle)
    ux, uy = baseline / (2 * half) if half > 0 else np.array([1.0, 0.0])
    points: Array = baseline / 2 + np.stack([along * ux - across * uy, along * uy + across * ux], axis=1)
    return points


def _position(node: Node) -> Array:
    return np.array([node.x, node.y, node.z])


def _check(sonar: Sonar, transmitter: Array, receivers: Array) -> None:
    for target in sonar.targets:
        times = [turn.time for turn in target.turns]
        if sorted(set(times)) != times:
            raise ValueError(f"sonar: turns of target {target.id} must be in order of time, got {times}")
    if not len(receivers):
        raise ValueError("sonar: receivers must have at least 1 node, got 0")
    for node, position in zip(sonar.receivers, receivers, strict=True):
        baseline = float(np.linalg.norm(position - transmitter))
        if baseline >= sonar.max_range:
            raise ValueError(
                f"sonar: max_range must exceed the distance of receiver {node.id}, {baseline:g} m, "
                f"got {sonar.max_range:g} m"
            )
