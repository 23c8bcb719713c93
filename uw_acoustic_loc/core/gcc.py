"""Generalized cross-correlation of two hydrophones inside known bands (Knapp & Carter 1976).

One complex FFT of both channels serves every band: the in-band bins become a complex envelope at the band's own low
rate (no filter, so no group delay), a ping's piece of it is cross-correlated only at the lags that the array allows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from .types import AnyArray, Array

Complex = NDArray[np.complexfloating[Any, Any]]

WEIGHTINGS = ("cc", "phat", "scot", "roth", "ml")
OVERSAMPLING = 4  # lags per sample; at 40 kHz of 100 kHz, ten per carrier cycle
_EDGE = 4  # grid steps beyond the array's largest lag, where the maximum of a source at end-fire may lie
_SKIRT = 0.05  # of a band's width, by which its soft edges reach out and in
_SMOOTH = 5  # bins over which spectra are averaged before they become weights: a single bin has no coherence
_TINY = 1e-30  # power that stands for digital silence
_TAPER = 32  # samples at both ends of a block that are faded, against leakage from one band into another


@dataclass(frozen=True, eq=False)
class Envelopes:
    """Complex envelopes of B bands: `values` (B, 2, m) at `rate`, in the samples' unit."""

    values: Complex
    rate: float


class BandSplitter:
    """Splits blocks of up to `length` samples into bands with soft edges: hard ones make a click ring like a ping.

    `base` (B,) is the frequency that 0 Hz of an envelope stands for, `noise_width` (B,) the width of white noise in it.

    Raises:
        ValueError: a band that is empty or reaches beyond half the sample rate.
    """

    def __init__(self, sample_rate: float, band_low: Array, band_high: Array, length: int) -> None:
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
        skirt = _SKIRT * (high - low)
        first = np.maximum(np.ceil((low - skirt) / bin_width), 1).astype(int)
        last = np.minimum(np.floor((high + skirt) / bin_width), self.length // 2 - 1).astype(int)
        self._slices = [slice(a, b + 1) for a, b in zip(first, last, strict=True)]
        self._count = fft.next_fast_len(int((last - first).max()) + 1)
        self.rate = self._count * bin_width
        self.base = first * bin_width
        freq = self.base[:, None] + np.arange(self._count) * bin_width
        inside = np.minimum(freq - (low - skirt)[:, None], (high + skirt)[:, None] - freq) / (2 * skirt[:, None])
        self._shape = np.sin(0.5 * np.pi * np.clip(inside, 0.0, 1.0)) ** 2
        self.noise_width = np.square(self._shape).sum(axis=1) * bin_width
        self._shape = (self._shape * (self._count / self.length)).astype(np.float32)[:, None, :]
        self._fade = np.float32(0.5) - np.float32(0.5) * np.cos(np.pi * np.arange(_TAPER, dtype=np.float32) / _TAPER)

    def split(self, h0: AnyArray, h1: AnyArray) -> Envelopes:
        """Envelopes of samples (n,), n <= length."""
        z = np.zeros(self.length, np.complex64)
        n = h0.size
        z.real[:n], z.imag[:n] = h0, h1
        edge = min(_TAPER, n)
        z[:edge] *= self._fade[:edge]
        z[n - edge : n] *= self._fade[:edge][::-1]
        z = fft.fft(z, overwrite_x=True)
        bins = np.zeros((len(self._slices), 2, self._count), np.complex64)
        for row, s in zip(bins, self._slices, strict=True):
            mirrored = z[self.length - s.stop + 1 : self.length - s.start + 1][::-1].conj()
            row[0, : s.stop - s.start] = z[s] + mirrored
            row[1, : s.stop - s.start] = (z[s] - mirrored) * np.complex64(-1j)
        bins *= self._shape
        values = fft.ifft(bins, axis=-1, overwrite_x=True)
        return Envelopes(values[:, :, : n * self._count // self.length], self.rate)


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlation over the possible lags and its strongest local maxima, the strongest first."""

    lags: Array  # (L,) s, uniform
    values: AnyArray  # (L,) scaled so that the strongest maximum is 1
    tdoas: Array  # (P,) s
    heights: Array  # (P,) of the maxima, scaled alike
    curvature: float  # 1/s^2, minus the second derivative of `values` at the strongest maximum
    std: float  # s, of the strongest maximum, provided that it is the true one
    snr: float  # in-band signal to noise power over the segment


class Correlator:
    """Correlates segments of one band's envelopes, of up to `length` samples at `rate`."""

    def __init__(
        self,
        band: tuple[float, float],
        base: float,
        noise_width: float,
        rate: float,
        length: int,
        max_lag: float,
        lag_step: float,
    ) -> None:
        self._length = fft.next_fast_len(length)
        freq = base + np.arange(self._length) * (rate / self._length)
        first, last = np.searchsorted(freq, band)
        self._bins = slice(int(first), int(max(last, first + 1)))
        self._omega = 2 * np.pi * freq[self._bins]
        self._noise_scale = rate / noise_width  # of the noise in a bin, per envelope power and sample
        steps = int(np.ceil(max_lag / lag_step)) + _EDGE
        self.lags = np.asarray(np.arange(-steps, steps + 1) * lag_step, dtype=np.float64)
        self._step = lag_step
        phase = np.outer(self._omega, self.lags)
        self._table = np.concatenate([np.cos(phase), -np.sin(phase)]).astype(np.float32)

    def correlate(self, segment: Complex, noise_power: float, weighting: str, count: int) -> Correlation:
        """Correlation of a segment (2, m) in noise of a known power per envelope sample and channel."""
        g0, g1 = fft.fft(segment, self._length, axis=-1)[:, self._bins]
        weights = _weights(g0, g1, weighting)
        cross = (g0 * g1.conj()) * weights
        values = np.concatenate([cross.real, cross.imag]) @ self._table
        tdoas, heights = self._refined(cross, self._maxima(values, count))
        top = int(np.argmax(heights))
        turned = np.real(cross * np.exp(1j * tdoas[top] * self._omega))
        scale = max(float(turned.sum()), _TINY)
        curvature = max(float(turned @ self._omega**2), _TINY)
        noise = noise_power * self._noise_scale * segment.shape[1]
        std = self._std(turned, weights, noise, curvature) * float(np.sqrt(self._length / segment.shape[1]))
        snr = float(np.sum(turned / np.maximum(weights, _TINY))) / (self._omega.size * noise)
        order = np.argsort(-heights)
        relative = heights[order] / max(float(heights[top]), _TINY)
        return Correlation(self.lags, values / np.float32(scale), tdoas[order], relative, curvature / scale, std, snr)

    def _maxima(self, values: AnyArray, count: int) -> Array:
        """(P,) lags of the strongest local maxima, compared by their parabolas: the raw grid would favour some."""
        left, middle, right = values[:-2], values[1:-1], values[2:]
        (k,) = np.nonzero((middle >= left) & (middle > right))
        if k.size == 0:
            return np.array([self.lags[int(np.argmax(values))]])
        bend = 2 * middle[k] - left[k] - right[k]
        offset = (right[k] - left[k]) / (2 * bend)
        height = middle[k] + (right[k] - left[k]) ** 2 / (8 * bend)
        best = np.argsort(-height)[:count]
        return np.asarray(self.lags[k[best] + 1] + offset[best] * self._step, dtype=np.float64)

    def _refined(self, cross: Complex, tdoas: Array) -> tuple[Array, Array]:
        """Lags and heights after one Newton step on the exact sum; the parabola alone leaves tens of ns."""
        phase = np.outer(tdoas, self._omega).astype(np.float32)  # 100 rad at most: rounding is worth some ps
        cos, sin = np.cos(phase), np.sin(phase)
        real = cos * cross.real - sin * cross.imag
        slope = -((sin * cross.real + cos * cross.imag) @ self._omega)
        bend = np.maximum(real @ self._omega**2, _TINY)
        step = np.clip(slope / bend, -self._step / 2, self._step / 2)
        return tdoas + step, real.sum(axis=1) + step * (slope - 0.5 * bend * step)

    def _std(self, turned: Array, weights: AnyArray, noise: float, curvature: float) -> float:
        """First-order error of the maximum, all bins independent; for `cc` and a flat band the Cramer-Rao bound."""
        w2 = (weights * self._omega) ** 2
        power = np.sum(w2 * (noise * np.maximum(turned / np.maximum(weights, _TINY), 0.0) + noise**2 / 2))
        uniform = float(self.lags[-1]) / np.sqrt(3.0)
        return uniform if curvature <= _TINY else float(min(np.sqrt(power) / curvature, uniform))


def _weights(g0: Complex, g1: Complex, weighting: str) -> AnyArray:
    """(bins,) Knapp & Carter (1976), table 1, from spectra averaged over neighbouring bins."""
    if weighting == "cc":
        return np.ones(g0.size, np.float32)
    kernel = np.full(min(_SMOOTH, g0.size), 1.0 / _SMOOTH)
    cross = np.abs(np.convolve(g0 * g1.conj(), kernel, "same"))
    auto_0 = np.convolve(np.abs(g0) ** 2, kernel, "same")
    auto_1 = np.convolve(np.abs(g1) ** 2, kernel, "same")
    tiny = 1e-6 * float(np.sqrt(auto_0.mean() * auto_1.mean())) + _TINY  # digital silence has no spectrum
    if weighting == "phat":
        return np.asarray(1.0 / (cross + tiny))
    if weighting == "scot":
        return np.asarray(1.0 / (np.sqrt(auto_0 * auto_1) + tiny))
    if weighting == "roth":
        return np.asarray(1.0 / (auto_0 + tiny))
    if weighting == "ml":
        coherence = np.minimum(cross**2 / (auto_0 * auto_1 + tiny**2), 0.999)
        return np.asarray(coherence / ((cross + tiny) * (1.0 - coherence)))
    raise ValueError(f"weighting must be one of {', '.join(WEIGHTINGS)}, got {weighting!r}")
