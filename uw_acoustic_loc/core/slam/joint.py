"""The joint Gaussian of EKF-SLAM: a vehicle and pingers that come and go, with the full covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry import wrap_angle
from ..localizer.triangulation import PlanarFix
from ..types import Array
from .inertial import SIZE, YAW


@dataclass(eq=False)
class Slot:
    """Where a pinger's x and y are in the joint state; moves up when one before it is removed."""

    start: int

    @property
    def part(self) -> slice:
        return slice(self.start, self.start + 2)


class Prediction(NamedTuple):
    """A predicted measurement: value, variance, and the covariance (n,) of the state with it."""

    value: float
    variance: float
    cross: Array


class Joint:
    """Mean (n,) and covariance (n, n) of the vehicle's 15 states and 2 for each pinger (Choi et al. 2016, eq. 6-10)."""

    def __init__(self, mean: Array, variances: Array) -> None:
        from scipy.linalg.blas import daxpy, dger  # noqa: PLC0415  slow to import

        if mean.shape != (SIZE,) or variances.shape != (SIZE,):
            raise ValueError(f"mean and variances must be ({SIZE},), got {mean.shape} and {variances.shape}")
        self.mean, self.cov = mean.copy(), np.diag(variances)
        self._slots: list[Slot] = []
        self._dger, self._daxpy = dger, daxpy

    def move(self, mean: Array, F: Array, driving: Array, added: Array) -> None:
        """Takes over the moved first k states: F (k, m) is their Jacobian with respect to the first m.

        In this step these m had white errors of variances `driving` (m,) besides, and the k gain `added` (k,).
        """
        k, m = F.shape
        rows = F.dot(self.cov[:m])
        corner = (rows[:, :m] + F * driving).dot(F.T)
        corner.reshape(-1)[:: k + 1] += added
        np.multiply(corner + corner.T, 0.5, out=rows[:, :k])
        self.cov[:k], self.cov[:, :k], self.mean[:k] = rows, rows.T, mean

    def widen(self, part: slice, variance: float) -> None:
        """Adds a variance to some states."""
        diagonal = self.cov.reshape(-1)[:: len(self.cov) + 1]
        diagonal[part] += variance

    def total(self, one: int, other: int) -> Prediction:
        """A measurement that is the sum of two states."""
        cross = self.cov[:, one] + self.cov[:, other]
        return Prediction(self.mean.item(one) + self.mean.item(other), cross.item(one) + cross.item(other), cross)

    def correct(self, prediction: Prediction, error: float, variance: float) -> None:
        """Kalman update by one scalar (eq. 13-15): one pass over the covariance, in place."""
        scale = (prediction.variance + variance) ** -0.5
        scaled = scale * prediction.cross
        self._dger(-1.0, scaled, scaled, a=self.cov.T, overwrite_a=1)  # BLAS wants columns contiguous: the transpose
        self._daxpy(scaled, self.mean, a=scale * error)  # in place, too

    def learn(self, states: list[int], information: Array, pull: Array) -> None:
        """Takes what a least-squares problem says of some states: half its Hessian, and half its gradient here."""
        strengths, directions = np.linalg.eigh(information)
        start = self.mean[states].copy()
        for strength, v in zip(strengths.tolist(), directions.T, strict=True):
            if strength > 1e-9 * strengths[-1]:
                cross = self.cov[:, states] @ v
                moved = float(v @ (self.mean[states] - start))
                prediction = Prediction(moved, float(v @ cross[states]), cross)
                self.correct(prediction, -float(v @ pull) / strength - moved, 1 / strength)

    def add(self, fix: PlanarFix, J: Array) -> Slot:
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
        get, yaw = cov.item, mean.item(YAW)  # indexing gives numpy scalars, which are slow
        c, s = math.cos(yaw), math.sin(yaw)
        ahead, left = offset.tolist()
        ox, oy = c * ahead - s * left, s * ahead + c * left
        dx, dy = mean.item(at) - mean.item(0) - ox, mean.item(at + 1) - mean.item(1) - oy
        yaws, x_yaw, y_yaw = get(YAW, YAW), get(at, YAW) - get(0, YAW), get(at + 1, YAW) - get(1, YAW)
        sxx = get(at, at) - 2 * get(at, 0) + get(0, 0) + oy * (2 * x_yaw + oy * yaws)
        syy = get(at + 1, at + 1) - 2 * get(at + 1, 1) + get(1, 1) - ox * (2 * y_yaw - ox * yaws)
        sxy = get(at + 1, at) - get(at, 1) - get(at + 1, 0) + get(1, 0) + oy * y_yaw - ox * (x_yaw + oy * yaws)
        deviation, (on_x, on_y), rest = regression(dx, dy, sxx, sxy, syy)
        turn = on_x * oy - on_y * ox - 1.0
        cross = np.array((-on_x, -on_y, 0.0, 0.0, 0.0, turn)).dot(cov[: YAW + 1])
        cross += np.array((on_x, on_y)).dot(cov[at : at + 2])
        get = cross.item
        explained = on_x * (get(at) - get(0)) + on_y * (get(at + 1) - get(1)) + turn * get(YAW)
        return Prediction(wrap_angle(math.atan2(dy, dx) + deviation - yaw), explained + rest, cross)

    def position(self, slot: Slot) -> PlanarFix:
        """A pinger's position with its covariance."""
        return PlanarFix(self.mean[slot.part].copy(), self.cov[slot.part, slot.part].copy())


def regression(x: float, y: float, sxx: float, sxy: float, syy: float) -> tuple[float, tuple[float, float], float]:
    """Statistical linearisation of atan2 for a vector with mean (x, y) and these variances and covariance.

    Returns the mean of the angle's deviation from the mean vector's, the slope, and the variance that the line leaves
    (Arasaratnam, Haykin, Elliott 2007, with 3 x 3 Gauss-Hermite points). At short or uncertain range the Jacobian at
    the mean would make an EKF overconfident and biased.
    """
    squared = x * x + y * y
    tiny = 1e-12 * squared + 1e-300
    a = math.sqrt(sxx + tiny)
    b = sxy / a
    c = math.sqrt(max(syy - b * b, 0.0) + tiny)  # Cholesky factor [[a, 0], [b, c]]
    along_p, across_p, along_q, across_q = x * a + y * b, x * b - y * a, y * c, x * c
    mean = square = on_p = on_q = 0.0
    for p, q, weight in _HERMITE:
        along, across = p * along_p + q * along_q, p * across_p + q * across_q
        here, opposite = math.atan2(across, squared + along), math.atan2(-across, squared - along)
        mean += weight * (here + opposite)
        square += weight * (here * here + opposite * opposite)
        lean = weight * (here - opposite)
        on_p += lean * p
        on_q += lean * q
    slope = (on_p - on_q * b / c) / a, on_q / c
    return mean, slope, max(square - mean * mean - on_p * on_p - on_q * on_q, 0.0)


_NODE = math.sqrt(3)  # of the third Hermite polynomial; its weights are 1/6, 2/3, 1/6
_HERMITE = (  # half of the nine points; the others are opposite, and the middle one adds nothing
    (_NODE, 0.0, 1 / 9),
    (0.0, _NODE, 1 / 9),
    (_NODE, _NODE, 1 / 36),
    (_NODE, -_NODE, 1 / 36),
)
