"""What a net can do: Cramer-Rao bound and dilution of precision over a map."""

from __future__ import annotations

import math

import numpy as np

from ..types import Array
from .estimator import Noise, SonarNet, gaussian_likelihood
from .model import inverse_2x2


def cramer_rao(net: SonarNet, targets: Array, noise: Noise, *, bearings: bool = True) -> Array:
    """(..., 2, 2) least covariance in m^2 of an unbiased fix at targets (..., 2) under Gaussian noise of the same std.

    Infinite where the net does not determine the position. The Rayleigh density has a hard edge and no bound of this
    kind; `ml_exact` may be better.
    """
    shape, size = targets.shape[:-1], math.prod(targets.shape[:-1])
    ranges, angles = net.measure(targets.reshape(size, 2))
    likelihood = gaussian_likelihood(net, ranges, angles, noise)
    used = likelihood if bearings else likelihood.without_bearings()
    x, y = targets.reshape(size, 2).T
    information = used.information(x, y, np.zeros(1))
    xx, xy, yy = inverse_2x2(*(term.sum(axis=0) for term in information))
    return np.moveaxis(np.array([[xx, xy], [xy, yy]]).reshape(2, 2, *shape), (0, 1), (-2, -1))


def position_error(cov: Array) -> Array:
    """(...) root of the trace in m: the RMSE that a covariance (..., 2, 2) stands for."""
    rmse: Array = np.sqrt(np.trace(cov, axis1=-2, axis2=-1))
    return rmse


def dilution(net: SonarNet, targets: Array) -> Array:
    """(...) geometric dilution of precision: metres of position error per metre of range-sum error, ranges alone."""
    unit = np.ones(len(net.receivers))
    return position_error(cramer_rao(net, targets, Noise(unit, unit, rayleigh=False), bearings=False))
