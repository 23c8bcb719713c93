"""Bearing-only EKF of a still source (Shin et al. 2013, eq. 3-12) in log-polar coordinates, a bank over the range."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .geometry import wrap_angle, wrap_angles
from .triangulation import Drift, Fix, Ray
from .types import Array

_Members = tuple[NDArray[np.complex128], Array, Array, Array]  # log range + i bearing; their variances and covariance


class BearingEkf:
    """A Gaussian mixture, each member an EKF, weighted by its likelihood.

    The state of a member is zeta = log range + i bearing, seen from where the last bearing was heard. With known motion
    this is the relative position of eq. 3-12 in the coordinates of Aidala and Hammel (1983): a bearing is linear in
    them, a drift of the heading adds to the bearing alone, and what is known of the range is not mistaken for what is
    known of the bearing, as x and y do after many noisy steps. `process_noise` (m per sqrt(s)) is how fast the
    position may wander in the frame.
    """

    def __init__(self, origin: Array, means: Array, covs: Array, process_noise: float = 0.0) -> None:
        """Members `means` (K, 2) and `covs` (K, 2, 2) of log range and bearing, seen from `origin`; of equal weight."""
        if means.ndim != 2 or means.shape[1] != 2 or covs.shape != (len(means), 2, 2):
            raise ValueError(f"means must be (K, 2) and covs (K, 2, 2), got {means.shape} and {covs.shape}")
        self._origin = complex(*origin)
        self._members: _Members = (means[:, 0] + 1j * means[:, 1], covs[:, 0, 0], covs[:, 1, 1], covs[:, 0, 1])
        self._log_weight = np.full(len(means), -math.log(len(means)))
        self._process_noise = process_noise

    def predict(self, duration: float, drift: Drift) -> None:
        """Lets the position wander for a duration in s, and turn about the vehicle."""
        if drift.variance:
            self._move(drift.x, drift.y)
        zeta, ranges, bearings, mixed = self._members
        wander = self._process_noise**2 * duration * np.exp(-2 * zeta.real)
        self._members = zeta, ranges + wander, bearings + wander + drift.variance, mixed

    def update(self, ray: Ray) -> None:
        """Corrects every member and its weight (eq. 8-12); a correlated bearing counts with its share."""
        self._move(ray.x, ray.y)
        zeta, ranges, bearings, mixed = self._members
        error = wrap_angles(ray.bearing - zeta.imag)
        S = bearings + ray.std**2 / ray.weight
        zeta = zeta + (mixed + 1j * bearings) / S * error
        self._members = (
            zeta,
            ranges - mixed * mixed / S,
            bearings - bearings * bearings / S,
            mixed - mixed * bearings / S,
        )
        self._reweigh(self._log_weight - 0.5 * (error * error / S + np.log(S)))

    def predicted_bearing(self, x: float, y: float) -> tuple[float, float]:
        """Absolute bearing of the source from a point, and its variance."""
        zeta, _, bearings, _ = self._seen_from(complex(x, y))
        weight = np.exp(self._log_weight)
        centre = float(zeta.imag[int(np.argmax(weight))])
        spread = wrap_angles(zeta.imag - centre)
        mean = float(weight @ spread)
        return wrap_angle(centre + mean), float(weight @ (bearings + (spread - mean) ** 2))

    def estimate(self) -> Fix:
        """Mean and covariance of the mixture in x and y, exact for Gaussian members: E exp(a zeta) in closed form."""
        zeta, ranges, bearings, mixed = self._members
        weight = np.exp(self._log_weight)
        mean = complex(weight @ np.exp(zeta + (ranges - bearings) / 2 + 1j * mixed))
        square = complex(weight @ np.exp(2 * zeta + 2 * (ranges - bearings) + 4j * mixed)) - mean**2
        length = float(weight @ np.exp(2 * zeta.real + 2 * ranges)) - abs(mean) ** 2
        cov = np.array([[length + square.real, square.imag], [square.imag, length - square.real]]) / 2
        position = self._origin + mean
        return Fix(np.array([position.real, position.imag]), cov)

    @property
    def members(self) -> int:
        """How many range hypotheses live."""
        return self._log_weight.size

    def _move(self, x: float, y: float) -> None:
        self._members, self._origin = self._seen_from(complex(x, y)), complex(x, y)

    def _seen_from(self, point: complex) -> _Members:
        """The members from another point. d zeta' = c d zeta with one complex factor c: a turn and a stretch."""
        zeta, ranges, bearings, mixed = self._members
        line = np.exp(zeta)
        moved = line + self._origin - point
        moved = np.where(np.abs(moved) < _NEAREST, _NEAREST, moved)
        c = line / moved
        a, b = c.real, c.imag
        return (
            np.log(moved),
            a * a * ranges - 2 * a * b * mixed + b * b * bearings,
            b * b * ranges + 2 * a * b * mixed + a * a * bearings,
            a * b * (ranges - bearings) + (a * a - b * b) * mixed,
        )

    def _reweigh(self, log_weight: Array) -> None:
        log_weight = log_weight - log_weight.max()
        keep = log_weight > _PRUNED
        if not keep.all():
            zeta, ranges, bearings, mixed = self._members
            self._members = zeta[keep], ranges[keep], bearings[keep], mixed[keep]
            log_weight = log_weight[keep]
        self._log_weight = log_weight - math.log(float(np.exp(log_weight).sum()))


def range_bank(ray: Ray, range_min: float, range_max: float, process_noise: float = 0.0) -> BearingEkf:
    """A start from one bearing: members along it in geometric progression (Peach 1995), equally likely.

    Each has the mean and variance of a log range uniform in its interval.
    """
    if not 0 < range_min < range_max:
        raise ValueError(f"range_min must be above 0 and below range_max, got {range_min:g} and {range_max:g}")
    count = math.ceil(math.log(range_max / range_min) / math.log(_RATIO))
    edges = np.linspace(math.log(range_min), math.log(range_max), count + 1)
    means = np.stack([(edges[1:] + edges[:-1]) / 2, np.full(count, ray.bearing)], axis=1)
    covs = np.tile(np.diag([(edges[1] - edges[0]) ** 2 / 12, ray.std**2 / ray.weight]), (count, 1, 1))
    return BearingEkf(np.array([ray.x, ray.y]), means, covs, process_noise)


def single_start(origin: Array, mean: Array, cov: Array) -> BearingEkf:
    """A start at a guessed position (2,) with its covariance (2, 2), as in Shin et al.'s simulation."""
    dx, dy = mean - origin
    squared = float(dx * dx + dy * dy)
    J = np.array([[dx, dy], [-dy, dx]]) / squared
    return BearingEkf(origin, np.array([[math.log(squared) / 2, math.atan2(dy, dx)]]), (J @ cov @ J.T)[None])


_RATIO = 1.6  # of neighbouring ranges
_PRUNED = math.log(1e-4)  # relative to the heaviest
_NEAREST = 1e-6  # m
