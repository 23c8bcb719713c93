"""Positions without iteration: of each receiver alone, their mean, the linearised circles, the likeliest of several."""

from __future__ import annotations

import numpy as np

from ..types import Array
from .model import Likelihood, solve_2x2


def closed_form(likelihood: Likelihood) -> Array:
    """(2, M) positions near the optimum: the information-weighted mean of own fixes of evenly spread receivers."""
    spread = np.linspace(0, len(likelihood.receivers) - 1, _CANDIDATES).round().astype(int)
    few = likelihood.rows(np.unique(spread))
    own = single_fixes(few)
    return np.array(weighted_mean(single_information(few, *own), *own))


def likeliest_start(likelihood: Likelihood) -> tuple[Array, Array]:
    """The likeliest of the receivers' own fixes and their information-weighted mean.

    One receiver's fix is worthless near its baseline, where the mean of all and the linear fix fail too; some
    candidate is always good.
    """
    x, y = single_fixes(likelihood)
    information = xx, xy, yy = single_information(likelihood, x, y)
    mean_x, mean_y = weighted_mean(information, x, y)
    if len(x) > _CANDIDATES:
        best = np.argpartition(xy * xy - xx * yy, _CANDIDATES, axis=0)[:_CANDIDATES]
        x, y = np.take_along_axis(x, best, axis=0), np.take_along_axis(y, best, axis=0)
    xs, ys = np.vstack([x, mean_x]), np.vstack([y, mean_y])
    costs = np.array([likelihood.cost(*candidate) for candidate in zip(xs, ys, strict=True)])
    best = np.argmin(costs, axis=0)[None]
    return np.take_along_axis(xs, best, axis=0)[0], np.take_along_axis(ys, best, axis=0)[0]


_CANDIDATES = 6


def least_squares(likelihood: Likelihood) -> tuple[Array, ...]:
    """x, y, cov xx xy yy: each receiver's circle minus the transmitter's (eq. 3), by pseudo-inverse (eq. 4).

    The right sides are independent, so the covariance is the pseudo-inverse's propagation of their variances.
    """
    inverse = np.linalg.pinv(likelihood.receivers - likelihood.transmitter)
    right_side, variance = circle_differences(likelihood)
    x, y = inverse @ right_side + likelihood.transmitter[:, None]
    xx, xy, yy = np.stack([inverse[0] ** 2, inverse[0] * inverse[1], inverse[1] ** 2]) @ variance
    return x, y, xx, xy, yy


def directions(bearings: Array) -> tuple[Array, Array]:
    """Cosines and sines by the tangent of the half angle: numpy's tan is vectorised, its sin and cos are not."""
    tangent = np.tan(0.5 * bearings)
    share = 2.0 / (1.0 + tangent * tangent)
    return share - 1.0, share * tangent


def single_fixes(likelihood: Likelihood) -> tuple[Array, Array]:
    """(N, M) x and y: each receiver's own fix, the distance from the range sum along the bearing (eq. 1)."""
    cosines, sines = directions(likelihood.bearings)
    distance, _ = _receiver_distances(likelihood, cosines, sines)
    x = likelihood.receivers[:, :1] + distance * cosines
    return x, likelihood.receivers[:, 1:] + distance * sines


def single_information(likelihood: Likelihood, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """(N, M) xx, xy, yy of each receiver's information at its own fix (N, M), see `Likelihood.cov`."""
    return likelihood.information(x, y, 1.0 / np.sqrt(likelihood.range_weight))


def weighted_mean(information: tuple[Array, Array, Array], x: Array, y: Array) -> tuple[Array, Array]:
    """(M,) mean of the rows of x and y (N, M), weighted with the information (xx, xy, yy) of each."""
    xx, xy, yy = information
    pull_x, pull_y = (xx * x + xy * y).sum(axis=0), (xy * x + yy * y).sum(axis=0)
    return solve_2x2(xx.sum(axis=0), xy.sum(axis=0), yy.sum(axis=0), pull_x, pull_y)


def circle_differences(likelihood: Likelihood) -> tuple[Array, Array]:
    """(N, M) right sides of eq. 3 with the transmitter as origin, and their variances.

    (b^2 + r_T^2 - R^2) / 2 = (b^2 + r^2) / 2 - r R, with r_T = r - R and both known from one receiver.
    """
    bx, by = (likelihood.receivers - likelihood.transmitter).T[:, :, None]
    r, (cosines, sines) = likelihood.ranges, directions(likelihood.bearings)
    distance, denominator = _receiver_distances(likelihood, cosines, sines)
    right_side = 0.5 * (bx * bx + by * by + r * r) - r * distance
    by_range = (r - distance) * (1.0 - r / denominator)
    by_bearing = r * distance * (by * cosines - bx * sines) / denominator
    return right_side, by_range**2 / likelihood.range_weight + by_bearing**2 / likelihood.bearing_weight


def _receiver_distances(likelihood: Likelihood, cosines: Array, sines: Array) -> tuple[Array, Array]:
    """(N, M) distance from receiver to target R = (r^2 - b^2) / (2 (r + b cos)), and the denominator's half.

    b is the baseline; a range sum below it gives an R of next to nothing, which leaves the bearing its direction.
    """
    bx, by = (likelihood.receivers - likelihood.transmitter).T[:, :, None]
    r, square = likelihood.ranges, bx * bx + by * by
    denominator = np.maximum(r + bx * cosines + by * sines, 1e-6 + 1e-3 * np.abs(r))
    return np.maximum(r * r - square, 1.0) / (2 * denominator), denominator
