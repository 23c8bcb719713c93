"""The vehicle's two hydrophones: every pinger's pings with their reflections, noise, and the converter."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..contract import Event, Output
from ..core.geometry import hydrophone_positions, rotation_from_rpy
from ..core.types import AnyArray, Array, HydrophoneInfo, Point, Samples
from .acoustics import arrival_times, emissions, images, pulse
from .environment import SoundSpeed
from .scenario import Pinger, Scenario
from .trajectory import Trajectory

_KEY = 0x4A7D  # keeps this noise apart from the other sensors'
_COUNTS = 32767


class HydrophoneSource:
    """Frame k covers [k L, (k + 1) L) after the start and is available at its end.

    Raises:
        ValueError: the scenario has no vehicle to carry the hydrophones.
    """

    def __init__(self, scenario: Scenario) -> None:
        if scenario.vehicle is None:
            raise ValueError("scenario: key 'vehicle' is missing, the hydrophones need one that carries them")
        self._scenario, self._array, self._vehicle = scenario, scenario.hydrophones, scenario.vehicle
        self._trajectory = Trajectory(scenario.vehicle)
        self._sound_speed = SoundSpeed(scenario)
        self._size = round(self._array.frame_length * self._array.sample_rate)
        turned = rotation_from_rpy(0.0, 0.0, self._array.array_yaw) @ hydrophone_positions(self._array.spacing).T
        self._in_base = turned + np.array(self._array.array_position)[:, None]
        self._images = [images(np.array([p.x, p.y, p.z]), scenario.environment) for p in scenario.pingers]

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
        pressure = self._scenario.rng(_KEY, k).standard_normal((2, self._size), dtype=np.float32)
        pressure *= np.float32(self._array.noise_std)
        for pinger, (paths, gains) in zip(self._scenario.pingers, self._images, strict=True):
            self._add(pinger, paths, gains, begin, pressure)
        h0, h1 = self._converted(pressure)
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
        return HydrophoneInfo(self._scenario.start_ns, a.sample_rate, a.spacing, c, a.full_scale / _COUNTS)

    def _add(self, pinger: Pinger, paths: Array, gains: Array, begin: float, pressure: AnyArray) -> None:
        """Adds what of a pinger's sound reaches the hydrophones during the frame, over all paths."""
        end = begin + self._size / self._array.sample_rate
        times = emissions(pinger, begin - self._longest(paths, begin, end) - pinger.pulse_length, end)
        path, emission, channel = (
            a.ravel() for a in np.meshgrid(np.arange(gains.size), times, np.array([0, 1]), indexing="ij")
        )
        first, last = self._arrivals(paths[:, path], emission, channel, pinger.pulse_length)
        level = gains[path] / ((first - emission) * self._sound_speed.at(emission))  # spherical spreading
        for k in range(level.size):
            self._add_pulse(pinger, level[k], first[k] - begin, last[k] - begin, pressure[channel[k]])

    def _longest(self, paths: Array, begin: float, end: float) -> float:
        """A travel time that no sound arriving during the frame exceeds."""
        here = self._trajectory.at(begin).positions
        reach = float(np.sqrt(np.square(paths - here).sum(axis=0)).max()) + float(np.abs(self._in_base).sum())
        env = self._scenario.environment
        return (reach + self._vehicle.speed * (end - begin)) / (env.sound_speed - env.sound_speed_range)

    def _arrivals(self, sources: Array, emission: Array, channel: Array, length: float) -> Array:
        """(2, n) arrival of the beginning and of the end of each pulse."""
        emitted = np.concatenate([emission, emission + length])
        both = np.concatenate([channel, channel])
        c = np.tile(self._sound_speed.at(emission), 2)
        heard = arrival_times(np.tile(sources, 2), emitted, lambda t: self.positions(t, both), c)
        return heard.reshape(2, -1)

    def _add_pulse(self, pinger: Pinger, level: float, first: float, last: float, pressure: AnyArray) -> None:
        """Adds a pulse heard from `first` to `last` s after the frame's first sample.

        Between its ends the emission time is linear in the arrival time; the curvature is below 2 ns at 2 m/s.
        """
        rate = self._array.sample_rate
        low, high = max(0, math.ceil(first * rate)), min(pressure.size, math.floor(last * rate) + 1)
        if low < high:
            age = (np.arange(low, high) / rate - first) * (pinger.pulse_length / (last - first))
            pressure[low:high] += level * pulse(pinger, age)

    def _converted(self, pressure: AnyArray) -> AnyArray:
        limit = np.float32(self._array.full_scale)
        clipped = np.clip(pressure, -limit, limit)
        if self._array.format == "float32":
            return clipped
        return np.rint(clipped * (np.float32(_COUNTS) / limit)).astype(np.int16)


def _truth(pinger: Pinger) -> str:
    return f"/truth/sources/{pinger.id}/position"
