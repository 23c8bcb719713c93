"""EKF-SLAM that goes through its first minutes again once the gyro's bias is known (an iterated EKF over the track)."""

from __future__ import annotations

import math

import numpy as np

from ..localizer.triangulation import PlanarFix
from ..types import Bearing
from .config import SlamConfig
from .filter import Measurement, Slam, SourceBearing
from .inertial import SIZE, YAW_BIAS
from .lines import Estimate


class SlamPasses:
    """As many passes over the first minutes as the yaw gyro's bias needs; `slam` is the latest that is complete.

    Until a pinger is known, or its lines meet at another bias only, nothing is known of the bias: the track is drawn,
    and linearised, with that of the prior. When the bias proves to lie elsewhere, a pass linearised there goes
    through all measurements since the start, several to each new one, and takes over when it has caught up and knows
    the bias.
    """

    def __init__(self, config: SlamConfig) -> None:
        self.slam = Slam(config)
        self.linearised_at = 0.0  # rad/s
        self._again: Pass | None = None
        self._past: list[Measurement] | None = []  # None when forgotten
        self._next = 0  # measurement that the pass under way takes next
        self._begin_ns = 0
        self._unknown = 0.0  # s for which the bias could still be that of the first pass

    def change(self, config: SlamConfig) -> None:
        """Holds from now on; the past, heard under another configuration, is not gone through again."""
        self.slam.config = config
        self._past = self._again = None

    def take(self, measurement: Measurement) -> None:
        """See `Slam.take`; a measurement that the filter refuses is not remembered."""
        self.slam.take(measurement)
        self._remember(measurement)
        if isinstance(measurement, SourceBearing):
            self._consider_a_pass(*measurement)

    def _remember(self, measurement: Measurement) -> None:
        t_ns = measurement.bearing.t_ns if isinstance(measurement, SourceBearing) else measurement.t_ns
        self._begin_ns = self._begin_ns or t_ns
        if t_ns - self._begin_ns > _MEMORY_NS:
            self._past = self._again = None
        if self._past is None:
            return
        self._past.append(measurement)
        if self._again is not None:
            self._catch_up(self._again, self._past)

    def _consider_a_pass(self, source_id: str, bearing: Bearing) -> None:
        if self._past is None or (self._again is not None and self._next < len(self._past)):
            return
        latest = self._again or self
        bias, variance = _bias(latest.slam, source_id)
        if self._bent(bias - latest.linearised_at, math.sqrt(variance), (bearing.t_ns - self._begin_ns) * 1e-9):
            self._again, self._next = Pass(self.slam.config, bias), 0

    def _bent(self, shift: float, std: float, age: float) -> bool:
        """Whether the bias surely lies where it has bent the track more than linearising bears, until it was known."""
        if not self.slam.config.gyro_bias_std:
            return False
        sure = abs(shift) > _SURE * std
        if not sure and self.linearised_at == 0.0:
            self._unknown = age
        return sure and abs(shift) * self._unknown > _BEARABLE

    def _catch_up(self, again: Pass, past: list[Measurement]) -> None:
        for measurement in past[self._next : self._next + _PACE]:
            again.slam.take(measurement)
        self._next = min(self._next + _PACE, len(past))
        if self._next == len(past) and abs(again.pull) * self._unknown <= _BEARABLE:
            again.restore_prior()
            self.slam, self.linearised_at, self._again = again.slam, again.linearised_at, None


class Pass:
    """A filter that begins at some bias of the yaw gyro in rad/s, as if that were the prior's mean."""

    def __init__(self, config: SlamConfig, linearised_at: float) -> None:
        self.slam, self.linearised_at = Slam(config), linearised_at
        joint, copied = self.slam.joint, np.zeros((2, SIZE))
        joint.mean[YAW_BIAS] = linearised_at
        copied[0, YAW_BIAS] = 1.0
        self._prior = linearised_at / config.gyro_bias_std**2  # exponent of the ratio of both priors, per rad/s
        self._begun = joint.add(PlanarFix(np.array([linearised_at, 0.0]), np.zeros((2, 2))), copied)

    @property
    def pull(self) -> float:
        """How far in rad/s `restore_prior` moves the bias back; as far as the pass began when it has learnt nothing."""
        return self._prior * self.slam.joint.cov.item(YAW_BIAS, self._begun.start)

    def restore_prior(self) -> None:
        """Moves the mean to where a prior of mean 0 has it.

        The ratio of both priors is an exponential of the bias at the start, which is a state beside the one that walks.
        """
        self.slam.settle()
        joint = self.slam.joint
        joint.mean -= self._prior * joint.cov[:, self._begun.start]
        joint.remove(self._begun)


def _bias(slam: Slam, source_id: str) -> Estimate:
    """The yaw gyro's bias as the filter has it, or as a pinger's lines estimate it where they know it better."""
    lines, joint = slam.pingers[source_id].lines_bias, slam.joint
    known = Estimate(joint.mean.item(YAW_BIAS), joint.cov.item(YAW_BIAS, YAW_BIAS))
    return known if lines is None or known.variance < lines.variance else lines


_MEMORY_NS = 300_000_000_000
_BEARABLE = 0.05  # rad of yaw
_SURE = 3.0  # standard deviations
_PACE = 8  # measurements of the past to each new one
