"""Where one source is, from bearings and known motion, with both sides of the array as hypotheses."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from ...config import param
from ..geometry import mirror_bearing, wrap_angle
from ..pose_history import RESET_MOVE
from .bearing_ekf import BearingEkf, range_bank
from .bearing_ekf_moving import MovingBearingEkf
from .bearing_noise import NOISES
from .particles import BearingParticles
from .triangulation import Drift, PlanarFix, Ray, Triangulation

Estimator = Triangulation | BearingEkf | MovingBearingEkf | BearingParticles


@dataclass(frozen=True)
class LocalizerConfig:
    """Parameters of the bearing localizer."""

    source_ids: tuple[str, ...] = param(doc="the sources to locate, each with its topic sources/<id>/bearing")
    method: str = param("ekf", choices=("triangulation", "ekf", "particle_filter"))
    bearing_noise: str = param(
        "mixture", choices=NOISES, doc="of ekf and particle_filter; an ekf takes uniform for gaussian"
    )
    bearing_std: float = param(0.0, unit="rad", low=0, high=3, changeable=True, doc="0 = the message's own variance")
    bearing_correlation_time: float = param(
        0.5, unit="s", low=0, high=1e4, changeable=True, doc="of the bearing errors; 0 = independent bearings"
    )
    range_min: float = param(1.0, unit="m", low=1e-3, doc="a source is not nearer than this when first heard")
    range_max: float = param(200.0, unit="m", low=1e-3, doc="nor farther than this")
    array_yaw: float = param(0.0, unit="rad", low=-3.15, high=3.15, doc="of the array's +x in base_link")
    mirror: bool = param(True, doc="the side of the array is not known: carry both")
    mirror_probability: float = param(1e-3, low=1e-12, high=0.4, doc="a side less probable than this is dropped")
    process_noise: float = param(
        0.1, unit="m per sqrt(s)", low=0, doc="how fast odom drifts at the source (or the source wanders in it)"
    )
    source_speed_std: float = param(
        0.0, unit="m/s", low=0, high=100, doc="per axis, of a source on a straight course; 0 = still; for the ekf"
    )
    gate_sigma: float = param(5.0, unit="sigma", low=1, changeable=True, doc="bearings beyond this are not used")
    reset_after: int = param(30, low=2, doc="so many unused bearings in a row start the source anew")
    odometry_timeout: float = param(1.0, unit="s", low=0.01, doc="bearings need odometry not older than this")
    odometry_jump: float = param(
        RESET_MOVE, unit="m", low=0.01, doc="odometry this far (and 3 m/s) off its own velocity was reset or glitched"
    )
    particles: int = param(2000, low=10, high=1_000_000)
    lines: int = param(400, low=4, high=100_000, doc="bearing lines that triangulation remembers")
    seed: int = param(1, low=0)

    def __post_init__(self) -> None:
        check_source_ids(self.source_ids)
        check_ranges(self.range_min, self.range_max)
        if self.lines % 2:
            raise ValueError(f"lines must be even, got {self.lines}")
        if self.source_speed_std and self.method != "ekf":
            raise ValueError(f"source_speed_std needs method ekf, got {self.source_speed_std:g} with {self.method}")


def check_source_ids(source_ids: tuple[str, ...]) -> None:
    """Ids become parts of topic names.

    Raises:
        ValueError: there is none, one is repeated, or one is not a topic name.
    """
    if not source_ids:
        raise ValueError("source_ids must name at least one source, got none")
    for k, source_id in enumerate(source_ids):
        if not re.fullmatch(r"[A-Za-z_]\w*", source_id, re.ASCII):
            raise ValueError(f"source_ids must be letters, digits and _, not starting with a digit, got {source_id!r}")
        if source_id in source_ids[:k]:
            raise ValueError(f"source_ids must differ, got {source_id!r} twice")


def check_ranges(range_min: float, range_max: float) -> None:
    """Raises ValueError unless range_min is below range_max."""
    if range_min >= range_max:
        raise ValueError(f"range_min must be below range_max, got {range_min:g} and {range_max:g} m")


def independent_share(interval: float, correlation_time: float) -> float:
    """How much of an independent bearing one is that follows the last by `interval` s.

    Errors with correlation rho = exp(-interval / correlation_time) carry (1 - rho) / (1 + rho) of the information of
    white ones: their mean has that much more variance in the long run. So a filter that divides each variance by
    this share ends as certain as one that knew the correlation.
    """
    return 1.0 if correlation_time <= 0 else math.tanh(interval / (2 * correlation_time))


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


class Hypothesis:
    """One estimator that believes in one side at its start.

    From then on it takes of a bearing and its mirror image the one that it predicts (`image_error`), so that a source
    may pass the array's axis.
    """

    def __init__(self, ray: Ray, config: LocalizerConfig, rng: np.random.Generator) -> None:
        self.estimator = _estimator(ray, config, rng)
        self.log_evidence = 0.0
        self.nis = 0.0
        self.unused = 0  # bearings in a row beyond the gate

    def update(self, rays: list[Ray], duration: float, drift: Drift, gate_sigma: float) -> None:
        self.estimator.predict(duration, drift)
        predicted, variance = self.estimator.predicted_bearing(rays[0].x, rays[0].y)
        std, weight = rays[0].std, rays[0].weight
        errors = [wrap_angle(ray.bearing - predicted) for ray in rays]
        error, spread = image_error(errors, std)
        self.log_evidence += log_evidence(error, variance + (std**2 + spread) / weight)
        self.nis = error * error / (variance + std**2 + spread)
        self.unused = 0 if self.nis <= gate_sigma**2 else self.unused + 1
        if self.unused == 0:
            bearing = wrap_angle(predicted + error)
            self.estimator.update(Ray(rays[0].x, rays[0].y, bearing, math.sqrt(std**2 + spread), weight))

    @property
    def fix(self) -> PlanarFix | None:
        return self.estimator.estimate()


class SourceLocalizer:
    """One source. `sides` holds the living hypotheses; the first is published as the position.

    That is the side of the bearings as they come, until the other one has won.
    """

    def __init__(self, config: LocalizerConfig, index: int) -> None:
        self.config = config
        self._rng = np.random.default_rng([config.seed, index])
        self.sides: list[Hypothesis] = []
        self.used = self.unused = self.restarts = 0
        self._last_ns = 0
        self._yaw_variance = 0.0
        self._heading = 0.0  # without leaps by 2 pi
        self._headings = (0.0, 0.0)  # least and most since the start of the sides

    def update(
        self, t_ns: int, x: float, y: float, yaw: float, bearing: float, variance: float, yaw_variance: float = 0.0
    ) -> None:
        """Takes a bearing in the vehicle's frame, heard at (x, y) with that yaw.

        `yaw_variance` is the odometry's own; as it grows, the source turns about the vehicle. Triangulation is for
        odometry that does not drift.

        Raises:
            ValueError: a variance that is not positive while bearing_std is 0, or a stamp that does not advance.
        """
        std = self.config.bearing_std or std_of(variance)
        if t_ns <= self._last_ns:
            raise ValueError(f"bearing at {t_ns} ns must come after the one at {self._last_ns} ns")
        duration = (t_ns - self._last_ns) * 1e-9 if self.sides else 0.0
        share = independent_share(duration, self.config.bearing_correlation_time) if self.sides else 1.0
        images = (bearing, mirror_bearing(bearing, self.config.array_yaw))[: 1 + self.config.mirror]
        rays = [Ray(x, y, wrap_angle(yaw + image), std, share) for image in images]
        self._last_ns = t_ns
        self._heading += wrap_angle(yaw - self._heading)
        self._headings = min(self._headings[0], self._heading), max(self._headings[1], self._heading)
        if not self.sides:
            self._start(rays)
        else:
            self._continue(rays, duration, Drift(x, y, max(0.0, yaw_variance - self._yaw_variance)))
        self._yaw_variance = yaw_variance

    @property
    def mirror_probability(self) -> float:
        """Of the second side; 0 when there is only one."""
        if len(self.sides) < 2:
            return 0.0
        difference = self.sides[1].log_evidence - self.sides[0].log_evidence
        return 0.5 * (1 + math.tanh(difference / 2))

    def _start(self, rays: list[Ray]) -> None:
        self.sides = [Hypothesis(ray, self.config, self._rng) for ray in rays]
        self._headings = self._heading, self._heading
        self.used += 1

    def _continue(self, rays: list[Ray], duration: float, drift: Drift) -> None:
        for side in self.sides:
            side.update(rays, duration, drift, self.config.gate_sigma)
        if all(side.unused for side in self.sides):
            self.unused += 1
        else:
            self.used += 1
        if min(side.unused for side in self.sides) >= self.config.reset_after:
            one_share = [Ray(r.x, r.y, r.bearing, r.std) for r in rays]
            self._start(one_share)
            self.restarts += 1
        self._settle()

    def _settle(self) -> None:
        """Drops a side, after a turn: on a straight track a slow error of the heading looks like evidence."""
        probability, least = self.mirror_probability, self.config.mirror_probability
        turned = self._headings[1] - self._headings[0] >= TELLING_TURN
        if len(self.sides) == 2 and turned and not least <= probability <= 1 - least:
            self.sides = [self.sides[probability > 0.5]]


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


def std_of(variance: float) -> float:
    """Standard deviation of a bearing message in rad; ValueError unless its variance is positive."""
    if not 0 < variance < math.inf:
        raise ValueError(f"the bearing's variance must be positive while bearing_std is 0, got {variance:g} rad^2")
    return math.sqrt(variance)


_OUTLIERS = 0.05
TELLING_TURN = math.radians(20.0)  # of the heading, before a side is dropped
