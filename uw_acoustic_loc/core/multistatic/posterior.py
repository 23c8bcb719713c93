"""Mean and covariance of a skewed likelihood, which its mode and curvature do not give."""

from __future__ import annotations

import math

import numpy as np

from ..types import Array
from .model import Likelihood, Moments


def posterior(likelihood: Likelihood, mode: Moments) -> tuple[Array, ...]:
    """(M,) mean x, y and covariance xx, xy, yy of the normalised likelihood, summed over a lattice around its mode.

    Of all estimates it has the least square error, if every position is as likely before. Upon a receiver the
    likelihood may have a peak between the points of the lattice: then the mode stays.
    """
    xx, xy, yy = likelihood.cov(mode)
    with np.errstate(invalid="ignore"):  # infinite variances end as NaN, and the mode stays
        along = np.sqrt(xx)
        slant = xy / along
        across = np.sqrt(yy - slant * slant)
        sums = np.zeros((6, mode.x.size))
        for first, second in _LATTICE:
            dx, dy = first * along, first * slant + second * across
            weight = np.exp(np.minimum(mode.cost - likelihood.cost(mode.x + dx, mode.y + dy), 1.0))
            sums += weight * np.array([np.ones_like(dx), dx, dy, dx * dx, dx * dy, dy * dy])
        mx, my, sxx, sxy, syy = sums[1:] / np.maximum(sums[0], 1e-100)
        found = np.array([mode.x + mx, mode.y + my, sxx - mx * mx, sxy - mx * my, syy - my * my])
        return tuple(np.where(sums[0] > _PEAK, found, [mode.x, mode.y, xx, xy, yy]))


def _lattice(spacing: float, radius: float) -> Array:
    """(K, 2) points of a square lattice within a circle around the middle of a cell."""
    steps = np.arange(0.5 - math.ceil(radius), math.ceil(radius)) * spacing
    points = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    inside: Array = points[np.hypot(*points.T) <= radius]
    return inside


_LATTICE = _lattice(1.0, 3.9)  # standard deviations
_PEAK = 2.0  # least sum of the lattice's weights over the mode's; 6.3 for a Gaussian
