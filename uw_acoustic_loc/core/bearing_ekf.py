"""Bearing-only EKF of a still source (Shin et al. 2013, eq. 3-12), started as a bank over the range."""

from __future__ import annotations

import math

import numpy as np

from .geometry import wrap_angle, wrap_angles
from .triangulation import Fix, Ray
from .types import Array


class BearingEkf:
    """A Gaussian mixture of source positions, each member an EKF, weighted by its likelihood.

    The state is the source's position itself. With known motion this is eq. 3-12: their relative position is the
    source minus the vehicle, and their travelled distance is given. `process_noise` (m per sqrt(s)) is how fast the
    position may wander in the frame.
    """

    def __init__(self, means: Array, covs: Array, process_noise: float = 0.0) -> None:
        """Members `means` (K, 2), `covs` (K, 2, 2), of equal weight."""
        if means.ndim != 2 or means.shape[1] != 2 or covs.shape != (len(means), 2, 2):
            raise ValueError(f"means must be (K, 2) and covs (K, 2, 2), got {means.shape} and {covs.shape}")
        self._x, self._y = means[:, 0].astype(float), means[:, 1].astype(float)
        self._pxx, self._pxy, self._pyy = (covs[:, i, j].astype(float) for i, j in ((0, 0), (0, 1), (1, 1)))
        self._log_weight = np.full(len(means), -math.log(len(means)))
        self._process_noise = process_noise

    def predict(self, duration: float) -> None:
        """Lets the position wander for a duration in s."""
        self._pxx = self._pxx + self._process_noise**2 * duration
        self._pyy = self._pyy + self._process_noise**2 * duration

    def update(self, ray: Ray) -> None:
        """Corrects every member and its weight (eq. 8-12); a correlated bearing counts with its share."""
        predicted, hx, hy = self._bearing(ray.x, ray.y)
        error = wrap_angles(ray.bearing - predicted)
        gx, gy = self._pxx * hx + self._pxy * hy, self._pxy * hx + self._pyy * hy
        S = hx * gx + hy * gy + ray.std**2 / ray.weight
        self._x, self._y = self._x + gx / S * error, self._y + gy / S * error
        self._pxx, self._pxy, self._pyy = self._pxx - gx * gx / S, self._pxy - gx * gy / S, self._pyy - gy * gy / S
        self._reweigh(self._log_weight - 0.5 * (error * error / S + np.log(S)))

    def predicted_bearing(self, x: float, y: float) -> tuple[float, float]:
        """Absolute bearing of the source from a point, and its variance."""
        predicted, hx, hy = self._bearing(x, y)
        weight = np.exp(self._log_weight)
        centre = predicted[int(np.argmax(weight))]
        spread = wrap_angles(predicted - centre)
        mean = float(weight @ spread)
        variance = hx * hx * self._pxx + 2 * hx * hy * self._pxy + hy * hy * self._pyy
        return wrap_angle(centre + mean), float(weight @ (variance + (spread - mean) ** 2))

    def estimate(self) -> Fix:
        """Mean and covariance of the mixture."""
        weight = np.exp(self._log_weight)
        mean = np.array([weight @ self._x, weight @ self._y])
        dx, dy = self._x - mean[0], self._y - mean[1]
        xy = weight @ (self._pxy + dx * dy)
        return Fix(mean, np.array([[weight @ (self._pxx + dx * dx), xy], [xy, weight @ (self._pyy + dy * dy)]]))

    @property
    def members(self) -> int:
        """How many range hypotheses live."""
        return self._x.size

    def _bearing(self, x: float, y: float) -> tuple[Array, Array, Array]:
        """Bearing of every member and its Jacobian."""
        dx, dy = self._x - x, self._y - y
        range_squared = dx * dx + dy * dy + 1e-12
        return np.arctan2(dy, dx), -dy / range_squared, dx / range_squared

    def _reweigh(self, log_weight: Array) -> None:
        log_weight = log_weight - log_weight.max()
        keep = log_weight > _PRUNED
        if not keep.all():
            for name in ("_x", "_y", "_pxx", "_pxy", "_pyy"):
                setattr(self, name, getattr(self, name)[keep])
            log_weight = log_weight[keep]
        self._log_weight = log_weight - math.log(float(np.exp(log_weight).sum()))


def range_bank(ray: Ray, range_min: float, range_max: float, process_noise: float = 0.0) -> BearingEkf:
    """A start from one bearing: members along it in geometric progression (Peach 1995), equally likely.

    Each interval of ratio q has the mean and standard deviation of a uniform range in it.
    """
    if not 0 < range_min < range_max:
        raise ValueError(f"range_min must be above 0 and below range_max, got {range_min:g} and {range_max:g}")
    count = math.ceil(math.log(range_max / range_min) / math.log(_RATIO))
    edges = np.geomspace(range_min, range_max, count + 1)
    ranges, along = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / math.sqrt(12)
    across = ranges * ray.std / math.sqrt(ray.weight)
    direction = np.array([math.cos(ray.bearing), math.sin(ray.bearing)])
    normal = np.array([-direction[1], direction[0]])
    covs = np.multiply.outer(along**2, np.outer(direction, direction))
    covs += np.multiply.outer(across**2, np.outer(normal, normal))
    return BearingEkf(np.array([ray.x, ray.y]) + np.outer(ranges, direction), covs, process_noise)


_RATIO = 1.6  # of neighbouring ranges: a member's range is then uncertain by 13 %, which the Jacobian can bear
_PRUNED = math.log(1e-4)  # relative to the heaviest
