"""Bearing-only particle filter of a still source (Shin et al. 2013, section III.3) with the sensor's own likelihood."""

from __future__ import annotations

import math

import numpy as np

from ..geometry import wrap_angle, wrap_angles
from ..types import Array
from .bearing_noise import draw_errors, log_likelihood
from .triangulation import Drift, PlanarFix, Ray


class BearingParticles:
    """Weighted positions, started from one bearing, uniform in area over a range interval.

    Resampled when the effective sample size falls below half, then spread again, in bearing and log range from the
    first point, where the posterior of a far source is a plain box and not a wedge. While the bearings so far are few
    enough to be remembered, by Metropolis steps on their posterior (Gilks, Berzuini 2001): the few particles that
    happen to lie near the source grow into an exact cloud. Later by a kernel (Musso, Oudjane, Le Gland 2001), the
    cloud being shrunk by as much as the kernel widens it (Liu, West 2001).
    """

    def __init__(
        self,
        ray: Ray,
        range_min: float,
        range_max: float,
        *,
        particles: int,
        noise: str,
        rng: np.random.Generator,
        process_noise: float = 0.0,
    ) -> None:
        if not 0 < range_min < range_max:
            raise ValueError(f"range_min must be above 0 and below range_max, got {range_min:g} and {range_max:g}")
        self._noise, self._rng, self._process_noise = noise, rng, process_noise
        self._origin, self._limits = np.array([[ray.x], [ray.y]]), (range_min, range_max)
        self._rays, self._ages = [ray], [(0.0, 0.0)]
        stratum = (np.arange(particles) + rng.random(particles)) / particles
        ranges = np.sqrt(range_min**2 + stratum * (range_max**2 - range_min**2))
        angles = ray.bearing + draw_errors(noise, ray.std, particles, rng)
        self._xy = self._origin + ranges * np.stack([np.cos(angles), np.sin(angles)])
        self._log_weight = np.full(particles, -math.log(particles))

    def predict(self, duration: float, drift: Drift) -> None:
        """Lets every particle wander for a duration in s, and turn about the vehicle."""
        self._ages = [(age + duration, turned + drift.variance) for age, turned in self._ages]
        if self._process_noise:
            self._xy = self._xy + self._rng.normal(0, self._process_noise * math.sqrt(duration), self._xy.shape)
        if drift.variance:
            turn = self._rng.normal(0, math.sqrt(drift.variance), self._log_weight.size)
            dx, dy = self._xy[0] - drift.x, self._xy[1] - drift.y
            c, s = np.cos(turn), np.sin(turn)
            self._xy = np.stack([drift.x + c * dx - s * dy, drift.y + s * dx + c * dy])

    def update(self, ray: Ray) -> None:
        """Weights by nearness to the bearing; a correlated bearing's log-likelihood counts with its share."""
        self._rays.append(ray)
        self._ages.append((0.0, 0.0))
        log_weight = self._log_weight + self._log_likelihood(self._xy, ray, (0.0, 0.0))
        log_weight -= log_weight.max()
        self._log_weight = log_weight - math.log(float(np.exp(log_weight).sum()))
        if self.ess < self._log_weight.size / 2:
            self._resample()
            if len(self._rays) <= _REMEMBERED:
                self._move()
            else:
                self._regularise()
        del self._rays[_REMEMBERED + 1 :], self._ages[_REMEMBERED + 1 :]

    def predicted_bearing(self, x: float, y: float) -> tuple[float, float]:
        """Absolute bearing of the source from a point, and its variance."""
        bearings = np.arctan2(self._xy[1] - y, self._xy[0] - x)
        weight = np.exp(self._log_weight)
        centre = math.atan2(float(weight @ np.sin(bearings)), float(weight @ np.cos(bearings)))
        spread = wrap_angles(bearings - centre)
        mean = float(weight @ spread)
        return wrap_angle(centre + mean), float(weight @ (spread - mean) ** 2)

    def estimate(self) -> PlanarFix:
        """The point of least relative error, seen from the first point, and the mean square about it."""
        return least_relative_error(self._xy, np.exp(self._log_weight), self._origin, self._limits[0])

    @property
    def ess(self) -> float:
        """Effective sample size."""
        return 1.0 / float(np.exp(2 * self._log_weight).sum())

    def cloud(self, count: int) -> tuple[Array, Array]:
        """At most `count` positions (2, m) and their weights, which sum to 1."""
        step = -(-self._log_weight.size // count)
        weight = np.exp(self._log_weight[::step])
        return self._xy[:, ::step], weight / weight.sum()

    def _resample(self) -> None:
        n = self._log_weight.size
        edges = np.floor(np.cumsum(np.exp(self._log_weight)) * n + self._rng.random())
        edges[-1] = n
        self._xy = np.repeat(self._xy, np.diff(edges.clip(0, n), prepend=0).astype(np.intp), axis=1)
        self._log_weight = np.full(n, -math.log(n))

    def _regularise(self) -> None:
        polar, heading = self._polar()
        mean, cov = _moments(polar, np.exp(self._log_weight))
        kernel = _root(cov) @ self._rng.standard_normal(polar.shape)
        polar = mean[:, None] + math.sqrt(1 - _BANDWIDTH**2) * (polar - mean[:, None]) + _BANDWIDTH * kernel
        self._xy = self._cartesian(polar, heading)

    def _move(self) -> None:
        polar, heading = self._polar()
        step = _root(_moments(polar, np.exp(self._log_weight))[1])
        log_target = self._log_posterior(polar, heading)
        for _ in range(_MOVES):
            proposed = polar + step @ self._rng.standard_normal(polar.shape)
            log_proposed = self._log_posterior(proposed, heading)
            accepted = np.log(self._rng.random(log_target.size)) < log_proposed - log_target
            polar, log_target = np.where(accepted, proposed, polar), np.where(accepted, log_proposed, log_target)
        self._xy = self._cartesian(polar, heading)

    def _log_posterior(self, polar: Array, heading: float) -> Array:
        """Of bearing and log range, given every remembered ray: uniform in area, so the prior is 2 log range."""
        low, high = (math.log(limit) for limit in self._limits)
        xy = self._cartesian(polar, heading)
        total = np.where((polar[1] >= low) & (polar[1] <= high), 2 * polar[1], _NEVER)
        for ray, age in zip(self._rays, self._ages, strict=True):
            total += self._log_likelihood(xy, ray, age)
        return total

    def _log_likelihood(self, xy: Array, ray: Ray, age: tuple[float, float]) -> Array:
        """A ray's; the source may have wandered and turned since, which widens the older ones."""
        dx, dy = xy[0] - ray.x, xy[1] - ray.y
        error = wrap_angles(ray.bearing - np.arctan2(dy, dx))
        wandered, turned = self._process_noise**2 * age[0], age[1]
        if wandered == turned == 0:
            return np.asarray(ray.weight * log_likelihood(self._noise, error, ray.std))
        std = np.sqrt(ray.std**2 + turned + wandered / (dx * dx + dy * dy + 1e-12))
        return np.asarray(ray.weight * (log_likelihood(self._noise, error, std) - np.log(std)))

    def _polar(self) -> tuple[Array, float]:
        """(2, n) bearing and log range from the first point, the bearing relative to the heading returned."""
        offset = self._xy - self._origin
        heading = math.atan2(*offset.mean(axis=1)[::-1])
        angle = wrap_angles(np.arctan2(offset[1], offset[0]) - heading)
        return np.stack([angle, np.log(np.hypot(*offset).clip(min=1e-6))]), heading

    def _cartesian(self, polar: Array, heading: float) -> Array:
        angle = polar[0] + heading
        return np.asarray(self._origin + np.exp(polar[1]) * np.stack([np.cos(angle), np.sin(angle)]))


def least_relative_error(points: Array, weight: Array, origin: Array, range_min: float = 0.0) -> PlanarFix:
    """The p that minimises E |s - p|^2 / |s - origin|^2, and E (s - p)(s - p)^T; points (2, n), origin (2, 1).

    While the range is open the mean would lie where the prior has its area, at its far end. Once it is known the two
    are the same. `range_min` keeps a particle that has wandered onto the origin from being the only one.
    """
    share = weight / np.square(points - origin).sum(axis=0).clip(min=range_min**2)
    best = points @ share / share.sum()
    off = points - best[:, None]
    return PlanarFix(best, (off * weight) @ off.T)


def _root(cov: Array) -> Array:
    """Cholesky factor, of a cloud that has shrunk to a line too."""
    return np.asarray(np.linalg.cholesky(cov + 1e-18 * np.eye(2)))


def _moments(points: Array, weight: Array) -> tuple[Array, Array]:
    mean = points @ weight
    centred = points - mean[:, None]
    return mean, (centred * weight) @ centred.T


_NEVER = -1e9  # finite: a source that has wandered out of the interval may come back
_BANDWIDTH = 0.2
_REMEMBERED = 150  # bearings
_MOVES = 2
