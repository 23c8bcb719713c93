"""Filters that carry what pings say about the TDOA from one to the next.

They estimate the angle theta in [0, pi] between the array's +x and the source. A turn of the vehicle makes it larger or
smaller, as the source lies to starboard or to port. A filter begins on the assumed side, or with equal shares on both
until turns have settled it; a source that does not follow the assumed side's motion is found on the other.
"""

from __future__ import annotations

import math

import numpy as np

from ..types import AnyArray, Array
from .tdoa_likelihood import PeakLikelihood

__all__ = ["HistogramFilter", "LastPeak", "ParticleFilter", "PeakLikelihood", "angle_variance", "lobe_width"]

_LOST = 1e-3  # probability per ping that the source is not where the filter has it
_SUSPICION = 1e-4  # of the weight
_WIDE_DOUBT = 0.02  # share elsewhere that a lobe alone in its array may leave out of its variance
_SEARCHERS = 20
_SEARCH = 4  # pings from one search to the next, unless a ping comes as a surprise
_NOISES = 1 << 16  # drawn at the start, at least
_STEP = 0.025  # rad of motion noise, at most, that waits for the ping: a quarter of what carrier cycles lie apart
_POOR = 0.25  # of the particles count, and they are resampled
_LARGEST = 0.01  # variance of a range's logarithm that a resampling adds
_TINY = 1e-9
_CORE = 2.5  # standard deviations of a wide lobe that its mean is taken from
_BIN = math.radians(0.05)  # of the histogram; at broadside 0.35 us for 0.6 m
_PER_DIRECTION, _LEAST = 100, 300  # particles: per half lobe with any weight, and in all
_LOBE = math.radians(1.5)  # half width of what belongs to one maximum, at least; carrier cycles lie further apart


class LastPeak:
    """No filter: the strongest maximum of the last ping, carried on by turns as on the assumed side (1 = port)."""

    def __init__(self, side: int = 1) -> None:
        self._side = side
        self._theta, self._variance = math.pi / 2, math.pi**2 / 12

    def predict(self, turn: float, move: tuple[float, float], spread: float) -> None:
        del move
        self._theta = min(max(self._theta - self._side * turn, 0.0), math.pi)
        self._variance = min(self._variance + spread**2, math.pi**2 / 12)

    def update(self, likelihood: PeakLikelihood) -> None:
        tdoa = likelihood.tdoas[int(np.argmax(likelihood.weights))]
        cosine = min(max(tdoa / likelihood.max_lag, -1.0), 1.0)
        self._theta = math.acos(cosine)
        self._variance = angle_variance(self._theta, likelihood.std / likelihood.max_lag)

    def estimate(self) -> tuple[float, float]:
        """Angle and its variance."""
        return self._theta, self._variance


class HistogramFilter:
    """Posterior over TDOAs at equal steps of angle, so that the vehicle's turn is a shift (Choi et al. 2016, eq. 5)."""

    def __init__(
        self, spacing: float, sound_speed: float, lobe: float = _LOBE, sides: tuple[int, ...] = (1, -1)
    ) -> None:
        self._lobe = lobe
        half = round(math.pi / _BIN)
        self._theta = np.linspace(0.0, math.pi, half + 1)
        self._folded = np.abs(
            np.arange(2 * half) - half
        )  # bin of the half circle, to which a bin of the circle belongs
        self._tdoas = spacing / sound_speed * np.cos(self._theta)
        port = np.arange(2 * half) >= half
        self._p = _normalised(np.where(port, 1 in sides, -1 in sides).astype(np.float64))  # over the circle, from -pi

    def predict(self, turn: float, move: tuple[float, float], spread: float) -> None:
        """The array turns by `turn`; the effect of its `move` is in the spread, the range being unknown."""
        del move
        shift, n = turn / _BIN, self._p.size
        whole = math.floor(shift)
        p = np.roll(self._p, -whole)
        p += (shift - whole) * (np.roll(p, -1) - p)
        bins = min(spread / _BIN, n / 16)
        if bins > 0.1:
            k = np.arange(-math.ceil(4 * bins), math.ceil(4 * bins) + 1)
            kernel = np.exp(-0.5 * (k / bins) ** 2)
            p = np.convolve(np.pad(p, k[-1], "wrap"), kernel / kernel.sum(), "valid")
        self._p = _normalised(p)

    def update(self, likelihood: PeakLikelihood) -> None:
        prior = (1.0 - _LOST) * self._p + _LOST / self._p.size
        self._p = _normalised(prior * likelihood.at(self._tdoas).take(self._folded))

    def estimate(self) -> tuple[float, float]:
        """Mean of the strongest lobe, and the mean square deviation of everything from it."""
        p = np.bincount(self._folded, self._p)
        return _lobe(self._theta, p, self._theta[int(np.argmax(p))], self._lobe)


class ParticleFilter:
    """Positions of the source in the plane of the array, range and all (Shin et al. 2013, section II.2).

    Five deviations from the paper. The motion noise is drawn when the ping is known, from what motion and ping say
    together: the optimal importance density (Doucet, Godsill, Andrieu 2000). Drawn before, it would take all but one in
    twenty particles off their maximum, and chance would decide between carrier cycles that are nearly equal. Resampling
    goes by the roots of the weights, so that unlikely cycles keep particles, and draws only as many particles as the
    directions that are left need, as in Fox (2003). The first ping draws the cloud that weighting and resampling an
    endless even one would leave. The estimate is the mean of the strongest lobe: the mean of the whole cloud would fall
    between two carrier cycles.
    """

    def __init__(
        self,
        spacing: float,
        sound_speed: float,
        ranges: tuple[float, float],
        count: int,
        rng: np.random.Generator,
        lobe: float = _LOBE,
        sides: tuple[int, ...] = (1, -1),
    ) -> None:
        self._sides = sides
        self._lobe, self._bins = lobe, math.ceil(2.0 * math.pi / lobe) + 3  # half a lobe each
        self._spacing, self._sound_speed, self._ranges, self._rng = spacing, sound_speed, ranges, rng
        self._most = count
        self._noises = rng.standard_normal(max(_NOISES, 2 * count), np.float32)
        self._pings = 0
        self._xy = self._placed(np.cos(rng.uniform(0.0, math.pi, count)), sides)
        self._weights = np.full(count, 1.0 / count, np.float32)  # no logarithms: a ping's floor bounds their ratios
        self._pending = self._outward = 0.0  # rad^2, of motion noise that waits for the ping, and for resampling
        self._started = False

    @property
    def cloud(self) -> tuple[Array, Array]:
        """Positions (2, n) and weights (n,)."""
        return self._xy.astype(np.float64), self._weights.astype(np.float64)

    def predict(self, turn: float, move: tuple[float, float], spread: float) -> None:
        """The array moves by `move` and turns by `turn`; noise of `spread` rad, alike in log range."""
        if turn or move != (0.0, 0.0):
            cos, sin = math.cos(turn), math.sin(turn)
            back = np.array([[cos, sin], [-sin, cos]], np.float32)
            self._xy = back @ (self._xy - np.array(move, np.float32)[:, None])
        self._outward += spread**2
        total = self._pending + spread**2
        self._pending = min(total, _STEP**2)
        if total > self._pending:
            angle = np.float32(math.sqrt(total - self._pending)) * self._noise()
            self._turn_by(np.tan(angle))
            self._xy *= np.cos(angle)

    def update(self, likelihood: PeakLikelihood) -> None:
        """Weighs, after resampling when fewer than a quarter of the particles count."""
        if not self._started:
            self._xy = self._placed(likelihood.draw(self._weights.size, self._rng) / likelihood.max_lag, self._sides)
            self._started = True
        else:
            self._resample_if_poor()
            self._weights *= self._follow(likelihood)
            evidence = float(self._weights.sum())
            if self._pings % _SEARCH == 0 or evidence < 2.0 * likelihood.floor:
                self._search(likelihood)
                evidence = float(self._weights.sum())
            self._weights /= np.float32(evidence)
        self._pending = 0.0
        self._pings += 1

    def estimate(self) -> tuple[float, float]:
        """Mean of the strongest lobe, and the mean square deviation of everything from it."""
        theta, bins = self._directions()
        lobes = bins[:-3] + bins[1:-2] + bins[2:-1] + bins[3:]
        mean, variance = _lobe(theta, self._weights, (int(lobes.argmax()) + 2) * self._lobe / 2.0, self._lobe)
        return mean, variance + self._pending

    def _directions(self) -> tuple[AnyArray, Array]:
        """(n,) angles, and the weight in each half lobe."""
        theta = np.arctan2(np.abs(self._xy[1]), self._xy[0])
        weights = np.bincount((theta * (2.0 / self._lobe)).astype(np.intp), self._weights, self._bins)
        return theta, np.asarray(weights, dtype=np.float64)

    def _follow(self, likelihood: PeakLikelihood) -> AnyArray:
        """Moves each particle to where motion and ping together say; (n,) 1/s, the ping's density before that.

        Per particle the prior is normal in angle and the density a normal one at the nearest maximum, on the floor.
        A particle at which the floor is the higher one takes the ping for an outlier.
        """
        x, y = self._xy
        square, cross = x * x + y * y + 0.25 * self._spacing**2, x * self._spacing
        scale = 2.0 * self._spacing / self._sound_speed / (np.sqrt(square + cross) + np.sqrt(square - cross))
        share, off = likelihood.nearest(x * scale)
        least = likelihood.max_lag * math.sqrt(self._pending) + _TINY  # at end-fire
        slope = np.maximum(np.abs(y) * scale, least)  # of the TDOA with the angle, downwards
        prior = slope * slope * self._pending
        both = prior + likelihood.std**2
        peak = share / np.sqrt(both * (2.0 * math.pi)) * np.exp(off * off / (both * -2.0))
        gain = prior / both * (peak > likelihood.floor)
        noise = np.sqrt(prior - prior * gain) * self._noise()
        self._turn_by((gain * off + noise) / slope)
        return np.asarray(peak + np.float32(likelihood.floor))

    def _noise(self) -> AnyArray:
        """(n,) standard normal: a stretch, from anywhere, of a long row drawn at the start."""
        n = self._weights.size
        begin = int(self._rng.random() * (self._noises.size - n))
        return self._noises[begin : begin + n]

    def _turn_by(self, tan: AnyArray) -> None:
        """Turns the particles towards the array's +x, and moves them out by 1 / cos: nothing, for small angles."""
        x, y = self._xy
        tan = np.copysign(tan, tan * y)
        turned = np.empty_like(self._xy)
        np.add(x, tan * y, out=turned[0])
        np.subtract(y, tan * x, out=turned[1])
        self._xy = turned

    def _search(self, likelihood: PeakLikelihood) -> None:
        """Every 20th particle, another set each time, is placed where the ping says, should the source be lost."""
        fresh = slice(self._pings // _SEARCH % min(_SEARCHERS, self._weights.size), None, _SEARCHERS)
        count = self._weights[fresh].size
        self._xy[:, fresh] = self._placed(likelihood.draw(count, self._rng) / likelihood.max_lag)
        self._weights[fresh] = _SEARCH * _LOST / (2.0 * likelihood.max_lag * count)  # evidence of a source anywhere

    def _placed(self, cosines: Array, sides: tuple[int, ...] = (1, -1)) -> AnyArray:
        """(2, n) even over the plane between the ranges, in given directions to port (1), starboard (-1) or both."""
        near, far = self._ranges
        r = np.sqrt(self._rng.uniform(near**2, far**2, cosines.size))
        xy = np.empty((2, r.size), np.float32)
        xy[0], xy[1] = r * cosines, r * np.sqrt(1.0 - cosines * cosines)
        xy[1] *= self._rng.permutation(np.resize(sides, r.size))
        return xy

    def _resample_if_poor(self) -> None:
        """By the roots of the weights (Liu, Chen, Logvinenko 2001): of a lobe with 1 % a tenth of the particles stay.

        By the weights themselves some twenty would stay, and their luck with the next pings would decide. A hundred
        particles for each direction with any weight, up to the configured number, know the bearing as well as more do.
        """
        if 1.0 / float(self._weights @ self._weights) >= self._weights.size * _POOR:
            return
        occupied = int(np.count_nonzero(self._directions()[1] > _SUSPICION))
        n = min(self._most, max(_LEAST, _PER_DIRECTION * occupied))
        roots = np.sqrt(self._weights)
        shares = np.cumsum(roots, dtype=np.float64)
        counts = (shares * (n / shares[-1]) + self._rng.random()).astype(np.intp)
        counts[-1] = n
        counts[1:] -= counts[:-1].copy()
        kept = np.repeat(np.arange(shares.size), counts)
        self._xy = self._xy.take(kept, axis=1)
        width = math.sqrt(12.0 * min(self._outward, _LARGEST))
        self._xy *= width * (self._rng.random(n, np.float32) - 0.5) + 1.0
        self._weights = roots.take(kept)
        self._weights /= self._weights.sum()
        self._outward = 0.0


def angle_variance(theta: float, cosine_std: float) -> float:
    """Variance of an angle whose cosine has a standard deviation; finite at end-fire."""
    slope = max(math.sin(theta), math.sqrt(cosine_std), 1e-9)
    return (cosine_std / slope) ** 2


def lobe_width(spacing: float, sound_speed: float, frequency: float) -> float:
    """Half width in rad of what belongs to one maximum: at broadside a quarter of a carrier cycle."""
    return max(_LOBE, sound_speed / (4.0 * frequency * spacing))


def _lobe(theta: AnyArray, weights: AnyArray, top: float, width: float) -> tuple[float, float]:
    """Mean within the lobe, and the mean square deviation of everything from it.

    Up to _SUSPICION elsewhere is what every ping leaves to a source that was lost, and no evidence of it.
    """
    mean, share, inside = _inside(theta, weights, top, width)
    if width > _LOBE:  # it holds much of what stands for outliers
        spread = math.sqrt(float(inside @ np.square(theta - mean)) / share)
        mean, share, inside = _inside(theta, weights, mean, min(max(_CORE * spread, _LOBE), width))
    off = theta - mean
    doubt = _SUSPICION if width <= _LOBE else _WIDE_DOUBT
    return mean, float((weights if share < 1.0 - doubt else inside) @ (off * off))


def _inside(theta: AnyArray, weights: AnyArray, top: float, width: float) -> tuple[float, float, AnyArray]:
    """Mean and share of the weights within a width of the top, and those weights."""
    inside = weights * (np.abs(theta - top) <= width)
    share = float(inside.sum())
    return float(inside @ theta) / share, share, inside


def _normalised(p: Array) -> Array:
    total = p.sum()
    return p / total if total > 0.0 else np.full(p.size, 1.0 / p.size)
