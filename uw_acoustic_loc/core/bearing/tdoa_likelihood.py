"""What one ping says about the TDOA."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..types import AnyArray, Array
from .gcc import Correlation

OUTLIER = 0.05  # probability that no maximum of a correlation belongs to the direct path
SURE = 0.002  # the same for the only lobe of a short array, in the part that echoes have not reached


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
    outlier: float = OUTLIER

    @classmethod
    def of(
        cls, found: Correlation, std_floor: float, height_std: float, max_lag: float, outlier: float = OUTLIER
    ) -> PeakLikelihood:
        """From a correlation; `height_std` is that of a maximum's relative height through echoes.

        A maximum beyond the largest possible lag means end-fire.
        """
        std = math.hypot(found.std, std_floor)
        spread = found.curvature * found.std**2 + height_std
        order = found.tdoas.argsort()
        weights = np.exp((found.heights - found.heights[0]) / spread).take(order)
        tdoas = np.minimum(np.maximum(found.tdoas.take(order), -max_lag), max_lag)
        return cls(tdoas, weights / weights.sum(), std, max_lag, outlier)

    @property
    def floor(self) -> float:
        """Density of the uniform part, 1/s."""
        return self.outlier / (2.0 * self.max_lag)

    def nearest(self, tdoas: AnyArray) -> tuple[AnyArray, AnyArray]:
        """(n,) share of the maximum next to each TDOA, and how far off it is in s."""
        owner = (0.5 * (self.tdoas[1:] + self.tdoas[:-1])).astype(tdoas.dtype).searchsorted(tdoas)
        shares = ((1.0 - self.outlier) * self.weights).astype(tdoas.dtype)
        centres = self.tdoas.astype(tdoas.dtype)
        return shares.take(owner, mode="clip"), centres.take(owner, mode="clip") - tdoas

    def at(self, tdoas: Array) -> Array:
        """Density in 1/s. Maxima lie many standard deviations apart, so only the nearest counts."""
        weight, off = self.nearest(tdoas)
        height = weight / (math.sqrt(2 * math.pi) * self.std)
        return np.asarray(height * np.exp(-0.5 * np.square(off / self.std)) + self.floor)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """(count,) TDOAs of a source that may be anywhere; stratified.

        What falls beyond the largest lag is folded back: heaped up there it would outweigh everything near end-fire.
        """
        choice = self.weights.cumsum()[:-1].searchsorted(np.arange(rng.random(), count) / count)
        drawn = self.tdoas.take(choice) + self.std * rng.standard_normal(count)
        anywhere = drawn[:: round(1.0 / self.outlier)]
        anywhere[:] = rng.uniform(-self.max_lag, self.max_lag, anywhere.size)
        folded = np.where(np.abs(drawn) > self.max_lag, np.copysign(2.0 * self.max_lag, drawn) - drawn, drawn)
        return np.minimum(np.maximum(folded, -self.max_lag), self.max_lag)
