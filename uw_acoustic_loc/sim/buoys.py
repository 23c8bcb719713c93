"""Buoys that time the vehicle's ping, and the measured offsets of their moorings."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator

import numpy as np

from ..contract import Event, Output
from ..core.geometry import quat_from_yaw
from ..core.impulsive import AlphaStable, ImpulsiveNoise
from ..core.mooring.estimator import discretise
from ..core.toa.paths import make_net
from ..core.types import AnyArray, Array, Arrivals, NodePositions, Odometry, Point, Scalar
from .environment import SoundSpeed
from .rays import LinearProfile
from .scenario import Buoys, Mooring, Scenario, Vehicle
from .trajectory import Trajectory

PROCESSING = 0.01  # s from the last arrival of a ping to its message
_PING_KEY, _MOORING_KEY, _CLOCK_KEY, _IMPULSE_KEY, _DRIFT_KEY = (
    0xB007,
    0x3007,
    0xC10C,
    0x1397,
    0xD21F,
)  # of these sensors' random numbers


class BuoySource:
    """Publishes direct and bottom arrivals of each ping with the truth, and each mooring's measured offset.

    Geometry and sound speed are those of the emission; a path is missing where it reflects nothing. Arrivals of a ping
    are available after the last of them, in the order of the pings.

    Raises:
        ValueError: buoys without a vehicle, or buoys with repeated ids.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._pings = None
        if scenario.buoys:
            if scenario.vehicle is None:
                raise ValueError("buoys: the scenario must have a vehicle, whose ping they time")
            self._pings = _Pings(scenario, scenario.buoys, scenario.vehicle)

    @property
    def outputs(self) -> tuple[Output, ...]:
        moorings = (
            output
            for mooring in self._scenario.moorings
            for output in (
                Output(f"mooring/{mooring.id}/offset", Point),
                Output(f"/truth/mooring/{mooring.id}/odometry", Odometry),
            )
        )
        return (*(_PING_OUTPUTS if self._pings else ()), *moorings)

    def events(self) -> Iterator[Event]:
        streams = [_mooring_events(self._scenario, k) for k in range(len(self._scenario.moorings))]
        if self._pings:
            streams = [self._pings.positions(), self._pings.truth(), self._pings.arrivals(), *streams]
        return heapq.merge(*streams, key=lambda event: event[0])


class _Pings:
    """The vehicle's pings: where everything is at each of them, and what the buoys receive."""

    def __init__(self, scenario: Scenario, buoys: Buoys, vehicle: Vehicle) -> None:
        self._scenario, self._buoys = scenario, buoys
        self._ids = [node.id for node in buoys.nodes]
        nodes = np.array([[node.x, node.y, node.z] for node in buoys.nodes]).reshape(-1, 3)
        make_net(self._ids, nodes, scenario.environment.depth)  # refuses ids that are repeated
        count = math.floor(scenario.duration / buoys.period + 1e-9) + 1
        self._times: Array = np.asarray(np.arange(count) * buoys.period)
        course = scenario.rng(_DRIFT_KEY).uniform(0.0, 2 * np.pi, len(self._ids))
        drift = buoys.drift_speed * np.stack([np.cos(course), np.sin(course), np.zeros(len(course))], axis=1)
        self._nodes: Array = nodes + self._times[:, None, None] * drift  # (pings, buoys, 3), as the buoys publish them
        self._truly: Array = self._nodes.copy()  # where they are
        for index, mooring in enumerate(scenario.moorings):
            if mooring.receiver in self._ids:
                offset = _offsets(scenario, index, self._times)
                self._truly[:, self._ids.index(mooring.receiver), 0] += offset
        self._motion = Trajectory(vehicle).at(self._times)
        self._sound_speed = SoundSpeed(scenario).at(self._times)

    def positions(self) -> Iterator[Event]:
        """Yields the positions once, or at every ping where the buoys drift."""
        role = np.full(len(self._ids), NodePositions.RECEIVER, np.uint8)
        for k in range(len(self._times) if self._buoys.drift_speed else 1):
            t_ns = self._scenario.t_ns(self._times[k])
            yield t_ns, "buoys/positions", NodePositions(t_ns, np.array(self._ids, np.uint16), role, *self._nodes[k].T)

    def truth(self) -> Iterator[Event]:
        motion, cov = self._motion, np.zeros((6, 6))
        for k, time in enumerate(self._times):
            t_ns = self._scenario.t_ns(time)
            pose = (motion.positions[:, k].copy(), quat_from_yaw(motion.yaw[k]))
            linear, angular = np.array([motion.speed[k], 0.0, 0.0]), np.array([0.0, 0.0, motion.yaw_rate[k]])
            yield t_ns, "/truth/target/odometry", Odometry(t_ns, *pose, linear, angular, cov, cov, "map", "base_link")
            yield t_ns, "/truth/target/sound_speed", Scalar(t_ns, float(self._sound_speed[k]))

    def arrivals(self) -> Iterator[Event]:
        rng, available = self._scenario.rng(_PING_KEY), self._scenario.start_ns
        for k, time in enumerate(self._times):
            arrivals = self._heard(rng, k, self._scenario.t_ns(time))
            latest = float(arrivals.time.max()) if arrivals.time.size else 0.0
            available = max(available, arrivals.t_ns + round((latest + PROCESSING) * 1e9))
            yield available, "buoys/arrivals", arrivals

    def _heard(self, rng: np.random.Generator, k: int, t_ns: int) -> Arrivals:
        buoys, coefficient = self._buoys, self._scenario.environment.bottom_reflection
        paths = [Arrivals.DIRECT, Arrivals.BOTTOM] if coefficient else [Arrivals.DIRECT]
        net = make_net(self._ids, self._truly[k], self._scenario.environment.depth)
        images = net.images[paths].reshape(-1, 3)
        length = np.linalg.norm(self._motion.positions[:, k] - images, axis=1)
        time = self._travel_times(k, length) + np.tile(self._clock_errors(k), len(paths))
        errors = rng.normal(0.0, buoys.toa_std, len(time))
        time += buoys.impulses.on(buoys.toa_std).strike(self._scenario.rng(_IMPULSE_KEY, k), errors)
        late = rng.random(len(time)) < buoys.outlier_fraction
        time += np.where(late, rng.exponential(buoys.outlier_mean, len(time)), 0.0)
        heard = rng.random(len(time)) >= buoys.miss_fraction
        path = np.repeat(np.array(paths, np.uint8), len(self._ids))
        snr = self._snr_db(path, length)
        heard &= snr >= buoys.detection_threshold
        receiver = np.tile(np.array(self._ids, np.uint16), len(paths))
        std = np.full(len(time), buoys.toa_std, np.float32)
        return Arrivals(t_ns, receiver[heard], path[heard], time[heard], std[heard], snr[heard].astype(np.float32))

    def _travel_times(self, k: int, length: Array) -> Array:
        """Returns (n,) s of the direct and then of the bottom paths, whose straight lengths are (n,) m."""
        water, (x, y, z) = self._scenario.environment, self._motion.positions[:, k]
        if not water.sound_speed_gradient:
            return np.asarray(length / self._sound_speed[k])
        profile = LinearProfile(float(self._sound_speed[k]), water.sound_speed_gradient)
        nodes = self._truly[k]
        flat, height = np.hypot(nodes[:, 0] - x, nodes[:, 1] - y), nodes[:, 2]
        direct = profile.time(flat, z, height)
        return np.concatenate([direct, profile.bottom_time(flat, z, height, water.depth)])[: len(length)]

    def _clock_errors(self, k: int) -> Array:
        """Returns (buoys,) s by which the clocks are ahead at a ping."""
        offset, drift = self._scenario.rng(_CLOCK_KEY).normal(0.0, 1.0, (2, len(self._ids)))
        return np.asarray(self._buoys.clock_offset_std * offset + self._buoys.clock_drift_std * drift * self._times[k])

    def _snr_db(self, path: AnyArray, length: Array) -> Array:
        """Returns (n,) dB of arrivals along paths (n,) of length (n,) m; the seabed takes the reflection's loss."""
        coefficient = abs(self._scenario.environment.bottom_reflection)
        loss_db = -20 * math.log10(coefficient) if coefficient else 0.0
        spreading = 20 * np.log10(length / self._buoys.snr_distance) if self._buoys.snr_distance else np.zeros(1)
        return np.asarray(self._buoys.snr_db - loss_db * (path == Arrivals.BOTTOM) - spreading)


def _mooring_events(scenario: Scenario, index: int) -> Iterator[Event]:
    """Yields truth and measured offset at every period."""
    name = scenario.moorings[index].id
    for time, state, measured in _mooring_states(scenario, index):
        t_ns = scenario.t_ns(time)
        yield t_ns, f"/truth/mooring/{name}/odometry", _mooring_truth(t_ns, name, state)
        yield t_ns, f"mooring/{name}/offset", Point(t_ns, np.array([measured, 0.0, 0.0]))


def _mooring_states(scenario: Scenario, index: int) -> Iterator[tuple[float, Array, float]]:
    """Yields time, offset with its velocity, and measured offset at every period, from `start` at rest."""
    mooring, rng = scenario.moorings[index], scenario.rng(_MOORING_KEY, index)
    noise = _noise(mooring)
    F, drive = discretise(mooring.mass, mooring.damping, mooring.stiffness, mooring.force, mooring.period)
    state = np.array([mooring.start, 0.0])
    for k in range(math.floor(scenario.duration / mooring.period + 1e-9) + 1):
        yield k * mooring.period, state, state[0] + float(noise.draw(rng, 1)[0])
        state = F @ state + drive + np.array([rng.normal(0.0, mooring.process_std), 0.0])


def _offsets(scenario: Scenario, index: int, times: Array) -> Array:
    """Returns the true offset (n,) m of a mooring at times (n,) s."""
    known = [(time, state[0]) for time, state, _ in _mooring_states(scenario, index)]
    return np.asarray(np.interp(times, *np.transpose(known)))


def _mooring_truth(t_ns: int, name: str, state: Array) -> Odometry:
    along, quat, cov = np.array([1.0, 0.0, 0.0]), quat_from_yaw(0.0), np.zeros((6, 6))
    child = f"mooring/{name}"
    return Odometry(t_ns, state[0] * along, quat, state[1] * along, np.zeros(3), cov, cov, "map", child)


def _noise(mooring: Mooring) -> ImpulsiveNoise:
    scale = max(mooring.impulse_scale, 1e-9)
    stable = AlphaStable(mooring.impulse_alpha, mooring.impulse_beta, scale, mooring.impulse_location)
    return ImpulsiveNoise(mooring.measurement_std, mooring.impulse_fraction, stable)


_PING_OUTPUTS = (
    Output("buoys/positions", NodePositions, latched=True),
    Output("buoys/arrivals", Arrivals),
    Output("/truth/target/odometry", Odometry),
    Output("/truth/target/sound_speed", Scalar),
)
