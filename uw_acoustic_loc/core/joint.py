"""The joint Gaussian of EKF-SLAM: a vehicle and pingers that come and go, with the full covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .geometry import wrap_angle
from .inertial import SIZE, YAW
from .triangulation import Fix
from .types import Array


@dataclass(eq=False)
class Slot:
    """Where a pinger's x and y are in the joint state; moves up when one before it is removed."""

    start: int

    @property
    def part(self) -> slice:
        return slice(self.start, self.start + 2)


@dataclass(frozen=True, eq=False)
class Prediction:
    """A predicted measurement: value, variance, and the covariance (n,) of the state with it."""

    value: float
    variance: float
    cross: Array


class Joint:
    """Mean (n,) and covariance (n, n) of the vehicle's 15 states and 2 for each pinger (Choi et al. 2016, eq. 6-10)."""

    def __init__(self, mean: Array, variances: Array) -> None:
        from scipy.linalg.blas import dger  # noqa: PLC0415  slow to import

        if mean.shape != (SIZE,) or variances.shape != (SIZE,):
            raise ValueError(f"mean and variances must be ({SIZE},), got {mean.shape} and {variances.shape}")
        self.mean, self.cov = mean.copy(), np.diag(variances)
        self._slots: list[Slot] = []
        self._dger = dger

    def move(self, mean: Array, F: Array, Q: Array) -> None:
        """Takes over the moved first k states: F (k, m) their Jacobian with respect to the first m, Q (k, k)."""
        k, m = F.shape
        rows = F @ self.cov[:m]
        corner = rows[:, :m] @ F.T + Q
        self.cov[:k], self.cov[:, :k] = rows, rows.T
        self.cov[:k, :k] = (corner + corner.T) / 2
        self.mean[:k] = mean

    def widen(self, part: slice, variance: float) -> None:
        """Adds a variance to some states."""
        k = np.arange(part.start, part.stop)
        self.cov[k, k] += variance

    def predict(self, value: float, columns: list[int], H: Array) -> Prediction:
        """A measurement whose Jacobian is H in `columns` and 0 elsewhere."""
        cross = self.cov[:, columns] @ H
        return Prediction(value, float(H @ cross[columns]), cross)

    def correct(self, prediction: Prediction, error: float, variance: float) -> None:
        """Kalman update by one scalar (eq. 13-15): one pass over the covariance, in place."""
        scale = (prediction.variance + variance) ** -0.5
        scaled = scale * prediction.cross
        self._dger(-1.0, scaled, scaled, a=self.cov.T, overwrite_a=1)  # BLAS wants columns contiguous: the transpose
        self.mean += (scale * error) * scaled

    def add(self, fix: Fix, J: Array) -> Slot:
        """A new pinger whose error is J (2, 15) times the vehicle's, plus one of its own with the fix's covariance."""
        n = self.mean.size
        rows = J @ self.cov[:SIZE]
        cov = np.empty((n + 2, n + 2))
        cov[:n, :n], cov[n:, :n], cov[:n, n:] = self.cov, rows, rows.T
        corner = rows[:, :SIZE] @ J.T + fix.cov
        cov[n:, n:] = (corner + corner.T) / 2
        self.cov, self.mean = cov, np.append(self.mean, fix.mean)
        self._slots.append(Slot(n))
        return self._slots[-1]

    def remove(self, slot: Slot) -> None:
        """Forgets a pinger."""
        self.mean = np.delete(self.mean, slot.part)
        self.cov = np.delete(np.delete(self.cov, slot.part, axis=0), slot.part, axis=1)
        self._slots.remove(slot)
        for other in self._slots:
            other.start -= 2 * (other.start > slot.start)

    def bearing(self, slot: Slot, offset: Array) -> Prediction:
        """Bearing of a pinger in the vehicle's frame (eq. 12), heard by an array at `offset`."""
        mean, cov, at = self.mean, self.cov, slot.start
        yaw = float(mean[YAW])
        c, s = math.cos(yaw), math.sin(yaw)
        ox, oy = c * float(offset[0]) - s * float(offset[1]), s * float(offset[0]) + c * float(offset[1])

        def apart(v: Array) -> tuple[float, float]:
            """The Jacobian of (dx, dy) times v (n,)."""
            get = v.item  # indexing gives numpy scalars, which are slow
            return get(at) - get(0) + oy * get(YAW), get(at + 1) - get(1) - ox * get(YAW)

        dx, dy = mean.item(at) - mean.item(0) - ox, mean.item(at + 1) - mean.item(1) - oy
        by_x, by_y = cov[at] - cov[0] + oy * cov[YAW], cov[at + 1] - cov[1] - ox * cov[YAW]
        deviation, (on_x, on_y), rest = regression(dx, dy, *apart(by_x), apart(by_y)[1])
        cross = on_x * by_x + on_y * by_y - cov[YAW]
        east, north = apart(cross)
        value = wrap_angle(math.atan2(dy, dx) + deviation - yaw)
        return Prediction(value, on_x * east + on_y * north - cross.item(YAW) + rest, cross)

    def position(self, slot: Slot) -> Fix:
        """A pinger's position with its covariance."""
        return Fix(self.mean[slot.part].copy(), self.cov[slot.part, slot.part].copy())


def regression(x: float, y: float, sxx: float, sxy: float, syy: float) -> tuple[float, tuple[float, float], float]:
    """Statistical linearisation of atan2 for a vector with mean (x, y) and these variances and covariance.

    Returns the mean of the angle's deviation from the mean vector's, the slope, and the variance that the line leaves
    (Arasaratnam, Haykin, Elliott 2007, with 3 x 3 Gauss-Hermite points). At short or uncertain range the Jacobian at
    the mean would make an EKF overconfident and biased.
    """
    tiny = 1e-12 * (x * x + y * y) + 1e-300
    a = math.sqrt(sxx + tiny)
    b = sxy / a
    c = math.sqrt(max(syy - b * b, 0.0) + tiny)  # Cholesky factor [[a, 0], [b, c]]
    mean = square = on_p = on_q = 0.0
    for p, q, weight in _HERMITE:
        px, py = x + a * p, y + b * p + c * q
        angle = math.atan2(x * py - y * px, x * px + y * py)
        mean += weight * angle
        square += weight * angle * angle
        on_p += weight * angle * p
        on_q += weight * angle * q
    slope = (on_p - on_q * b / c) / a, on_q / c
    return mean, slope, max(square - mean * mean - on_p * on_p - on_q * on_q, 0.0)


_HERMITE = tuple(
    (p, q, wp * wq)
    for p, wp in ((-math.sqrt(3), 1 / 6), (0.0, 2 / 3), (math.sqrt(3), 1 / 6))
    for q, wq in ((-math.sqrt(3), 1 / 6), (0.0, 2 / 3), (math.sqrt(3), 1 / 6))
)
