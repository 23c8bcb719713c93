"""Bearing-only EKF of a source with constant velocity, in modified polar coordinates, a bank over the range."""

from __future__ import annotations

import math

import numpy as np

from ..geometry import wrap_angle
from ..types import AnyArray, Array
from .bearing_ekf import NEAREST, PRUNED, range_intervals
from .bearing_noise import believed, log_any_direction
from .log_polar import Mixture, bearing_moments, cartesian, times_too_near
from .triangulation import Drift, PlanarFix, Ray


class MovingBearingEkf:
    """A Gaussian mixture over the range, each member an EKF of position and velocity, weighted by its likelihood.

    With p the offset from the observer and V the source's velocity as complex numbers, the state is (log p, V / p):
    modified polar coordinates (Aidala, Hammel 1983), but with the source's own velocity in place of the relative one,
    which was less honest after turns in our trials. Motion is complex-linear in the errors z, so these are held by
    G = E z z^H and Q = E z z^T, as in `log_polar`.
    The velocity is a priori normal with `speed_std` per axis; without a turn of the vehicle a moving source's range
    cannot be known, and the covariance says so.
    """

    def __init__(
        self,
        ray: Ray,
        range_min: float,
        range_max: float,
        *,
        speed_std: float,
        process_noise: float = 0.0,
        noise: str = "gaussian",
    ) -> None:
        log_ranges, variance = range_intervals(range_min, range_max, _RATIO)
        self._observer = complex(ray.x, ray.y)
        self._origin = np.full(log_ranges.size, self._observer)  # that each member is seen from
        self._line = np.exp(log_ranges + 1j * ray.bearing)
        self._rate = np.zeros(log_ranges.size, dtype=np.complex128)  # V / p
        self._duration = self._turn = 0.0  # s and rad^2 predicted since the last update
        bearing = ray.std**2 / ray.weight
        self._G = np.zeros((log_ranges.size, 2, 2), dtype=np.complex128)
        self._Q = self._G.copy()
        self._G[:, 0, 0], self._Q[:, 0, 0] = variance + bearing, variance - bearing
        self._G[:, 1, 1] = 2 * speed_std**2 * np.exp(-2 * log_ranges + 2 * variance)
        self._log_weight = np.full(log_ranges.size, -math.log(log_ranges.size))
        self._process_noise, self._noise = process_noise, noise
        self.waiting = 0  # updates in a row that no member could use

    def predict(self, duration: float, drift: Drift) -> None:
        """Lets the source move for a duration in s, wander, and turn about the vehicle with its velocity."""
        self._duration += duration
        self._turn += drift.variance

    def update(self, ray: Ray) -> None:
        """Corrects every member and its weight; a correlated bearing counts with its share."""
        self._move(complex(ray.x, ray.y))
        usable = self._origin == self._observer
        self.waiting = 0 if usable.any() else self.waiting + 1
        k = 0.5j * (self._G[:, :, 0] - self._Q[:, :, 0])  # cov(z, bearing)
        predicted, variance = k[:, 0].imag, ray.std**2 / ray.weight
        error = np.angle(np.exp(1j * ray.bearing) * self._line.conj())
        S, counted = predicted + ray.std**2, predicted + variance
        trust, log_likelihood = believed(self._noise, error, S, counted)
        scaled = np.where(usable, 1.0 / (predicted + variance / trust), 0.0)[:, None] * k
        self._line = self._line * np.exp(scaled[:, 0] * error)
        self._rate = self._rate + scaled[:, 1] * error
        self._G = self._G - scaled[:, :, None] * k.conj()[:, None, :]
        self._Q = self._Q - scaled[:, :, None] * k[:, None, :]
        self._reweigh(self._log_weight + np.where(usable, log_likelihood, log_any_direction(self._noise)))

    def predicted_bearing(self, x: float, y: float) -> tuple[float, float]:
        """Absolute bearing of the source from a point, and its variance."""
        line, _, G, Q = self._moved(complex(x, y))
        mean, variance = bearing_moments(self._mixture(line, G, Q))
        return wrap_angle(mean), variance

    def estimate(self) -> PlanarFix:
        """Mean and covariance of the mixture's position in x and y."""
        mixture = self._mixture(self._line, self._G, self._Q)
        return cartesian(mixture, (self._origin - self._observer).tolist(), self._observer)

    @property
    def velocity(self) -> Array:
        """(2,) mean velocity in m/s, to first order."""
        mean = complex(self._weight @ (self._line * self._rate))
        return np.array([mean.real, mean.imag])

    @property
    def _weight(self) -> Array:
        return np.asarray(np.exp(self._log_weight))

    def _mixture(self, line: AnyArray, G: AnyArray, Q: AnyArray) -> Mixture:
        """Of the position alone."""
        g, q = G[:, 0, 0].real.tolist(), Q[:, 0, 0].tolist()
        return Mixture(self._weight.tolist(), line.tolist(), g, q)

    def _move(self, point: complex) -> None:
        """To the observer's new place, or as far from there as each member's error asks for."""
        self._line, self._rate, self._G, self._Q = self._moved(point)
        self._observer, self._duration, self._turn = point, 0.0, 0.0
        times = times_too_near(self._G[:, 0, 0].real, self._Q[:, 0, 0]).clip(min=1.0)
        back = (times - 1) * self._line
        self._origin = point - back
        if back.any():
            self._line, self._rate, self._G, self._Q = self._moved_by(back, 0.0)

    def _moved(self, point: complex) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
        """Lines, rates and errors when the time has passed and the vehicle has come to a point."""
        return self._moved_by(self._origin - point, self._duration)

    def _moved_by(self, shift: AnyArray, duration: float) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
        stretch = 1 + self._rate * duration
        line = self._line * stretch + shift
        line = np.where(np.abs(line) < NEAREST, NEAREST, line)
        c = self._line / line
        M = np.empty_like(self._G)
        M[:, 0, 0], M[:, 0, 1] = c * stretch, c * duration
        M[:, 1, 0], M[:, 1, 1] = c * self._rate * (1 - M[:, 0, 0]), c - c * self._rate * M[:, 0, 1]
        G = M @ self._G @ M.conj().swapaxes(1, 2)
        Q = M @ self._Q @ M.swapaxes(1, 2)
        G[:, 0, 0] += 2 * self._process_noise**2 * duration / np.abs(line) ** 2 + self._turn
        Q[:, 0, 0] -= self._turn
        return line, c * self._rate, G, Q

    def _reweigh(self, log_weight: Array) -> None:
        log_weight = log_weight - log_weight.max()
        keep = log_weight > PRUNED
        self._line, self._rate, self._G, self._Q, self._origin = (
            column[keep] for column in (self._line, self._rate, self._G, self._Q, self._origin)
        )
        self._log_weight = log_weight[keep] - math.log(float(np.exp(log_weight[keep]).sum()))


_RATIO = 1.2  # of neighbouring ranges
