"""One estimator that believes in one side of the array, held within what its prior allows."""

from __future__ import annotations

import math

import numpy as np

from ..geometry import wrap_angle
from .bearing_ekf import BearingEkf, range_bank
from .bearing_ekf_moving import MovingBearingEkf
from .config import LocalizerConfig
from .particles import BearingParticles
from .triangulation import NOT_PREDICTED, Drift, PlanarFix, Ray, Triangulation

Estimator = Triangulation | BearingEkf | MovingBearingEkf | BearingParticles


class Hypothesis:
    """One estimator that believes in one side at its start.

    From then on it takes of a bearing and its mirror image the one that it predicts (`image_error`), so that a source
    may pass the array's axis; where its prediction cannot tell them apart, or both fit, it stays with the image that it
    took last.
    """

    def __init__(self, ray: Ray, config: LocalizerConfig, rng: np.random.Generator, image: int = 0) -> None:
        self.estimator = _estimator(ray, config, rng)
        self._config, self._start, self._age = config, np.array([ray.x, ray.y]), 0.0
        self._found = self.estimator.estimate()
        self._image = image
        self.log_evidence = 0.0
        self.nis = 0.0
        self.unused = 0  # bearings in a row beyond the gate

    def update(self, rays: list[Ray], duration: float, drift: Drift, gate_sigma: float) -> None:
        self.estimator.predict(duration, drift)
        self._age += duration
        predicted, variance = self.estimator.predicted_bearing(rays[0].x, rays[0].y)
        std, weight = rays[0].std, rays[0].weight
        errors = [wrap_angle(ray.bearing - predicted) for ray in rays]
        error, spread = self._image_error(errors, std, variance)
        self.log_evidence += log_evidence(error, variance + (std**2 + spread) / weight)
        self.nis = error * error / (variance + std**2 + spread)
        self.unused = 0 if self.nis <= gate_sigma**2 else self.unused + 1
        if self.unused == 0:
            bearing = wrap_angle(predicted + error)
            self.estimator.update(Ray(rays[0].x, rays[0].y, bearing, math.sqrt(std**2 + spread), weight))

        self._found = self.estimator.estimate()

    def _image_error(self, errors: list[float], std: float, variance: float) -> tuple[float, float]:
        """Innovation, and the variance that doubt about the image adds; a mean of both would be drawn to the axis."""
        if len(errors) == 1:
            return errors[0], 0.0
        own, other = errors[self._image], errors[1 - self._image]
        if variance >= NOT_PREDICTED:  # no prediction that could doubt the side
            return own, 0.0
        apart = (own - other) ** 2
        if apart < _TOLD_APART**2 * (variance + std**2):
            share = 1.0 / (1.0 + math.exp(max(-700.0, min(700.0, 0.5 * (other**2 - own**2) / (variance + std**2)))))
            return own, share * (1.0 - share) * apart
        if abs(own) > abs(other):
            if own**2 <= _SURE**2 * (variance + std**2):
                return own, 0.0
            self._image = 1 - self._image
        return image_error(errors, std)

    @property
    def fix(self) -> PlanarFix | None:
        """The estimate; None while there is none within what the prior allows."""
        return self._found if self._found is not None and self._allowed(self._found) else None

    @property
    def lost(self) -> str:
        """Why the estimator has to restart; empty when it need not."""
        if isinstance(self.estimator, Triangulation):
            return ""  # its lines may meet again
        if self._found is not None and not self._allowed(self._found):
            return "its estimate left what range_max, source_speed_std and process_noise allow"
        waiting = 0 if isinstance(self.estimator, BearingParticles) else self.estimator.waiting
        return "the vehicle is nearer to it than its range is known" if waiting >= self._config.reset_after else ""

    def _allowed(self, fix: PlanarFix) -> bool:
        """Whether mean and standard deviation lie within the farthest that the source can have come."""
        config, age = self._config, self._age
        reach = config.range_max + _SURE * (config.source_speed_std * age + config.process_noise * math.sqrt(age))
        variance = float(fix.cov[0, 0] + fix.cov[1, 1])
        return math.dist(fix.mean, self._start) <= reach and 0 <= variance <= reach**2


def image_error(errors: list[float], std: float) -> tuple[float, float]:
    """Innovation of a bearing that may be its own mirror image, and the variance that the doubt adds.

    Mean and variance over the images, weighted by their likelihood, a prediction being as good as a bearing. Far from
    the array's axis the nearer image has all the weight; on the axis, taking the nearer one would draw the source to
    the side where it is believed.
    """
    if len(errors) == 1:
        return errors[0], 0.0
    near, far = sorted(errors, key=abs)
    odds = math.exp(0.25 * (near * near - far * far) / std**2)
    share = odds / (1.0 + odds)
    return near + share * (far - near), share * (1.0 - share) * (far - near) ** 2


def _estimator(ray: Ray, config: LocalizerConfig, rng: np.random.Generator) -> Estimator:
    if config.method == "triangulation":
        return Triangulation(ray, config.lines)
    limits, wander, noise = (config.range_min, config.range_max), config.process_noise, config.bearing_noise
    if config.source_speed_std:
        return MovingBearingEkf(ray, *limits, speed_std=config.source_speed_std, process_noise=wander, noise=noise)
    if config.method == "ekf":
        return range_bank(ray, *limits, wander, noise)
    return BearingParticles(ray, *limits, particles=config.particles, noise=noise, rng=rng, process_noise=wander)


def log_evidence(error: float, variance: float) -> float:
    """Log density of an innovation, one bearing in twenty being a direction at random: no outlier decides alone."""
    normal = math.exp(-0.5 * error * error / variance) / math.sqrt(2 * math.pi * variance)
    return math.log((1 - _OUTLIERS) * normal + _OUTLIERS / (2 * math.pi))


_OUTLIERS = 0.05
_TOLD_APART = 2.0  # standard deviations of the innovation between images of which one is decisively nearer
_SURE = 4.0  # standard deviations of what a source may have moved
