"""Generalized cross-correlation of two hydrophones inside known bands (Knapp & Carter 1976).

One complex FFT of both channels serves every band: the in-band bins become a complex envelope at the band's own low
rate (no filter, so no group delay), a ping's piece of it is cross-correlated only at the lags that the array allows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from ..types import AnyArray, Array
from .config import ALIKE, Electronics
from .weighting import SILENCE, bin_weights

Complex = NDArray[np.complexfloating[Any, Any]]

_LAGS_PER_CYCLE = 10  # of the highest frequency in any band
_SKIRT = 0.05  # of a band's width, by which its soft edges reach out and in
_BLOCK = 0.08  # cycles that bins summed before the correlation may turn at the largest lag
_TABLE = 500_000  # elements of a table of lags; larger ones take longer than an inverse transform
_TAPER = 32  # samples at both ends of a block that are faded, against leakage from one band into another


@dataclass(frozen=True, eq=False)
class Envelopes:
    """Complex envelopes of B bands: `values` (B, 2, m) at `rate`, in the samples' unit."""

    values: Complex
    rate: float
    base: Array  # (B,) Hz, that 0 Hz of an envelope stands for
    bands: Array  # (B, 2) Hz
    noise_width: Array  # (B,) Hz, of white noise in an envelope


class BandSplitter:
    """Splits blocks of up to `length` samples into bands with soft edges: hard ones make a click ring like a ping.

    `bands` (B, 2) are their edges, `base` (B,) is the frequency that 0 Hz of an envelope stands for, `noise_width` (B,)
    the width of white noise in it. What the `electronics` do to the channels is taken back.

    With a `margin` in Hz the soft edges lie outside the bands and are so wide, which resolves time better.

    Raises:
        ValueError: a band that is empty or reaches beyond half the sample rate.
    """

    def __init__(
        self,
        sample_rate: float,
        band_low: Array,
        band_high: Array,
        length: int,
        margin: float = 0.0,
        electronics: Electronics = ALIKE,
    ) -> None:
        for low, high in zip(band_low, band_high, strict=True):
            if not 0 < low < high < sample_rate / 2:
                raise ValueError(f"band must be 0 < low < high < {sample_rate / 2:g} Hz, got {low:g} to {high:g} Hz")
        self.length = fft.next_fast_len(length)
        bin_width = sample_rate / self.length
        low, high = np.asarray(band_low, dtype=np.float64), np.asarray(band_high, dtype=np.float64)
        if np.any(high - low < 2 * bin_width):
            raise ValueError(
                f"band must be at least {2 * bin_width:g} Hz wide for this block, got {(high - low).min():g}"
            )
        skirt = np.full(low.size, margin / 2) if margin else _SKIRT * (high - low)
        self.bands = np.stack([low, high], axis=1)
        low, high = (low - skirt, high + skirt) if margin else (low, high)
        first = np.maximum(np.ceil((low - skirt) / bin_width), 1).astype(int)
        last = np.minimum(np.floor((high + skirt) / bin_width), self.length // 2 - 1).astype(int)
        self._count = fft.next_fast_len(int((last - first).max()) + 1)
        self.rate = self._count * bin_width
        self.base = first * bin_width
        freq = self.base[:, None] + np.arange(self._count) * bin_width
        inside = np.minimum(freq - (low - skirt)[:, None], (high + skirt)[:, None] - freq) / (2 * skirt[:, None])
        self._shape = np.sin(0.5 * np.pi * np.clip(inside, 0.0, 1.0)) ** 2
        self.noise_width = np.square(self._shape).sum(axis=1) * bin_width
        within = np.arange(self._count) <= (last - first)[:, None]
        bins = np.where(within, first[:, None] + np.arange(self._count), 0)
        self._bins = np.stack([bins, -bins % self.length], axis=1)
        scale = self._shape * within * (self._count / self.length)
        h0, h1 = electronics.signs
        early = np.exp(2j * np.pi * freq * electronics.delay_offset)
        self._shape = np.stack([scale * h0 * early, -1j * scale * h1], axis=1).astype(np.complex64)
        self._fade = np.float32(0.5) - np.float32(0.5) * np.cos(np.pi * np.arange(_TAPER, dtype=np.float32) / _TAPER)

    def spectrum(self, h0: AnyArray, h1: AnyArray) -> Complex:
        """Of samples (n,), n <= length, as real and imaginary part of one signal."""
        z, n = np.empty(self.length, np.complex64), h0.size
        z.real[:n], z.imag[:n], z[n:] = h0, h1, 0.0
        edge = min(_TAPER, n)
        z[:edge] *= self._fade[:edge]
        z[n - edge : n] *= self._fade[:edge][::-1]
        return np.asarray(fft.fft(z, overwrite_x=True))

    def envelopes(self, spectrum: Complex, n: int, bands: slice = slice(None)) -> Envelopes:
        """Of some of the bands, from the spectrum of n samples."""
        both = spectrum.take(self._bins[bands])
        bins, mirrored = both[:, 0], both[:, 1].conj()
        np.subtract(bins, mirrored, out=both[:, 1])
        bins += mirrored
        both *= self._shape[bands]
        values = fft.ifft(both, axis=-1, overwrite_x=True)[:, :, : n * self._count // self.length]
        return Envelopes(values, self.rate, self.base[bands], self.bands[bands], self.noise_width[bands])

    def split(self, h0: AnyArray, h1: AnyArray) -> Envelopes:
        """Envelopes of samples (n,), n <= length."""
        return self.envelopes(self.spectrum(h0, h1), h0.size)


class Correlation(NamedTuple):
    """Correlation over the possible lags and its strongest local maxima, the strongest first."""

    lags: Array  # (L,) s, uniform
    values: AnyArray  # (L,) not scaled
    tdoas: Array  # (P,) s
    heights: Array  # (P,) of the maxima; the strongest is 1
    curvature: float  # 1/s^2, minus the second derivative at the strongest maximum of height 1
    std: float  # s, of the strongest maximum, provided that it is the true one
    snr: float  # in-band signal to noise power over the segment


class Piece(NamedTuple):
    """What a ping left in the envelopes of its band."""

    band: int
    samples: Complex  # (2, m)
    noise_density: float  # Pa^2 / Hz in the envelope of one channel


class Correlator:
    """Correlates pieces of up to `length` samples of a splitter's envelopes; those of one block all at once."""

    def __init__(self, splitter: BandSplitter, length: int, max_lag: float) -> None:
        self._length = fft.next_fast_len(length)
        freq = splitter.base[:, None] + np.arange(self._length) * (splitter.rate / self._length)
        bin_width = splitter.rate / self._length
        first = np.array([np.searchsorted(f, band[0]) for f, band in zip(freq, splitter.bands, strict=True)])
        last = first + np.maximum(np.rint(np.diff(splitter.bands)[:, 0] / bin_width).astype(int), 1)
        self._bins = slice(int(first.min()), int(last.max()))
        k = np.arange(self._length)[self._bins]
        inside = (k >= first[:, None]) & (k < last[:, None])
        self._inside = inside.astype(np.float32)
        self._alike = bool(inside.all())
        self._omega = np.asarray(2 * np.pi * freq[:, self._bins], dtype=np.float32)
        self._omega_2 = np.square(self._omega, dtype=np.float64) * self._inside
        self._rate = splitter.rate
        self._count, self._white = self._inside.sum(axis=1).tolist(), self._omega_2.sum(axis=1).tolist()
        step = 1.0 / (_LAGS_PER_CYCLE * float(splitter.bands.max()))
        block = max(int(_BLOCK * self._length / (splitter.rate * max_lag)), 1)
        self._blocks = np.arange(0, self._omega.shape[1], block)
        self._fine = 0  # bins of the inverse transform that takes the place of tables, for wide arrays
        if 2.0 * max_lag / step * self._blocks.size > _TABLE:
            self._fine = fft.next_fast_len(math.ceil(1.0 / (bin_width * step)))
            step = 1.0 / (bin_width * self._fine)
        steps = math.ceil(max_lag / step)
        self._max_lag, self._step = max_lag, step if self._fine else max_lag / steps
        self.lags = np.asarray(np.arange(-steps - 1, steps + 2) * self._step, dtype=np.float64)
        self._tables = self._carriers() if self._fine else self._lag_tables(block)
        self._moments = self._moment_tables()
        self._largest_std = float(self.lags[-1]) / math.sqrt(3.0)

    def _lag_tables(self, block: int) -> AnyArray:
        """(B, 2 blocks, L) that turn the blocks' sums, real and imaginary parts in turn, into a correlation.

        The bins of a block turn against each other by the true lag, which lowers all maxima alike.
        """
        last = np.minimum(self._blocks + block, self._omega.shape[1]) - 1
        middle = 0.5 * (self._omega[:, self._blocks] + self._omega[:, last]).astype(np.float64)
        phase = middle[:, :, None] * self.lags
        table = np.stack([np.cos(phase), -np.sin(phase)], axis=2)
        return np.asarray(table.reshape(len(phase), -1, self.lags.size), dtype=np.float32)

    def _carriers(self) -> AnyArray:
        """(B, L) phasors of each band's first bin over the lags."""
        return np.asarray(np.exp(1j * self._omega[:, :1].astype(np.float64) * self.lags), np.complex64)

    def _values(self, bands: list[int], weighted: Complex) -> AnyArray:
        """(n, L) correlations of weighted cross-spectra (n, bins) over the lags."""
        values = np.empty((len(bands), self.lags.size), np.float32)
        if self._fine:
            half = self.lags.size // 2
            at = np.arange(-half, half + 1)
            for band, row, out in zip(bands, weighted, values, strict=True):
                out[:] = (fft.ifft(row, self._fine, norm="forward")[at] * self._tables[band]).real
            return values
        sums = np.add.reduceat(weighted, self._blocks, axis=1).view(np.float32)
        for band, row, out in zip(bands, sums, values, strict=True):
            np.dot(row, self._tables[band], out=out)
        return values

    def _moment_tables(self) -> AnyArray:
        """(B, 3, 2 bins) that turn a spectrum into its correlation at lag 0, slope and minus the bend there."""
        none, omega = np.zeros(self._omega.shape), self._omega * self._inside
        real = np.stack([self._inside, none, self._omega_2], axis=1)
        imag = np.stack([none, -omega, none], axis=1)
        return np.stack([real, imag], axis=-1).reshape(len(omega), 3, -1).astype(np.float32)

    def correlate(self, pieces: Sequence[Piece], weighting: str, count: int) -> list[Correlation]:
        """With up to `count` maxima each."""
        g: Complex = np.zeros((len(pieces), 2, self._length), np.complex64)
        for row, piece in zip(g, pieces, strict=True):
            row[:, : piece.samples.shape[1]] = piece.samples
        g = fft.fft(g, overwrite_x=True)[:, :, self._bins]
        cross: Complex = g[:, 0] * g[:, 1].conj()
        weights = None if weighting == "cc" else np.stack([bin_weights(h0, h1, weighting) for h0, h1 in g])
        weighted = cross if weights is None else np.asarray(cross * weights, dtype=np.complex64)
        bands = [piece.band for piece in pieces]
        if not self._alike:
            weighted = weighted * self._inside.take(bands, axis=0)
        values = self._values(bands, weighted)
        maxima = self._maxima(values, count)
        strongest = np.array([found[0, 0] for found in maxima], np.float32)
        back = _phasors(self._omega.take(bands, axis=0) * strongest[:, None])
        turned = weighted * back
        moments = (self._moments.take(bands, axis=0) @ turned.view(np.float32)[:, :, None])[:, :, 0].tolist()
        powers = [None] * len(pieces) if weights is None else self._powers(bands, cross * back, weights)
        parts = zip(pieces, values, maxima, moments, powers, strict=True)
        return [self._refined(*part) for part in parts]

    def _powers(self, bands: list[int], aligned: Complex, weights: AnyArray) -> list[list[float]]:
        """Per piece what `_refined` needs when bins are weighted: signal and noise in the slope, signal in the band."""
        inside, omega_2 = self._inside.take(bands, axis=0), self._omega_2.take(bands, axis=0)
        white = weights**2 * omega_2
        parts = (aligned.real * white, white, aligned.real * inside)
        found: list[list[float]] = np.stack([part.sum(axis=1, dtype=np.float64) for part in parts], axis=1).tolist()
        return found

    def _maxima(self, values: AnyArray, count: int) -> list[Array]:
        """Per row (2, P): lags and heights of the strongest maxima over the possible lags, the strongest first.

        The largest lag itself is one if the correlation still rises there: a maximum beyond it is no source's, and with
        elements half a wavelength apart the next carrier cycle would win. Parabolas are compared: the raw grid would
        favour some maxima. They leave tens of ns, a tenth of what echoes do.
        """
        rise = np.diff(values)
        falls = rise < 0
        falls[:, 0], falls[:, -1] = False, True
        row, before = (falls[:, 1:] > falls[:, :-1]).nonzero()
        up, down = rise[row, before], rise[row, before + 1]
        slope, bend = up + down, up - down
        offset = np.where((up >= 0) & (down <= 0) & (bend > 0), slope / np.where(bend > 0, bend, 1), 0.0)
        both = np.empty((2, row.size))
        both[0] = self._limited(self.lags.take(before + 1) + (0.5 * self._step) * offset)
        both[1] = values[row, before + 1] + 0.125 * slope * offset
        ends = row.searchsorted(np.arange(len(values) + 1)).tolist()
        return [both.take(both[1, a:b].argsort()[: -count - 1 : -1] + a, axis=1) for a, b in pairwise(ends)]

    def _limited(self, lags: Array) -> Array:
        return np.minimum(np.maximum(lags, -self._max_lag), self._max_lag)

    def _refined(
        self,
        piece: Piece,
        values: AnyArray,
        maxima: Array,
        moments: list[float],
        powers: list[float] | None,
    ) -> Correlation:
        """The strongest maximum by a Newton step, its standard deviation, and the signal to noise ratio."""
        (tdoas, heights), (height, slope, curvature) = maxima, moments
        height, curvature = max(height, SILENCE), max(curvature, SILENCE)
        tdoas[0] = self._limited(tdoas[0] + min(max(slope / curvature, -self._step), self._step))
        signal, white, level = powers or (curvature, self._white[piece.band], height)
        m = piece.samples.shape[1]
        noise = piece.noise_density * self._rate * m
        alike = min(self._length / m, self._count[piece.band])  # neighbouring bins that say the same
        std = self._std(noise, max(signal, 0.0), white, curvature) * math.sqrt(alike)
        snr = level / (self._count[piece.band] * noise)
        return Correlation(self.lags, values, tdoas, heights / max(heights[0], SILENCE), curvature / height, std, snr)

    def _std(self, noise: float, signal: float, white: float, curvature: float) -> float:
        """First-order error of the maximum, all bins independent; for `cc` and a flat band the Cramer-Rao bound."""
        if curvature <= SILENCE:
            return self._largest_std
        return min(math.sqrt(noise * signal + 0.5 * noise**2 * white) / curvature, self._largest_std)


def _phasors(phase: AnyArray) -> Complex:
    """exp(1j phase) of float32 phases, which costs some ps of lag."""
    found = np.empty(phase.shape, np.complex64)
    np.cos(phase, out=found.real)
    np.sin(phase, out=found.imag)
    return found
