"""The vehicle's two hydrophones: every pinger's pings with their reflections, noise, thrusters, and the converter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from ..contract import Event, Output
from ..core.geometry import hydrophone_positions, rotation_from_rpy
from ..core.types import AnyArray, Array, HydrophoneInfo, Point, Samples
from .acoustics import absorption, images, pings, pulse, sounding, tone_phases
from .channel import EmittedPulse, Knots, Paths, Reception
from .converter import convert, scale
from .environment import SoundSpeed
from .noise import GaussianNoise, ThrusterNoise, add_snaps
from .scenario import Pinger, Scenario
from .trajectory import Trajectory
from .water import Environment

_KEY = 0x4A7D  # keeps this noise apart from the other sensors'
_PULSE_KEY = 0x4A7E  # of the noise pulses
_THRUSTER_KEY = 0x4A7F


class HydrophoneSource:
    """Frame k covers [k L, (k + 1) L) after the start and is available at its end.

    Raises:
        ValueError: the scenario has no vehicle to carry the hydrophones.
    """

    def __init__(self, scenario: Scenario) -> None:
        if scenario.vehicle is None:
            raise ValueError("scenario: key 'vehicle' is missing, the hydrophones need one that carries them")
        self._scenario, self._array, env = scenario, scenario.hydrophones, scenario.environment
        self._trajectory = Trajectory(scenario.vehicle)
        self._sound_speed = SoundSpeed(scenario)
        self._size = round(self._array.frame_length * self._array.sample_rate)
        turned = rotation_from_rpy(0.0, 0.0, self._array.array_yaw) @ hydrophone_positions(self._array.spacing).T
        self._in_base = turned + np.array(self._array.array_position)[:, None]
        self._paths = [_paths(p, env) for p in scenario.pingers]
        self._knots = Knots(self._size, self._array.sample_rate)
        self._noise = GaussianNoise(env, self._array, self._size)
        thrusters = scenario.vehicle.thrusters
        self._thrusters = [ThrusterNoise(t, scenario, self._in_base, self._trajectory) for t in thrusters]
        self._impulses = self._array.impulses.on(self._array.noise_std)

    @property
    def outputs(self) -> tuple[Output, ...]:
        info = Output("hydrophones/info", HydrophoneInfo, latched=True)
        truths = (Output(_truth(p), Point, latched=True) for p in self._scenario.pingers)
        return (info, *truths, Output("hydrophones/samples", Samples))

    def events(self) -> Iterator[Event]:
        start, rate = self._scenario.start_ns, self._array.sample_rate
        yield start, "hydrophones/info", self._info()
        for p in self._scenario.pingers:
            yield start, _truth(p), Point(start, np.array([p.x, p.y, p.z]))
        for k in range(math.floor(self._scenario.duration * rate / self._size + 1e-9)):
            yield self._scenario.t_ns((k + 1) * self._size / rate), "hydrophones/samples", self.frame(k)

    def frame(self, k: int) -> Samples:
        """Frame k, the same whichever frames were made before."""
        begin = k * self._size / self._array.sample_rate
        rng = self._scenario.rng(_KEY, k)
        pressure = self._impulses.strike(rng, self._noise.draw(rng))
        add_snaps(pressure, self._scenario.environment, self._array, rng)
        for which, thruster in enumerate(self._thrusters):
            thruster.add(pressure, begin, self._scenario.rng(_THRUSTER_KEY, which, k))
        self._add_pings(begin, pressure)
        h0, h1 = convert(pressure, self._array)
        return Samples(self._scenario.t_ns(begin), h0, h1)

    def positions(self, time: Array, channel: Array) -> Array:
        """(3, n) in map of the hydrophones (n,) of the given channels at times (n,) after the start."""
        motion = self._trajectory.at(time)
        cos, sin = np.cos(motion.yaw), np.sin(motion.yaw)
        x, y, z = self._in_base[:, channel]
        return np.asarray(motion.positions + np.stack([cos * x - sin * y, sin * x + cos * y, z]))

    def _info(self) -> HydrophoneInfo:
        """What a driver knows: the mean sound speed, not the true one."""
        a, c = self._array, self._scenario.environment.sound_speed
        return HydrophoneInfo(self._scenario.start_ns, a.sample_rate, a.spacing, c, scale(a))

    def _add_pings(self, begin: float, pressure: AnyArray) -> None:
        """Adds what reaches the hydrophones during the frame; pings that began in an earlier one go on."""
        late = np.array([[0.0], [self._array.channel_delay]])
        times = begin + self._knots.times - late
        channel = np.repeat([0, 1], self._knots.times.size)
        positions = self.positions(times.ravel(), channel).reshape(3, *times.shape)
        for k, (pinger, paths) in enumerate(zip(self._scenario.pingers, self._paths, strict=True)):
            reception = Reception(self._knots, times, positions, paths)
            for ping in self._pings(k, pinger, times, reception.reach):
                reception.add(ping, pressure)

    def _pings(self, k: int, pinger: Pinger, times: Array, reach: tuple[float, float]) -> Iterator[EmittedPulse]:
        """The pings of a pinger that may be heard at the times, at a distance within reach."""
        env, length = self._scenario.environment, sounding(pinger)
        slowest, fastest = env.sound_speed - env.sound_speed_range, env.sound_speed + env.sound_speed_range
        for n in pings(pinger, times.min() - reach[1] / slowest - length, times.max() - reach[0] / fastest):
            emission = pinger.offset + n * pinger.period
            phases = tone_phases(pinger, self._scenario.rng(_PULSE_KEY, k, n))
            c = float(self._sound_speed.at(emission))
            yield EmittedPulse(emission, length, c, partial(pulse, pinger, phases=phases))


def _paths(pinger: Pinger, env: Environment) -> Paths:
    centre = 0.5 * (pinger.band_low + pinger.band_high)
    return Paths(*images(np.array([pinger.x, pinger.y, pinger.z]), env), absorption(centre, env))


def _truth(pinger: Pinger) -> str:
    return f"/truth/sources/{pinger.id}/position"
