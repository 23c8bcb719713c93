"""Bearing-only EKF of a still source (Shin et al. 2013, eq. 3-12) in log-polar coordinates, a bank over the range."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable

import numpy as np

from ..geometry import wrap_angle
from ..types import Array
from .bearing_noise import believed
from .log_polar import bearing_moments, cartesian, corrected, seen_from
from .triangulation import Drift, Fix, Ray

Member = tuple[complex, float, complex, float]  # line, g, q of one EKF (`log_polar`); log weight


class BearingEkf:
    """A Gaussian mixture, each member an EKF, weighted by its likelihood.

    With known motion the state is the relative position of eq. 3-12 in the coordinates of Aidala and Hammel (1983): a
    bearing is linear in them, a drift of the heading adds to the bearing alone, and what is known of the range is not
    mistaken for what is known of the bearing, as x and y do after many noisy steps. `process_noise` (m per sqrt(s)) is
    how fast the position may wander in the frame. Each member believes as much of a bearing as fits its own prediction
    (`believed`): an impulse that fits the bank as a whole may be far from the member at the right range. The members
    are few, so plain numbers are faster than arrays.
    """

    def __init__(
        self, origin: Array, means: Array, covs: Array, process_noise: float = 0.0, noise: str = "gaussian"
    ) -> None:
        """Members `means` (K, 2) and `covs` (K, 2, 2) of log range and bearing, seen from `origin`; of equal weight."""
        if means.ndim != 2 or means.shape[1] != 2 or covs.shape != (len(means), 2, 2):
            raise ValueError(f"means must be (K, 2) and covs (K, 2, 2), got {means.shape} and {covs.shape}")
        self._origin = complex(*origin)
        self._members = [_member(mean, cov, -math.log(len(means))) for mean, cov in zip(means, covs, strict=True)]
        self._process_noise, self._noise = process_noise, noise

    def predict(self, duration: float, drift: Drift) -> None:
        """Lets the position wander for a duration in s, and turn about the vehicle."""
        if drift.variance:
            self._move(complex(drift.x, drift.y))
        wander, turn = 2 * self._process_noise**2 * duration, drift.variance
        self._members = [
            (p, g + wander / (p.real * p.real + p.imag * p.imag) + turn, q - turn, w) for p, g, q, w in self._members
        ]

    def update(self, ray: Ray) -> None:
        """Corrects every member and its weight; a correlated bearing counts with its share."""
        self._move(complex(ray.x, ray.y))
        toward, variance = cmath.rect(1.0, ray.bearing), ray.std**2 / ray.weight
        members = []
        for line, g, q, log_weight in self._members:
            error, spread = cmath.phase(toward * line.conjugate()), (g - q.real) / 2
            S, counted = spread + ray.std**2, spread + variance
            trust, log_likelihood = believed(self._noise, error, S, counted, math.exp, math.log)
            after = corrected(line, g, q, toward, variance / trust, cmath.exp, cmath.phase)
            members.append((*after[:3], log_weight + log_likelihood))
        self._members = _normalised(members)

    def predicted_bearing(self, x: float, y: float) -> tuple[float, float]:
        """Absolute bearing of the source from a point, and its variance."""
        line, g, q, weight = _columns(self._seen_from(complex(x, y)))
        mean, variance = bearing_moments(weight, line, [(a - b.real) / 2 for a, b in zip(g, q, strict=True)])
        return wrap_angle(mean), variance

    def estimate(self) -> Fix:
        """Mean and covariance of the mixture in x and y."""
        line, g, q, weight = _columns(self._members)
        return cartesian(weight, line, g, q, self._origin)

    @property
    def members(self) -> int:
        """How many range hypotheses live."""
        return len(self._members)

    def _move(self, point: complex) -> None:
        self._members, self._origin = self._seen_from(point), point

    def _seen_from(self, point: complex) -> list[Member]:
        shift = self._origin - point
        return [(*seen_from(p, g, q, clear(p, shift)), w) for p, g, q, w in self._members]


def range_bank(
    ray: Ray, range_min: float, range_max: float, process_noise: float = 0.0, noise: str = "gaussian"
) -> BearingEkf:
    """A start from one bearing: members along it in geometric progression (Peach 1995), equally likely.

    Each has the mean and variance of a log range uniform in its interval.
    """
    log_ranges, variance = range_intervals(range_min, range_max, _RATIO)
    means = np.stack([log_ranges, np.full(log_ranges.size, ray.bearing)], axis=1)
    covs = np.tile(np.diag([variance, ray.std**2 / ray.weight]), (log_ranges.size, 1, 1))
    return BearingEkf(np.array([ray.x, ray.y]), means, covs, process_noise, noise)


def range_intervals(range_min: float, range_max: float, ratio: float) -> tuple[Array, float]:
    """Means of the log range in intervals whose ends have a ratio, and its variance in each."""
    if not 0 < range_min < range_max:
        raise ValueError(f"range_min must be above 0 and below range_max, got {range_min:g} and {range_max:g}")
    count = math.ceil(math.log(range_max / range_min) / math.log(ratio))
    edges = np.linspace(math.log(range_min), math.log(range_max), count + 1)
    return (edges[1:] + edges[:-1]) / 2, float(edges[1] - edges[0]) ** 2 / 12


def single_start(origin: Array, mean: Array, cov: Array) -> BearingEkf:
    """A start at a guessed position (2,) with its covariance (2, 2), as in Shin et al.'s simulation."""
    dx, dy = mean - origin
    squared = float(dx * dx + dy * dy)
    J = np.array([[dx, dy], [-dy, dx]]) / squared
    return BearingEkf(origin, np.array([[math.log(squared) / 2, math.atan2(dy, dx)]]), (J @ cov @ J.T)[None])


def clear(line: complex, shift: complex) -> complex:
    """The shift, but for a source that would come to lie at the observer itself."""
    return shift if abs(line + shift) > NEAREST else NEAREST - line


def _member(mean: Array, cov: Array, log_weight: float) -> Member:
    ranges, bearings, mixed = float(cov[0, 0]), float(cov[1, 1]), float(cov[0, 1])
    line = cmath.exp(complex(mean[0], mean[1]))
    return line, ranges + bearings, complex(ranges - bearings, 2 * mixed), log_weight


def _normalised(members: list[Member]) -> list[Member]:
    """Weights that sum to one; the least likely members are dropped."""
    if len(members) == 1:
        return [(*members[0][:3], 0.0)]
    best = max(member[3] for member in members)
    kept = [member for member in members if member[3] > best + PRUNED]
    total = best + math.log(sum(math.exp(member[3] - best) for member in kept))
    return [(p, g, q, w - total) for p, g, q, w in kept]


def _columns(
    members: Iterable[Member],
) -> tuple[tuple[complex, ...], tuple[float, ...], tuple[complex, ...], list[float]]:
    line, g, q, log_weight = zip(*members, strict=True)
    return line, g, q, [math.exp(w) for w in log_weight]


_RATIO = 1.6  # of neighbouring ranges
PRUNED = math.log(1e-4)  # log weight relative to the heaviest
NEAREST = 1e-6  # m
