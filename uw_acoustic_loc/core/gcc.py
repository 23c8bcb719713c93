"""Generalized cross-correlation of two hydrophones inside known bands (Knapp & Carter 1976).

One complex FFT of both channels serves every band: the in-band bins become a complex envelope at the band's own low
rate (no filter, so no group delay), a ping's piece of it is cross-correlated only at the lags that the array allows.
"""

from __future__ import annotations

import math
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
        self._count = fft.next_fast_len(int((last - first).max()) + 1)
        self.rate = self._count * bin_width
        self.base = first * bin_width
        freq = self.base[:, None] + np.arange(self._count) * bin_width
        inside = np.minimum(freq - (low - skirt)[:, None], (high + skirt)[:, None] - freq) / (2 * skirt[:, None])
        self._shape = np.sin(0.5 * np.pi * np.clip(inside, 0.0, 1.0)) ** 2
        self.noise_width = np.square(self._shape).sum(axis=1) * bin_width
        within = np.arange(self._count) <= (last - first)[:, None]
        self._bins = np.where(within, first[:, None] + np.arange(self._count), 0)
        self._mirrored = -self._bins % self.length
        scale = self._shape * within * (self._count / self.length)
        self._shape = np.stack([scale, -1j * scale], axis=1).astype(np.complex64)
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
        bins, mirrored = z.take(self._bins), z.take(self._mirrored).conj()
        both = np.empty(self._shape.shape, np.complex64)
        np.add(bins, mirrored, out=both[:, 0])
        np.subtract(bins, mirrored, out=both[:, 1])
        both *= self._shape
        values = fft.ifft(both, axis=-1, overwrite_x=True)
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
        self._table = np.stack([np.cos(phase), -np.sin(phase)], axis=1).reshape(-1, self.lags.size).astype(np.float32)
        self._omega_2, self._j_omega = self._omega**2, 1j * self._omega
        none, one = np.zeros(self._omega.size), np.ones(self._omega.size)
        real, imag = np.stack([one, none, self._omega_2]), np.stack([none, -self._omega, none])
        self._moments = np.stack([real, imag], axis=-1).reshape(3, -1)  # sum, slope and bend of a turned spectrum
        self._white = float(self._omega_2.sum())
        self._largest_std = float(self.lags[-1]) / math.sqrt(3.0)

    def correlate(self, segment: Complex, noise_power: float, weighting: str, count: int) -> Correlation:
        """Correlation of a segment (2, m) in noise of a known power per envelope sample and channel."""
        padded = np.zeros((2, self._length), np.complex64)
        padded[:, : segment.shape[1]] = segment
        g0, g1 = fft.fft(padded, overwrite_x=True)[:, self._bins]
        cross = g0 * g1.conj()
        weights = None if weighting == "cc" else _weights(g0, g1, weighting)
        weighted = cross if weights is None else (cross * weights).astype(np.complex64)
        values = weighted.view(np.float32) @ self._table
        tdoas, heights = self._maxima(values, count)
        back = np.exp(tdoas[0] * self._j_omega)
        turned = weighted * back
        height, slope, curvature = (self._moments @ turned.view(np.float64)).tolist()
        height, curvature = max(height, _TINY), max(curvature, _TINY)
        tdoas[0] += min(max(slope / curvature, -self._step), self._step)  # a Newton step
        noise = noise_power * self._noise_scale * segment.shape[1]
        std = self._std(turned.real, weights, noise, curvature) * math.sqrt(self._length / segment.shape[1])
        signal = height if weights is None else float((cross * back).real.sum())
        snr = signal / (self._omega.size * noise)
        values /= np.float32(height)
        return Correlation(self.lags, values, tdoas, heights / max(heights[0], _TINY), curvature / height, std, snr)

    def _maxima(self, values: AnyArray, count: int) -> tuple[Array, Array]:
        """(P,) lags and heights of the strongest local maxima, the strongest first.

        Parabolas are compared: the raw grid would favour some maxima. They leave tens of ns, a tenth of what echoes do.
        """
        rise = values[1:] - values[:-1]
        falls = rise < 0
        k = (falls[1:] > falls[:-1]).nonzero()[0]
        if k.size == 0:
            return self.lags[[int(values.argmax())]], np.array([_TINY])
        top = k + 1
        up, down = rise[k], rise[top]
        slope = up + down
        offset = slope / (up - down)
        heights = values[top] + 0.125 * slope * offset
        best = heights.argsort()[: -count - 1 : -1]
        return (self.lags[top] + (0.5 * self._step) * offset)[best], heights[best]

    def _std(self, turned: Array, weights: AnyArray | None, noise: float, curvature: float) -> float:
        """First-order error of the maximum, all bins independent; for `cc` and a flat band the Cramer-Rao bound."""
        if curvature <= _TINY:
            return self._largest_std
        signal, white = curvature, self._white
        if weights is not None:
            signal, white = max(float((turned * weights) @ self._omega_2), 0.0), float(weights**2 @ self._omega_2)
        return min(math.sqrt(noise * signal + 0.5 * noise**2 * white) / curvature, self._largest_std)


def _weights(g0: Complex, g1: Complex, weighting: str) -> AnyArray:
    """(bins,) Knapp & Carter (1976), table 1, from spectra averaged over neighbouring bins."""
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
