"""Where bearing lines meet (Shin et al. 2013, eq. 1-2), for any number of lines from any points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..geometry import wrap_angles
from ..types import Array


class Ray(NamedTuple):
    """A bearing line in a fixed frame. `weight` is its share of an independent bearing, in (0, 1]."""

    x: float  # m, where it was heard
    y: float
    bearing: float  # rad, absolute
    std: float  # rad
    weight: float = 1.0


class Drift(NamedTuple):
    """What the vehicle's heading has drifted since the last bearing: everything turns about the vehicle."""

    x: float = 0.0  # m, where the vehicle is
    y: float = 0.0
    variance: float = 0.0  # rad^2


class PlanarFix(NamedTuple):
    """A position (2,) with its covariance (2, 2)."""

    mean: Array
    cov: Array


def intersect(origins: Array, bearings: Array, variances: Array) -> PlanarFix | None:
    """Where lines from `origins` (n, 2) meet (`nearest`); None when they are parallel within their noise.

    Parallel means: the range is uncertain by more than half of itself, or the lines meet behind the observer. Whether
    they all meet there, `fits` decides.
    """
    fix = nearest(origins, bearings, variances)
    return fix if fix is not None and meet(fix, origins, bearings) else None


def nearest(origins: Array, bearings: Array, variances: Array) -> PlanarFix | None:
    """The maximum-likelihood point of bearing lines, however uncertain; None only when it is not determined at all.

    Least squares of the distances across the lines is Shin et al. eq. 1-2 for two lines and is drawn towards the
    observer when there are many noisy ones, so Gauss-Newton steps on the angles follow, from the likeliest of that
    point and some along the mean direction.
    """
    starts = _starts(origins, bearings, variances)
    costs = np.square(_errors(starts, origins, bearings)) @ (1 / variances)
    point, information = starts[int(np.argmin(costs))], np.zeros((2, 2))
    for _ in range(_ITERATIONS):
        step = _gauss_newton(point, origins, bearings, variances)
        if step is None:
            return None
        point, information = step
    columns = [_solved(information, unit) for unit in np.eye(2)]
    if columns[0] is None or columns[1] is None:
        return None
    cov = np.stack([columns[0], columns[1]], axis=1)
    return PlanarFix(point, (cov + cov.T) / 2)


def meet(fix: PlanarFix, origins: Array, bearings: Array) -> bool:
    """Whether lines meet at a fix: before the observer, and sharply enough."""
    offset = fix.mean - origins
    toward = offset[:, 0] * np.cos(bearings) + offset[:, 1] * np.sin(bearings)
    reach = float(np.einsum("ij,ij->i", offset, offset).max())
    return bool(np.median(toward) > 0 and 0 <= np.linalg.eigvalsh(fix.cov)[1] <= _PARALLEL**2 * reach)


def residuals(point: Array, origins: Array, bearings: Array) -> Array:
    """(n,) errors in rad of bearings of a point (2,)."""
    return np.asarray(_errors(point[None], origins, bearings)[0])


def fits(cost: float, lines: int) -> bool:
    """Whether a sum of squared residuals, each over its variance, is within five sigma of what noise makes it."""
    freedom = max(lines - 2, 1)
    return cost <= freedom + 5 * math.sqrt(2 * freedom)


class Triangulation:
    """The meeting point of all bearings so far. When `capacity` lines are held, neighbours are averaged in pairs, and
    from then on as many new bearings make a line: the memory is bounded, and the whole baseline is kept.
    """

    def __init__(self, ray: Ray, capacity: int) -> None:
        if capacity < 4 or capacity % 2:
            raise ValueError(f"capacity must be an even number of at least 4 lines, got {capacity}")
        self._lines = np.empty((capacity, 4))  # x, y, bearing, variance
        self._count = 0
        self._rays = self._last = 1  # in each line, in the last one
        self._fix: PlanarFix | None = None
        self.update(ray)

    def predict(self, duration: float, drift: Drift) -> None:
        """Nothing: a line stays where it was drawn."""

    def update(self, ray: Ray) -> None:
        self._remember(np.array([ray.x, ray.y, ray.bearing, ray.std**2 / ray.weight]))
        lines = self._lines[: self._count]
        fix = intersect(lines[:, :2], lines[:, 2], lines[:, 3])
        if fix is not None:
            cost = float(np.square(residuals(fix.mean, lines[:, :2], lines[:, 2])) @ (1 / lines[:, 3]))
            fix = fix if fits(cost, self._count) else None
        self._fix = fix

    def _remember(self, line: Array) -> None:
        if self._last < self._rays:
            self._lines[self._count - 1] = merged_pairs(np.stack([self._lines[self._count - 1], line]))[0]
            self._last += 1
            return
        if self._count == len(self._lines):
            self._count //= 2
            self._lines[: self._count] = merged_pairs(self._lines)
            self._rays *= 2
        self._lines[self._count] = line
        self._count += 1
        self._last = 1

    def predicted_bearing(self, x: float, y: float) -> tuple[float, float]:
        """Absolute bearing of the source from a point, and its variance: the last line's until lines meet."""
        if self._fix is None:
            return float(self._lines[self._count - 1, 2]), NOT_PREDICTED
        dx, dy = self._fix.mean - (x, y)
        range_squared = float(dx * dx + dy * dy) + _TINY
        across = np.array([-dy, dx]) / range_squared
        return math.atan2(dy, dx), float(across @ self._fix.cov @ across)

    def estimate(self) -> PlanarFix | None:
        """The fix; None while the lines are parallel within their noise, or do not all meet."""
        return self._fix


def merged_pairs(lines: Array) -> Array:
    """Neighbouring lines averaged in pairs, weighted by their information: (n, k) to (n / 2, k).

    Columns x, y, bearing, variance, and any more that may be averaged.
    """
    first, second = lines[::2], lines[1::2]
    share = first[:, 3] / (first[:, 3] + second[:, 3])  # of the second: weights are inverse variances
    apart = second - first
    apart[:, 2] = wrap_angles(apart[:, 2])
    merged = first + share[:, None] * apart
    merged[:, 3] = share * second[:, 3]
    return np.asarray(merged)


def _starts(origins: Array, bearings: Array, variances: Array) -> Array:
    """(m, 2) points to begin at."""
    direction = np.array([np.cos(bearings).mean(), np.sin(bearings).mean()])
    baseline = float(np.hypot(*(origins[-1] - origins[0]))) + float(np.ptp(origins, axis=0).max()) + _TINY
    along = origins[len(origins) // 2] + np.outer(baseline * np.geomspace(0.1, 100.0, 16), direction)
    normals = np.stack([-np.sin(bearings), np.cos(bearings)], axis=1)
    weighted = normals.T / variances
    linear = _solved(weighted @ normals, weighted @ np.einsum("ij,ij->i", normals, origins))
    return along if linear is None else np.vstack([linear, along])


def _errors(points: Array, origins: Array, bearings: Array) -> Array:
    """(m, n) bearing errors at m points."""
    dx, dy = points[:, :1] - origins[:, 0], points[:, 1:] - origins[:, 1]
    return wrap_angles(bearings - np.arctan2(dy, dx))


def _gauss_newton(point: Array, origins: Array, bearings: Array, variances: Array) -> tuple[Array, Array] | None:
    offset = point - origins
    range_squared = np.einsum("ij,ij->i", offset, offset) + _TINY
    jacobian = np.stack([-offset[:, 1], offset[:, 0]], axis=1) / range_squared[:, None]
    weighted = jacobian.T / variances
    information = weighted @ jacobian
    damping = 4 / float(range_squared.max()) * np.eye(2)  # a step beyond half the range leaves what the Jacobian knows
    step = _solved(information + damping, weighted @ _errors(point[None], origins, bearings)[0])
    return None if step is None else (point + step, information)


def _solved(matrix: Array, vector: Array) -> Array | None:
    """The solution of a (2, 2) system; None when it is singular to working precision."""
    determinant = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    if not determinant > _SINGULAR * (matrix[0, 0] + matrix[1, 1]) ** 2:
        return None
    x = (matrix[1, 1] * vector[0] - matrix[0, 1] * vector[1]) / determinant
    y = (matrix[0, 0] * vector[1] - matrix[1, 0] * vector[0]) / determinant
    return np.array([x, y])


_ITERATIONS = 6
_PARALLEL = 0.5  # std of the range, as a share of it
_SINGULAR = 1e-12
_TINY = 1e-12
NOT_PREDICTED = math.pi**2 / 3  # variance of a direction that is not known at all
