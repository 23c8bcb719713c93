"""The channel from a still source to two moving hydrophones: delay, Doppler, spreading and absorption of every path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..core.types import AnyArray, Array

Indices: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.intp]]

_KNOT = 1e-4  # s between the instants at which the hydrophones' path is evaluated
_BATCH = 2**15  # samples that are worked out at once: they fit the processor's cache


@dataclass(frozen=True)
class EmittedPulse:
    """A pulse as it leaves the source."""

    emission: float  # s
    length: float  # s
    sound_speed: float  # m/s, the same all along the paths
    wave: Callable[[Array], Array]  # pressure at 1 m at ages (...); 0 before age 0 and after `length`


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
        self.interval = self.step / sample_rate  # s
        self.times = np.arange(math.ceil(size / self.step) + 1) * self.interval  # (K,) s
        self._share = np.arange(self.step) / self.step

    def between(self, values: Array) -> Array:
        """Interpolates values (..., n) at knots to (..., (n - 1) step) samples, without the last knot's own."""
        steps = values[..., :-1, None] + np.diff(values)[..., None] * self._share
        return np.asarray(steps.reshape(*values.shape[:-1], -1))


class Reception:
    """What the hydrophones receive of one source during a frame.

    The source is still, so a sound that arrives at t left it at t - |x(t) - source| / c exactly: nothing to iterate.
    """

    def __init__(self, knots: Knots, times: Array, positions: Array, paths: Paths) -> None:
        """`times` (2, K) s and `positions` (3, 2, K) m of the hydrophones at the knots."""
        self._knots, self._times, self._positions, self._paths = knots, times, positions, paths
        middle = positions[:, :, positions.shape[2] // 2]
        self._middle = _lengths(middle[:, :, None] - paths.sources[:, None, :])  # (2, P)
        self._slack = float(_lengths(np.diff(positions)).sum(axis=1).max())  # m, no path changes by more

    @property
    def reach(self) -> tuple[float, float]:
        """Bounds of the shortest and the longest distance of any path, m."""
        return float(self._middle.min()) - self._slack, float(self._middle.max()) + self._slack

    def add(self, ping: EmittedPulse, pressure: AnyArray) -> None:
        """Adds a ping over all paths to the pressure (2, N)."""
        knots, slack = self._knots, self._slack / ping.sound_speed
        count = math.ceil((ping.length + 2 * slack) / knots.interval) + 2  # intervals in which a path may be heard
        batch = max(1, _BATCH // (count * knots.step))
        for channel in range(2):
            begin = ping.emission + self._middle[channel] / ping.sound_speed - slack - self._times[channel, 0]
            first = np.floor(begin / knots.interval).astype(np.intp)
            heard = np.flatnonzero((first + count > 0) & (first < knots.times.size - 1))
            for k in range(0, heard.size, batch):
                some = heard[k : k + batch]
                sound = self._sound(ping, channel, some, first[some, None] + np.arange(count + 1))
                _overlay(pressure[channel], sound, first[some] * knots.step)

    def _sound(self, ping: EmittedPulse, channel: int, paths: Indices, knots: Indices) -> Array:
        """(n, N) pressure of paths (n,) between knots (n, k); it means nothing beyond the frame."""
        knots = np.clip(knots, 0, self._knots.times.size - 1)
        sources = self._paths.sources[:, paths]
        distance = _lengths(self._positions[:, channel][:, knots] - sources[:, :, None])
        age = self._times[channel][knots] - ping.emission - distance / ping.sound_speed
        level = self._level(distance, self._paths.gains[paths, None])
        return self._knots.between(level) * ping.wave(self._knots.between(age))

    def _level(self, distance: Array, gain: Array) -> Array:
        """Applies absorption, and spherical spreading from 1 m on; nearer than 1 m the level stays that at 1 m."""
        lost = np.exp((-math.log(10.0) / 20.0 * self._paths.absorption) * distance)
        return np.asarray(gain * lost / np.maximum(distance, 1.0))


def _lengths(vectors: Array) -> Array:
    """(...) lengths of vectors (3, ...)."""
    return np.asarray(np.sqrt(np.square(vectors).sum(axis=0)))


def _overlay(pressure: AnyArray, sounds: Array, begins: Indices) -> None:
    """Adds sounds (n, k) to the pressure (N,) from the samples (n,) on; what lies outside is left out."""
    for sound, begin in zip(sounds, begins.tolist(), strict=True):
        low, high = max(begin, 0), min(begin + sound.size, pressure.size)
        pressure[low:high] += sound[low - begin : high - begin]
