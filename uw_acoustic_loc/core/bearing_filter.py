"""What one ping says about the TDOA, and the filters that carry it from ping to ping.

A filter sees one half plane: angles theta in [0, pi] from the array's +x towards the assumed side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .gcc import Correlation
from .geometry import tdoa_of_points
from .types import Array

_OUTLIER = 0.05  # probability that no maximum of a correlation belongs to the direct path
_LOST = 1e-3  # probability per ping that the source is not where the filter has it
_SEARCHERS = 20
_BIN = math.radians(0.05)  # of the histogram; at broadside 0.35 us for 0.6 m
_LOBE = math.radians(1.5)  # half width of what belongs to one maximum; carrier cycles lie further apart


@dataclass(frozen=True, eq=False)
class PeakLikelihood:
    """Likelihood of a TDOA: normal distributions around the strongest maxima of the correlation, on a uniform floor.

    Shin et al. (2013), section II.2, multiply equal distributions by the correlation itself. Here each is weighted by
    exp((height - 1) / height_variance): with white noise alone the correlation is the log-likelihood, and
    `height_variance` adds what echoes do to the heights, so that nearly equal maxima stay nearly equal.
    """

    tdoas: Array  # (P,) ascending
    weights: Array  # (P,) sum 1
    std: float  # s
    max_lag: float  # s

    @classmethod
    def of(cls, found: Correlation, std_floor: float, height_std: float, max_lag: float) -> PeakLikelihood:
        """From a correlation; `height_std` is that of a maximum's relative height through echoes.

        A maximum beyond the largest possible lag means end-fire.
        """
        std = math.hypot(found.std, std_floor)
        spread = found.curvature * found.std**2 + height_std
        order = np.argsort(found.tdoas)
        weights = np.exp((found.heights - found.heights[0]) / spread)[order]
        return cls(np.clip(found.tdoas[order], -max_lag, max_lag), weights / weights.sum(), std, max_lag)

    @property
    def floor(self) -> float:
        """Density of the uniform part, 1/s."""
        return _OUTLIER / (2.0 * self.max_lag)

    def at(self, tdoas: Array) -> Array:
        """Density in 1/s. Maxima lie many standard deviations apart, so only the nearest counts."""
        between = (self.tdoas[1:] + self.tdoas[:-1]) / 2
        nearest = np.searchsorted(between, tdoas)
        off = (tdoas - self.tdoas[nearest]) / self.std
        height = (1.0 - _OUTLIER) / (math.sqrt(2 * math.pi) * self.std) * self.weights
        return np.asarray(height[nearest] * np.exp(-0.5 * off * off) + self.floor)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """(count,) TDOAs of a source that may be anywhere."""
        choice = rng.choice(self.tdoas.size, count, p=self.weights)
        drawn = self.tdoas[choice] + self.std * rng.standard_normal(count)
        uniform = rng.uniform(-self.max_lag, self.max_lag, count)
        drawn = np.where(rng.random(count) < _OUTLIER, uniform, drawn)
        return np.clip(drawn, -self.max_lag, self.max_lag)


class LastPeak:
    """No filter: the strongest maximum of the last ping."""

    def __init__(self) -> None:
        self._theta, self._variance = math.pi / 2, math.pi**2 / 12

    def predict(self, turn: float, move: tuple[float, float], spread: float) -> None:
        del move
        self._theta = min(max(self._theta - turn, 0.0), math.pi)
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

    def __init__(self, spacing: float, sound_speed: float) -> None:
        self._theta = np.linspace(0.0, math.pi, round(math.pi / _BIN) + 1)
        self._tdoas = spacing / sound_speed * np.cos(self._theta)
        self._p = np.full(self._theta.size, 1.0 / self._theta.size)

    def predict(self, turn: float, move: tuple[float, float], spread: float) -> None:
        """The array turns by `turn`; the effect of its `move` is in the spread, the range being unknown."""
        del move
        p = np.interp(self._theta + turn, self._theta, self._p, left=0.0, right=0.0)
        bins = min(spread / _BIN, p.size / 8)
        if bins > 0.1:
            k = np.arange(-math.ceil(4 * bins), math.ceil(4 * bins) + 1)
            kernel = np.exp(-0.5 * (k / bins) ** 2)
            p = np.convolve(p, kernel / kernel.sum(), "same")
        self._p = _normalised(p)

    def update(self, likelihood: PeakLikelihood) -> None:
        prior = (1.0 - _LOST) * self._p + _LOST / self._p.size
        self._p = _normalised(prior * likelihood.at(self._tdoas))

    def estimate(self) -> tuple[float, float]:
        """Mean of the strongest lobe, and the mean square deviation of everything from it."""
        top = self._theta[int(np.argmax(self._p))]
        return _lobe(self._theta, self._p, top)


class ParticleFilter:
    """Positions of the source in the plane of the array, range and all (Shin et al. 2013, section II.2).

    The first ping draws the cloud that weighting and resampling an endless even one would leave. The estimate is the
    mean of the strongest lobe: the mean of the whole cloud would fall between two carrier cycles.
    """

    def __init__(
        self, spacing: float, sound_speed: float, ranges: tuple[float, float], count: int, rng: np.random.Generator
    ) -> None:
        self._spacing, self._sound_speed, self._ranges, self._rng = spacing, sound_speed, ranges, rng
        self._turn = 0
        self._xy = self._placed(np.cos(rng.uniform(0.0, math.pi, count)))
        self._log_weights = np.full(count, -math.log(count))
        self._started = False

    @property
    def cloud(self) -> tuple[Array, Array]:
        """Positions (2, n) and weights (n,)."""
        return self._xy, np.exp(self._log_weights)

    def predict(self, turn: float, move: tuple[float, float], spread: float) -> None:
        """The array moves by `move` and turns by `turn`; noise of `spread` rad, alike in log range."""
        x, y = self._xy[0] - move[0], self._xy[1] - move[1]
        noise = self._rng.standard_normal((2, x.size))
        noise *= spread
        noise[0] -= turn
        cos, sin, scale = np.cos(noise[0]), np.sin(noise[0]), 1.0 + noise[1]
        self._xy[0] = (cos * x - sin * y) * scale
        np.abs((sin * x + cos * y) * scale, out=self._xy[1])

    def update(self, likelihood: PeakLikelihood) -> None:
        """Weighs, after resampling when fewer than half of the particles count."""
        if not self._started:
            self._xy = self._placed(likelihood.draw(self._log_weights.size, self._rng) / likelihood.max_lag)
            self._started = True
            return
        self._resample_if_poor()
        tdoas = tdoa_of_points(self._xy, self._spacing, self._sound_speed)
        log_weights = self._log_weights + np.log(likelihood.at(tdoas))
        self._search(likelihood, log_weights)
        top = log_weights.max()
        self._log_weights = log_weights - (top + math.log(np.exp(log_weights - top).sum()))

    def _search(self, likelihood: PeakLikelihood, log_weights: Array) -> None:
        """Every 20th particle, another set each time, is placed where the ping says, should the source be lost."""
        fresh = slice(self._turn, None, _SEARCHERS)
        self._turn = (self._turn + 1) % min(_SEARCHERS, log_weights.size)
        count = log_weights[fresh].size
        self._xy[:, fresh] = self._placed(likelihood.draw(count, self._rng) / likelihood.max_lag)
        log_weights[fresh] = math.log(_LOST / (2.0 * likelihood.max_lag * count))  # evidence of a source anywhere

    def estimate(self) -> tuple[float, float]:
        """Mean of the strongest lobe, and the mean square deviation of everything from it."""
        theta, weights = np.arctan2(self._xy[1], self._xy[0]), np.exp(self._log_weights)
        width = 2.0 * _LOBE
        counts = np.bincount((theta / (width / 4)).astype(np.intp), weights)
        lobes = np.convolve(counts, np.ones(4), "same")
        k = int(np.argmax(lobes))
        return _lobe(theta, weights, k * width / 4)

    def _placed(self, cosines: Array) -> Array:
        """(2, n) even over the plane between the ranges, in given directions."""
        near, far = self._ranges
        r = np.sqrt(self._rng.uniform(near**2, far**2, cosines.size))
        return np.stack([r * cosines, r * np.sqrt(1.0 - cosines**2)])

    def _resample_if_poor(self) -> None:
        weights = np.exp(self._log_weights)
        n = weights.size
        if 1.0 / float(weights @ weights) >= n / 2:
            return
        edges = np.floor(np.cumsum(weights) * n + self._rng.random()).astype(np.intp)
        edges[-1] = n
        copies = np.diff(np.minimum(edges, n), prepend=0)
        self._xy = self._xy.take(np.repeat(np.arange(n), copies), axis=1)
        self._log_weights = np.full(n, -math.log(n))


def angle_variance(theta: float, cosine_std: float) -> float:
    """Variance of an angle whose cosine has a standard deviation; finite at end-fire."""
    slope = max(math.sin(theta), math.sqrt(cosine_std), 1e-9)
    return (cosine_std / slope) ** 2


def _lobe(theta: Array, weights: Array, top: float) -> tuple[float, float]:
    inside = np.abs(theta - top) <= _LOBE
    mean = float(weights[inside] @ theta[inside] / weights[inside].sum())
    return mean, float(weights @ (theta - mean) ** 2)


def _normalised(p: Array) -> Array:
    total = p.sum()
    return p / total if total > 0.0 else np.full(p.size, 1.0 / p.size)
