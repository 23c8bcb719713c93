"""The onsets of pings: energy of the band, or of a tone in it, over what noise alone reaches."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import fft
from scipy.ndimage import maximum_filter1d

from ..types import AnyArray, Array
from .false_alarm import MEAN_LOG, bin_threshold, log_mean_threshold, tail
from .gcc import Envelopes

DB = 10.0 / math.log(10.0)  # dB per unit of the logarithm of a power
_SHORTEST = 1.2e-3  # s, of the windows that are tried besides the pulse length, each half as long as the one before
_QUIET, _QUIETER = (
    0.3,
    0.05,
)  # quantiles of the level that are taken as noise: pings and echoes may fill most of a block
_QUANTILES = 1.12  # standard deviations between them
_MODULATED = 6.0  # standard deviations of the noise's own level that a ping stands out of
_BLOCKS = 20  # of whose spreads the median is taken
_HEADROOM = 6.0  # dB
_LEAKAGE = 0.04  # of the energy of an abrupt edge, at the most, that another band gets
_EDGE = 0.5e-3  # s within which an edge is abrupt
_PARTS = 8  # of a window, of which the quieter half must be loud too
_LASTING = 0.6  # of the window's own level, that the quieter half must reach
_HALF_NORMAL = 0.8  # standard deviations by which the lower half of a normal distribution lies below its mean
_CONCENTRATED = 0.75  # of a tone's energy in a quarter of its window: a burst that is too short
_FLOOR_TIME = 2.0  # s over which the noise floor adapts
_FEWEST = 8  # samples of a window in which tones are looked for
_BACK, _QUIETLY = 3, 2.0  # pulse lengths that an onset is looked for before a window, and level over the floor
_REACH = 0.5e-3  # s, by which the beginning in the band may be off
_CLEAR = 4.0  # times the energy before, that a beginning needs to be seen in a wider band
_LEAK, _SPLATTER = 10.0, 2e-3  # times the power in the band, and s in which it is compared with that beside
_BEFORE = (6e-3, 1e-3)  # s before a ping, from which its noise is taken
_SILENCE = 1e-30  # power that stands for digital silence
_VAR_LOG = 0.6449  # of a log energy: trigamma(2)
_QUIET_BIN = 1.0973  # the 30 % quantile of the energy of both channels in noise of power 1 each: gamma, shape 2
Due = tuple[
    float, float, float
]  # a ping is expected: first and last s after the block's begin, how rare such times are


class Onset(NamedTuple):
    """The beginning of something loud in a block of envelopes."""

    start: int  # first envelope sample
    t_ns: int
    length: float  # s of the window in which it stands out most
    level: float  # mean log energy of both channels over these
    noise: float  # Pa^2/Hz of one channel just before


class Window(NamedTuple):
    """One of the windows that slide over a band's energy."""

    size: int  # samples
    excess: float  # by which the mean log energy of noise may rise
    power: float  # of the noise in a bin that a tone's must surpass; 0 = no tones


class Block(NamedTuple):
    """A band's part of a block of envelopes."""

    t_ns: int
    rate: float
    width: float  # Hz, of white noise
    envelopes: Envelopes
    band: int
    energy: AnyArray  # (m,) of both channels
    level: AnyArray  # (m,) its logarithm, at most somewhat more than the highest threshold
    floor: float  # mean level of noise

    def noise(self, start: int) -> float:
        """Pa^2/Hz of one channel before a sample: echoes of an earlier ping, and of others, are noise too."""
        first, last = (max(0, start - round(t * self.rate)) for t in _BEFORE)
        power = self.energy[first:last].mean() / 2.0 if last > first else 0.0
        return max(float(power), math.exp(self.floor - MEAN_LOG)) / self.width


class PingDetector:
    """Windows of a pulse length, and of halves of it, over the noise floor of each band (Choi et al. 2016, eq. 1).

    The logarithm is taken before the mean and no sample counts for more than the threshold and some headroom, so that
    a loud echo does not hide the direct path before it. A ping lasts: in a click's window the quieter half is noise.
    Noise alone passes `alarm_rate` times per second and band; with a threshold in dB, the pulse length alone counts.
    """

    def __init__(self, pulse_length: float, bands: int, alarm_rate: float, max_lag: float = 0.0) -> None:
        self._pulse, self._alarms, self._max_lag = pulse_length, alarm_rate, max_lag
        self._floor = np.zeros(bands)  # mean log energy of noise
        self._before = np.zeros(bands)  # of the block before
        self._spread = np.zeros(bands)  # variance of the level beyond that of steady noise
        self._spreads: deque[Array] = deque(maxlen=_BLOCKS)
        self._bins: list[dict[int, Array]] = [{} for _ in range(bands)]  # per window size: noise power of each bin
        self._last_ns = [0] * bands
        self.too_short = [0] * bands  # loud enough, but no ping
        for band in range(bands):
            self.forget(band)

    def forget(self, band: int) -> None:
        """Begins anew."""
        self._floor[band] = self._before[band] = math.nan
        self._spread[band], self._bins[band] = 0.0, {}
        for spread in self._spreads:
            spread[band] = 0.0
        self._last_ns[band], self.too_short[band] = -(1 << 62), 0

    def noise_power(self, band: int) -> float:
        """Of an envelope sample of one channel; NaN before the first block."""
        return math.exp(self._floor.item(band) - MEAN_LOG)

    def detect(
        self, envelopes: Envelopes, t_ns: int, threshold_db: float, due: Sequence[Sequence[Due]]
    ) -> list[list[Onset]]:
        """Per band the onsets whose pulse lies wholly in the block (B, 2, m), in time order.

        Where a ping is `due`, a lower threshold does for the same rate of false alarms.
        """
        energy, rate = energies(envelopes), envelopes.rate
        longest = max(4, round(self._pulse * rate))
        if energy.shape[1] < 2 * longest:
            return [[] for _ in self._last_ns]
        level = np.log(energy + np.float32(_SILENCE))
        risen = self._adapt(_means(level, longest)[:, :: max(1, longest // 8)], longest, envelopes)
        if len(energy) > 1:
            envelopes, energy = self._without_leakage(envelopes, energy)
            level = np.log(energy + np.float32(_SILENCE))
        found = []
        for band, width in enumerate(envelopes.noise_width.tolist()):
            floor, windows = risen.item(band), _windows(longest, rate, width, self._alarms, threshold_db)
            cap = floor + max(w.excess for w in windows) + _HEADROOM / DB
            capped = np.minimum(level[band], np.float32(cap))
            block = Block(t_ns, rate, width, envelopes, band, energy[band], capped, floor)
            found.append(list(self._onsets(block, threshold_db, due[band])))
        return found

    def _without_leakage(self, envelopes: Envelopes, energy: AnyArray) -> tuple[Envelopes, AnyArray]:
        """What the abrupt edges of a louder ping in another band leave in a band, taken down to the noise floor."""
        amplitude, reach = np.sqrt(energy), max(1, round(_EDGE * envelopes.rate))
        step = np.zeros_like(energy)
        step[:, reach:-reach] = np.square(amplitude[:, 2 * reach :] - amplitude[:, : -2 * reach])
        step = maximum_filter1d(step, 4 * reach + 1, axis=1)
        others = np.stack([np.delete(step, band, axis=0).max(axis=0) for band in range(len(energy))])
        floor = np.exp(self._floor)[:, None]
        leaked = (energy < _LEAKAGE * others) & (energy > floor)
        share = np.where(leaked, floor / np.maximum(energy, _SILENCE), 1.0).astype(energy.dtype)
        values = envelopes.values * np.sqrt(share)[:, None, :]
        return replace(envelopes, values=values), energy * share

    def _adapt(self, level: Array, window: int, envelopes: Envelopes) -> Array:
        """The noise floor is followed slowly, but no slower than two blocks that are louder throughout."""
        ranks = [int(_QUIETER * level.shape[1]), int(_QUIET * level.shape[1])]
        quieter, quiet = np.partition(level, ranks, axis=1)[:, ranks].T
        share = min(1.0, envelopes.values.shape[2] / envelopes.rate / _FLOOR_TIME)
        steady = 1.3 * _VAR_LOG * envelopes.rate / (window * envelopes.noise_width)
        spread = np.square((quiet - quieter) / _QUANTILES) - steady  # of single blocks also negative
        self._spreads.append(spread)
        self._spread = np.median(self._spreads, axis=0)  # the echoes of a ping now and then are no modulation
        new = np.isnan(self._floor)
        self._floor = np.where(new, quiet, self._floor + share * (quiet - self._floor))
        risen = np.where(new, quiet, np.maximum(self._floor, np.minimum(self._before, quiet)))
        self._before = quiet
        return np.asarray(risen)

    def _onsets(self, block: Block, threshold_db: float, due: Sequence[Due]) -> Iterator[Onset]:
        """The strongest windows, at least a pulse length apart; a maximum at the block's edge is a ping that is cut."""
        band, longest = block.band, max(4, round(self._pulse * block.rate))
        excess, sizes = self._excess(block, longest, threshold_db, due)
        done = math.ceil(((self._last_ns[band] - block.t_ns) * 1e-9 + self._pulse) * block.rate)
        excess[: max(0, done)] = -math.inf
        starts = []
        while excess.item(k := int(excess.argmax())) > 0.0:
            if 0 < k < excess.size - 1 and excess.item(k - 1) <= excess.item(k):
                starts.append(k)
            excess[max(0, k - longest) : k + longest] = -math.inf
        for k in sorted(starts):
            size = int(sizes.item(k))
            if not _lasts(block, k, abs(size), size < 0):
                self.too_short[band] += 1
                continue
            onset = self._onset(block, k, abs(size), longest)
            cut = onset.start > block.level.size - longest - self._max_lag * block.rate  # the next block has it whole
            if not cut and onset.t_ns - self._last_ns[band] > 0.5e9 * self._pulse:
                self._last_ns[band] = onset.t_ns
                yield onset

    def _excess(self, block: Block, longest: int, threshold_db: float, due: Sequence[Due]) -> tuple[Array, Array]:
        """(m,) by how much the best window from each sample on passes its threshold, and its size, < 0 for a tone's."""
        count = block.level.size - longest + 1
        excess, sizes = np.full(count, -math.inf), np.full(count, longest)
        windows = _windows(longest, block.rate, block.width, self._alarms, threshold_db)
        gates = [
            (
                *_samples(d, block.rate, longest),
                _windows(longest, block.rate, block.width, self._alarms * d[2], threshold_db),
            )
            for d in due
        ]
        modulated = _MODULATED**2 * max(self._spread.item(block.band), 0.0)
        for k, window in enumerate(windows):
            over = _means(block.level, window.size)[:count] - block.floor
            limit = np.full(count, math.sqrt(window.excess**2 + modulated))
            for first, last, eased in gates:
                limit[first:last] = math.sqrt(eased[k].excess ** 2 + modulated)
            _take_larger(excess, sizes, over - limit, window.size, 1)
            if window.power:
                hop = max(1, window.size // 4)
                powers = self._tones(block, window.size, hop)[: (count + hop - 1) // hop]
                limit = np.full(count, window.power)
                for first, last, eased in gates:
                    limit[first:last] = eased[k].power
                limit = limit[::hop] * math.exp(math.sqrt(modulated))
                _take_larger(
                    excess, sizes, np.minimum(np.log(powers / limit[: powers.size]), _HEADROOM / DB), -window.size, hop
                )
        return excess, sizes

    def _tones(self, block: Block, size: int, hop: int) -> Array:
        """(n,) power of the strongest bin of the windows that begin every `hop` samples, over the noise in that bin."""
        x = sliding_window_view(block.envelopes.values[block.band], size, axis=1)[:, ::hop]
        spectra = fft.fft(x, 2 * size, axis=2)
        freq = block.envelopes.base.item(block.band) + np.arange(2 * size) * (block.rate / (2 * size))
        low, high = block.envelopes.bands[block.band]
        inside = spectra[:, :, (freq >= low) & (freq <= high)]
        power = (inside.real**2 + inside.imag**2).sum(axis=0)
        quiet = np.partition(power, rank := int(_QUIET * len(power)), axis=0)[rank] / _QUIET_BIN
        noise = self._bins[block.band].get(size)
        share = min(1.0, block.level.size / block.rate / _FLOOR_TIME)
        noise = np.full(quiet.size, np.median(quiet)) if noise is None else noise + share * (quiet - noise)
        self._bins[block.band][size] = noise
        usual = np.maximum(noise, np.median(noise)) * math.exp(max(block.floor - self._floor.item(block.band), 0.0))
        return np.asarray((power / usual).max(axis=1), dtype=np.float64)

    def _onset(self, block: Block, start: int, size: int, longest: int) -> Onset:
        """Where the energy changes most, near a window that echoes pull late: the change is the direct path's."""
        first = start
        for _ in range(_BACK):  # to where it was quiet
            first = max(0, first - longest)
            if block.level[first : first + 3].mean() < block.floor + _QUIETLY:
                break
        last = min(block.energy.size, start + size)
        noise = max(math.exp(block.floor), float(block.energy[first : first + 3].mean()))
        onset = first + change_point(block.energy[first:last], noise, longest)
        level = math.log(float(block.energy[onset : onset + size].mean()) + _SILENCE)
        return Onset(onset, block.t_ns + round(1e9 * onset / block.rate), size / block.rate, level, block.noise(onset))

    def refined(self, onset: Onset, band: int, wide: Envelopes, t_ns: int) -> Onset:
        """With its beginning in envelopes of a wider band, and in time as these resolve it.

        The noise there is that of the time before; a ping that does not stand out in the wider band stays where it was.
        """
        x, rate = wide.values[0], wide.rate
        middle = round((onset.t_ns - t_ns) * 1e-9 * rate)
        reach = max(2, round(_REACH * rate))
        first, last = max(0, middle - 2 * reach), min(x.shape[1], middle + 2 * reach)
        energy = (x.real[:, first:last] ** 2 + x.imag[:, first:last] ** 2).sum(axis=0)
        before = float(energy[: max(1, reach // 2)].mean())
        start = first + change_point(energy, before, reach)
        after = float(energy[start - first : start - first + reach].mean())
        if after < _CLEAR * before:
            start = middle
        return onset._replace(start=start, t_ns=t_ns + round(1e9 * start / rate))


def leaks(onset: Onset, wide: Envelopes) -> bool:
    """Whether a refined onset is the edge of a loud ping in another band: what came with it lies mostly beside its own.

    Sound that was there before does not count.
    """
    x, size = wide.values[0], round(max(onset.length, _SPLATTER) * wide.rate)
    now, before = x[:, onset.start : onset.start + size], x[:, max(0, onset.start - size) : onset.start]
    freq = wide.base[0] + np.arange(size) * (wide.rate / size)
    inside = (freq >= wide.bands[0, 0]) & (freq <= wide.bands[0, 1])
    risen = _powers(now, size) - 2.0 * _powers(before, size)
    return bool(risen[~inside].max(initial=0.0) > _LEAK * risen[inside].max(initial=0.0))


def _powers(x: AnyArray, size: int) -> AnyArray:
    """(size,) power of both channels' samples (2, n), n <= size, by frequency."""
    spectra = fft.fft(x * np.hanning(x.shape[1]), size, axis=1)
    return np.asarray((spectra.real**2 + spectra.imag**2).sum(axis=0))


@lru_cache(maxsize=256)
def _windows(longest: int, rate: float, width: float, alarms: float, threshold_db: float) -> tuple[Window, ...]:
    if threshold_db > 0:
        return (Window(longest, threshold_db / DB, 0.0),)
    sizes = [longest]
    while sizes[-1] // 2 >= max(4, _SHORTEST * rate):
        sizes.append(sizes[-1] // 2)
    tests, found = sum(2 if size >= _FEWEST else 1 for size in sizes), []
    for size in sizes:
        seconds = size / rate
        excess = log_mean_threshold(max(seconds * width, 1.0), tail(alarms, seconds, tests))
        power = bin_threshold(tail(alarms, seconds, tests * (seconds * width + 1.0) / 4.0)) if size >= _FEWEST else 0.0
        found.append(Window(size, excess, power))
    return tuple(found)


def change_point(energy: AnyArray, noise: float, count: int) -> int:
    """Sample from which on the energies (n,) are of another level: the maximum of the likelihood (Maeda 1985).

    As if `count` samples of noise had come before.
    """
    before = energy.cumsum(dtype=np.float64)
    n = energy.size
    k = np.arange(n)
    quiet = (np.concatenate([[0.0], before[:-1]]) + count * noise) / (k + count)
    loud = (before[-1] - before + energy) / (n - k)
    cost = (k + count) * np.log(quiet + _SILENCE) + (n - k) * np.log(loud + _SILENCE)
    return int(cost.argmin())


def energies(envelopes: Envelopes) -> AnyArray:
    """(B, m) energy of both channels together."""
    x = envelopes.values
    return np.asarray((x.real**2 + x.imag**2).sum(axis=1))


def _samples(due: Due, rate: float, longest: int) -> tuple[int, int]:
    return max(0, math.floor(due[0] * rate) - longest // 2), max(0, math.ceil(due[1] * rate))


def _take_larger(excess: Array, sizes: Array, other: Array, size: int, hop: int) -> None:
    mine = excess[::hop][: other.size]
    larger = other > mine
    sizes[::hop][: other.size][larger] = size
    np.maximum(mine, other, out=mine)


def _lasts(block: Block, start: int, size: int, tone: bool) -> bool:
    """Whether the energy of a window is spread over its parts: the quieter half, as noise goes, is loud too."""
    energy = np.sort(block.energy[start : start + size])
    if energy[-max(1, size // 4) :].sum() > _CONCENTRATED * energy.sum():
        return False
    if tone:
        return True
    count = min(_PARTS, size)
    edges = np.arange(count + 1) * size // count + start
    quieter = np.sort(np.add.reduceat(block.level[: start + size], edges[:-1]) / np.diff(edges))[: count // 2].mean()
    mean = block.level[start : start + size].mean()
    by_noise = _HALF_NORMAL * math.sqrt(_VAR_LOG * count * block.rate / (size * block.width))
    return bool(quieter - block.floor > _LASTING * (mean - block.floor) - by_noise)


def _means(level: AnyArray, window: int) -> Array:
    """(..., m + 1 - window) means of the windows that start at each sample."""
    sums = np.zeros((*level.shape[:-1], level.shape[-1] + 1))
    level.cumsum(axis=-1, dtype=np.float64, out=sums[..., 1:])
    return np.asarray((sums[..., window:] - sums[..., :-window]) / window)
