"""Where one source is, from bearings and known motion, with both sides of the array as hypotheses."""

from __future__ import annotations

import math

import numpy as np

from ..geometry import mirror_bearing, wrap_angle
from .config import LocalizerConfig
from .hypothesis import Hypothesis
from .triangulation import Drift, Ray


class SourceLocalizer:
    """One source. `sides` holds the living hypotheses; the first is published as the position.

    That is the side of the bearings as they come, until the other one has won.
    """

    def __init__(self, config: LocalizerConfig, index: int) -> None:
        self.config = config
        self._rng = np.random.default_rng([config.seed, index])
        self.sides: list[Hypothesis] = []
        self.used = self.unused = self.restarts = 0
        self.restart_reason, self.restart_ns = "", 0  # of the last one
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
        self.sides = [Hypothesis(ray, self.config, self._rng, k) for k, ray in enumerate(rays)]
        self._headings = self._heading, self._heading
        self.used += 1

    def _continue(self, rays: list[Ray], duration: float, drift: Drift) -> None:
        for side in self.sides:
            side.update(rays, duration, drift, self.config.gate_sigma)
        if all(side.unused for side in self.sides):
            self.unused += 1
        else:
            self.used += 1
        if reason := self._lost():
            self._start([Ray(r.x, r.y, r.bearing, r.std) for r in rays])
            self.restarts, self.restart_reason, self.restart_ns = self.restarts + 1, reason, self._last_ns
        self._settle()

    def _lost(self) -> str:
        """Why the source has to start again; a side of two that has left its prior is wrong, and dropped."""
        if min(side.unused for side in self.sides) >= self.config.reset_after:
            return f"{self.config.reset_after} bearings in a row did not fit"
        reasons = [side.lost for side in self.sides]
        if all(reasons):
            return reasons[0]
        self.sides = [side for side in self.sides if not side.lost]
        return ""

    def _settle(self) -> None:
        """Drops a side, after a turn: on a straight track a slow error of the heading looks like evidence."""
        probability, least = self.mirror_probability, self.config.mirror_probability
        turned = self._headings[1] - self._headings[0] >= TELLING_TURN
        if len(self.sides) == 2 and turned and not least <= probability <= 1 - least:
            self.sides = [self.sides[probability > 0.5]]


def independent_share(interval: float, correlation_time: float) -> float:
    """How much of an independent bearing one is that follows the last by `interval` s.

    Errors with correlation rho = exp(-interval / correlation_time) carry (1 - rho) / (1 + rho) of the information of
    white ones: their mean has that much more variance in the long run. So a filter that divides each variance by
    this share ends as certain as one that knew the correlation.
    """
    return 1.0 if correlation_time <= 0 else math.tanh(interval / (2 * correlation_time))


def std_of(variance: float) -> float:
    """Standard deviation of a bearing message in rad; ValueError unless its variance is known and says something."""
    if not variance > 0:
        raise ValueError(f"the bearing's variance must be positive while bearing_std is 0, got {variance:g} rad^2")
    if variance >= _NOTHING:
        raise ValueError(f"a bearing whose variance is {variance:g} rad^2 may point anywhere, allowed is {_NOTHING:g}")
    return math.sqrt(variance)


_NOTHING = 9.0  # rad^2
TELLING_TURN = math.radians(20.0)  # of the heading, before a side is dropped
