"""Where in the samples a ping is: frames joined to blocks, and energy in the band against the noise floor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .gcc import Envelopes
from .types import AnyArray, Array, Samples

DB = 10.0 / math.log(10.0)  # dB per unit of the logarithm of a power
_MEAN_LOG = 1.0 - 0.5772156649015329  # of |n0|^2 + |n1|^2 in noise of power 1 per channel: digamma(2)
_QUIET = 0.3  # quantile of the level that is taken as noise: pings and echoes may fill most of a block
_HEADROOM = 6.0  # dB
_PARTS = 8  # of a pulse length, of which the quieter half must be loud too
_LASTING = 0.6  # of the threshold, that the quieter half must reach
_FLOOR_TIME = 2.0  # s over which the noise floor adapts
_JITTER = 1e-3  # s by which the stamps of adjoining frames may disagree
_SILENCE = 1e-30  # power that stands for digital silence


class FrameJoiner:
    """Puts the tail of the last frame before the next, for pings that straddle the boundary."""

    def __init__(self, sample_rate: float, tail: float) -> None:
        self._rate = sample_rate
        self.tail = round(tail * sample_rate)
        self._last: Samples | None = None
        self._begin_ns = 0
        self.gaps = self.overlaps = 0

    def join(self, frame: Samples) -> Samples:
        """The block that ends with the frame; after a gap or an overlap in the stamps it is the frame alone.

        Raises:
            ValueError: the frame begins no later than the last one did.
        """
        if frame.t_ns <= self._begin_ns:
            self.overlaps += 1
            raise ValueError(f"samples must begin after the frame before, at {self._begin_ns} ns, got {frame.t_ns} ns")
        self._begin_ns = frame.t_ns
        block = frame if self._last is None else self._joined(self._last, frame)
        keep = slice(max(0, block.h0.size - self.tail), None)
        t_ns = block.t_ns + round(1e9 * keep.start / self._rate)
        self._last = Samples(t_ns, block.h0[keep], block.h1[keep])
        return block

    def _joined(self, last: Samples, frame: Samples) -> Samples:
        expected = last.t_ns + round(1e9 * last.h0.size / self._rate)
        off = (frame.t_ns - expected) * 1e-9
        if abs(off) > _JITTER or last.h0.dtype != frame.h0.dtype:
            self.gaps += off > -_JITTER
            self.overlaps += off < -_JITTER
            return frame
        t_ns = frame.t_ns - round(1e9 * last.h0.size / self._rate)
        return Samples(t_ns, np.concatenate([last.h0, frame.h0]), np.concatenate([last.h1, frame.h1]))


@dataclass(frozen=True)
class Ping:
    """A ping in a block of envelopes."""

    start: int  # first envelope sample
    t_ns: int  # when it reached the middle of the array


class PingDetector:
    """The onsets in one band: mean log energy over a pulse length against the noise floor (Choi et al. 2016, eq. 1).

    The logarithm is taken before the mean and no sample counts for more than the threshold and some headroom, so that
    a loud echo does not hide the direct path before it. A ping lasts: in a click's window the quieter half is noise.
    """

    def __init__(self, pulse_length: float) -> None:
        self._pulse = pulse_length
        self._floor = math.nan
        self._last_ns = -(1 << 62)
        self.too_short = 0  # loud enough, but no ping

    @property
    def noise_power(self) -> float:
        """Of an envelope sample of one channel; NaN before the first block."""
        return math.exp(self._floor - _MEAN_LOG)

    def detect(self, log_energy: AnyArray, rate: float, t_ns: int, threshold_db: float) -> list[Ping]:
        """Onsets whose pulse lies wholly in the block (m,), in time order; one cut by its end is left to the next."""
        window = max(4, round(self._pulse * rate))
        if log_energy.size < 2 * window:
            return []
        sums, level = _means(log_energy, window)
        self._adapt(level[:: max(1, window // 8)], log_energy.size / rate)
        capped, level = _means(np.minimum(log_energy, self._floor + (threshold_db + _HEADROOM) / DB), window)
        done = math.ceil(((self._last_ns - t_ns) * 1e-9 + self._pulse) * rate)
        starts = sorted(self._starts(level, capped, max(0, done), threshold_db / DB))
        onsets = [_onset(sums, k, window) for k in starts]
        pings = [Ping(k, t_ns + round(1e9 * k / rate)) for k in onsets]
        if pings:
            self._last_ns = pings[-1].t_ns
        return pings

    def _adapt(self, level: Array, duration: float) -> None:
        quiet = float(np.partition(level, int(_QUIET * level.size))[int(_QUIET * level.size)])
        share = 1.0 if math.isnan(self._floor) else min(1.0, duration / _FLOOR_TIME)
        self._floor = quiet if share == 1.0 else self._floor + share * (quiet - self._floor)

    def _starts(self, level: Array, sums: Array, done: int, threshold: float) -> list[int]:
        """The strongest first, a pulse length apart; a maximum at the block's edge is a ping that is cut."""
        left, window = level - self._floor, sums.size - level.size
        left[:done] = -math.inf
        found = []
        while left[k := int(left.argmax())] > threshold:
            whole = 0 < k < level.size - 1 and level[k - 1] <= level[k]
            if whole and self._lasts(sums, k, window, threshold):
                found.append(k)
            self.too_short += int(whole and found[-1:] != [k])
            left[max(0, k - window) : k + window] = -math.inf
        return found

    def _lasts(self, sums: Array, start: int, window: int, threshold: float) -> bool:
        edges = _edges(window)
        at = sums[start : start + window + 1].take(edges)
        means = ((at[1:] - at[:-1]) / (edges[1:] - edges[:-1])).tolist()
        half = sorted(means)[: len(means) // 2]
        return bool(sum(half) / len(half) - self._floor > _LASTING * threshold)


def log_energies(envelopes: Envelopes) -> AnyArray:
    """(B, m) logarithm of the energy of both channels together."""
    x = envelopes.values
    return np.asarray(np.log((x.real**2 + x.imag**2).sum(axis=1) + np.float32(_SILENCE)))


def _means(log_energy: AnyArray, window: int) -> tuple[Array, Array]:
    """(m + 1,) running sums, and (m + 1 - window,) means of the windows that start at each sample."""
    sums = np.zeros(log_energy.size + 1)
    log_energy.cumsum(dtype=np.float64, out=sums[1:])
    return sums, (sums[window:] - sums[:-window]) / window


@lru_cache(maxsize=16)
def _edges(window: int) -> NDArray[np.intp]:
    """Of the parts of a pulse."""
    count = min(_PARTS, window)
    return np.arange(count + 1) * window // count


def _onset(sums: Array, start: int, window: int) -> int:
    """The steepest rise near the strongest window: echoes pull the window late, the rise is the direct path's."""
    half = window // 2
    first, last = max(half, start - half), min(sums.size - 1 - half, start + half // 2) + 1
    if first >= last:
        return start
    rise = sums[first + half : last + half] - 2 * sums[first:last] + sums[first - half : last - half]
    return first + int(rise.argmax())
