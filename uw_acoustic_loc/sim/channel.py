"""The channel from a still source to two moving hydrophones: delay, Doppler, spreading and absorption of every path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..core.types import AnyArray, Array

_KNOT = 1e-4  # s between the instants at which the hydrophones' path is evaluated


@dataclass(frozen=True)
class Ping:
    """A pulse as it leaves the source."""

    emission: float  # s
    length: float  # s
    sound_speed: float  # m/s, the same all along the paths
    wave: Callable[[Array], Array]  # pressure at 1 m at ages (n,); 0 before age 0 and after `length`


@dataclass(frozen=True, eq=False)
class Paths:
    """Image sources of one pinger."""

    sources: Array  # (3, P) m
    gains: Array  # (P,) amplitude coefficients
    absorption: float  # dB/m


class Knots:
    """The instants of a frame between which the distance to a source is interpolated linearly.

    The age of a sound is thereby in error by at most h^2 / 8 |r''| / c (0.07 ns at 20 m/s and 5 m from the source),
    and by h / 4 |dv| / c while the velocity jumps by dv (0.9 ns at the start of a turn of 0.19 rad/s, 0.3 m off the
    vehicle's axis), h = 0.1 ms.
    """

    def __init__(self, size: int, sample_rate: float) -> None:
        self.step = max(1, math.floor(_KNOT * sample_rate))  # samples
        self.times = np.arange(math.ceil(size / self.step) + 1) * (self.step / sample_rate)  # (K,) s
        self._share = np.arange(self.step) / self.step

    def between(self, values: Array) -> Array:
        """Interpolates values (n,) at neighbouring knots to ((n - 1) step,) samples, without the last knot's own."""
        return np.asarray((values[:-1, None] + np.diff(values)[:, None] * self._share).ravel())


class Reception:
    """What the hydrophones receive of one source during a frame.

    The source is still, so a sound that arrives at t left it at t - |x(t) - source| / c exactly: nothing to iterate.
    """

    def __init__(self, knots: Knots, times: Array, positions: Array, paths: Paths) -> None:
        """`times` (2, K) s and `positions` (3, 2, K) m of the hydrophones at the knots."""
        self._knots, self._times, self._paths = knots, times, paths
        apart = positions[:, :, None, :] - paths.sources[:, None, :, None]
        self._distance = np.sqrt(np.square(apart, out=apart).sum(axis=0))  # (2, P, K)

    @property
    def reach(self) -> tuple[float, float]:
        """The shortest and the longest distance in m over all paths."""
        return float(self._distance.min()), float(self._distance.max())

    def add(self, ping: Ping, pressure: AnyArray) -> None:
        """Adds a ping over all paths to the pressure (2, N)."""
        age = self._times[:, None, :] - ping.emission - self._distance / ping.sound_speed
        for channel in range(2):
            for path in range(self._paths.gains.size):
                self._add(ping, age[channel, path], channel, path, pressure[channel])

    def _add(self, ping: Ping, age: Array, channel: int, path: int, pressure: AnyArray) -> None:
        """Adds one path to one channel (N,), given the age of the sound at the knots (K,)."""
        first = max(0, int(np.searchsorted(age, 0.0)) - 1)
        last = min(age.size - 1, int(np.searchsorted(age, ping.length)))
        if first >= last:
            return
        heard = slice(first, last + 1)
        level = self._level(self._distance[channel, path, heard], self._paths.gains[path])
        sound = self._knots.between(level) * ping.wave(self._knots.between(age[heard]))
        begin = first * self._knots.step
        end = min(pressure.size, begin + sound.size)
        pressure[begin:end] += sound[: end - begin]

    def _level(self, distance: Array, gain: float) -> Array:
        """Applies absorption, and spherical spreading from 1 m on; nearer than 1 m the level stays that at 1 m."""
        lost = np.exp((-math.log(10.0) / 20.0 * self._paths.absorption) * distance)
        return np.asarray(gain * lost / np.maximum(distance, 1.0))
