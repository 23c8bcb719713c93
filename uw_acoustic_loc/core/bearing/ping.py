"""Where in the samples a ping is: frames joined to blocks, and energy in the band against the noise floor."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..types import AnyArray, Array, Samples
from .gcc import Envelopes

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


class Ping(NamedTuple):
    """A ping in a block of envelopes."""

    start: int  # first envelope sample
    t_ns: int  # when it reached the middle of the array


class PingDetector:
    """The onsets in each band: mean log energy over a pulse length against the noise floor (Choi et al. 2016, eq. 1).

    The logarithm is taken before the mean and no sample counts for more than the threshold and some headroom, so that
    a loud echo does not hide the direct path before it. A ping lasts: in a click's window the quieter half is noise.
    """

    def __init__(self, pulse_length: float, bands: int) -> None:
        self._pulse = pulse_length
        self._floor = np.zeros(bands)  # mean log energy of noise
        self._last_ns = [0] * bands
        self.too_short = [0] * bands  # loud enough, but no ping
        for band in range(bands):
            self.forget(band)

    def forget(self, band: int) -> None:
        """Begins anew."""
        self._floor[band], self._last_ns[band], self.too_short[band] = math.nan, -(1 << 62), 0

    def noise_power(self, band: int) -> float:
        """Of an envelope sample of one channel; NaN before the first block."""
        return math.exp(self._floor.item(band) - _MEAN_LOG)

    def detect(self, log_energy: AnyArray, rate: float, t_ns: int, threshold_db: float) -> list[list[Ping]]:
        """Per band the onsets whose pulse lies wholly in the block (B, m), in time order.

        One cut by the block's end is left to the next.
        """
        pings: list[list[Ping]] = [[] for _ in self._last_ns]
        window = max(4, round(self._pulse * rate))
        if log_energy.shape[1] < 2 * window:
            return pings
        sums, level = _means(log_energy, window)
        self._adapt(level[:, :: max(1, window // 8)], log_energy.shape[1] / rate)
        threshold = threshold_db / DB
        cap = (self._floor + (threshold + _HEADROOM / DB)).astype(log_energy.dtype)
        capped, level = _means(np.minimum(log_energy, cap[:, None]), window)
        done = [math.ceil(((last_ns - t_ns) * 1e-9 + self._pulse) * rate) for last_ns in self._last_ns]
        bands, starts = self._starts(level, done, window, threshold)
        if not starts:
            return pings
        lasting = self._quieter_half(capped, bands, starts, window) > _LASTING * threshold
        half = window // 2
        rises = _rises(sums, half)
        for band, start, lasts in zip(bands, starts, lasting.tolist(), strict=True):
            if lasts:
                onset = _onset(rises[band], start, half)
                pings[band].append(Ping(onset, t_ns + round(1e9 * onset / rate)))
                self._last_ns[band] = pings[band][-1].t_ns
            else:
                self.too_short[band] += 1
        return pings

    def _adapt(self, level: Array, duration: float) -> None:
        rank = int(_QUIET * level.shape[1])
        quiet = np.partition(level, rank, axis=1)[:, rank]
        share = min(1.0, duration / _FLOOR_TIME)
        self._floor = np.where(np.isnan(self._floor), quiet, self._floor + share * (quiet - self._floor))

    def _starts(self, level: Array, done: list[int], window: int, threshold: float) -> tuple[list[int], list[int]]:
        """Bands and first samples of the loud windows, in their order, at least a pulse length apart: the strongest
        are taken first. A maximum at the block's edge is a ping that is cut.
        """
        found = []
        for band, left in enumerate(level - self._floor[:, None]):
            left[: max(0, done[band])] = -math.inf
            while left.item(k := int(left.argmax())) > threshold:
                if 0 < k < left.size - 1 and level.item(band, k - 1) <= level.item(band, k):
                    found.append((band, k))
                left[max(0, k - window) : k + window] = -math.inf
        found.sort()
        return [band for band, _ in found], [k for _, k in found]

    def _quieter_half(self, sums: Array, bands: list[int], starts: list[int], window: int) -> Array:
        """Mean of the quieter half of each pulse's parts over the noise floor."""
        edges = _edges(window)
        at = sums[bands, np.array(starts) + edges[:, None]]
        means = np.sort((at[1:] - at[:-1]) / (edges[1:] - edges[:-1])[:, None], axis=0)
        half = len(means) // 2
        return np.asarray(means[:half].sum(axis=0) / half - self._floor[bands])


def log_energies(envelopes: Envelopes) -> AnyArray:
    """(B, m) logarithm of the energy of both channels together."""
    x = envelopes.values
    return np.asarray(np.log((x.real**2 + x.imag**2).sum(axis=1) + np.float32(_SILENCE)))


def _means(log_energy: AnyArray, window: int) -> tuple[Array, Array]:
    """(B, m + 1) running sums, and (B, m + 1 - window) means of the windows that start at each sample."""
    sums = np.zeros((log_energy.shape[0], log_energy.shape[1] + 1))
    log_energy.cumsum(axis=1, dtype=np.float64, out=sums[:, 1:])
    return sums, (sums[:, window:] - sums[:, :-window]) / window


@lru_cache(maxsize=16)
def _edges(window: int) -> NDArray[np.intp]:
    """Of the parts of a pulse."""
    count = min(_PARTS, window)
    return np.arange(count + 1) * window // count


def _rises(sums: Array, half: int) -> Array:
    """(B, m + 1 - 2 half) sum over the samples after one, less that before it; the first is that of sample `half`."""
    return np.asarray(sums[:, 2 * half :] - 2 * sums[:, half:-half] + sums[:, : -2 * half])


def _onset(rises: Array, start: int, half: int) -> int:
    """The steepest rise near the strongest window: echoes pull the window late, the rise is the direct path's."""
    first, last = max(half, start - half), min(rises.size - 1 + half, start + half // 2) + 1
    return first + int(rises[first - half : last - half].argmax()) if first < last else start
