"""A pinger in EKF-SLAM: bearing lines until they meet, a landmark from then on."""

from __future__ import annotations

import math

import numpy as np

from ..geometry import mirror_bearing, wrap_angle
from ..localizer.hypothesis import image_error
from ..localizer.triangulation import PlanarFix
from ..types import Array
from .config import SlamConfig
from .inertial import SIZE, YAW
from .joint import Joint, Slot
from .lines import BIASES, Estimate, Lines, Meeting, Pose


class Landmark:
    """One pinger of the map.

    Its lines wait outside the state until they meet at a range known to `start_share` of itself, all of them linearised
    at that point, and until one side of the array is decisively likelier. A single start at some range, or one with a
    large variance (Choi et al. 2016, 3.2), is linearised where the pinger is not and makes the filter overconfident.
    """

    def __init__(self, joint: Joint) -> None:
        self._joint = joint
        self._sides: list[Lines] = []
        self.slot: Slot | None = None  # in the joint state; None until the position is known
        self.both_sides = False
        self.lines_bias: Estimate | None = None  # the yaw gyro's, at which lines meet that do not at the filter's
        self.used = self.unused = self.restarts = 0
        self.nis = 0.0
        self.unused_in_a_row = 0  # bearings beyond the gate

    @property
    def fix(self) -> PlanarFix | None:
        """The position; None until it is known."""
        return None if self.slot is None else self._joint.position(self.slot)

    def update(self, config: SlamConfig, raw: Pose, bearing: float, std: float, share: float, offset: Array) -> None:
        """Takes a bearing of an array at `offset` (2,); with correlated errors it counts with its share."""
        images = images_of(bearing, config)
        if self.slot is not None:
            self._correct(self.slot, config, images, std, share, offset)
            return
        self._sides = self._sides or [Lines() for _ in images]
        for lines, image in zip(self._sides, images, strict=True):
            lines.add(raw, offset, image, std**2 / share, config.start_memory)
        self.used += 1
        if self.used % _EVERY == 0:
            self._try_to_start(config, raw)

    def drop_lines(self) -> None:
        """Restarts a pinger whose position is not known yet."""
        self._sides = []

    def _correct(
        self, slot: Slot, config: SlamConfig, images: list[float], std: float, share: float, offset: Array
    ) -> None:
        prediction = self._joint.bearing(slot, offset)
        errors = [wrap_angle(image - prediction.value) for image in images]
        error, spread = image_error(errors, std)
        variance = (std**2 + spread) / share
        self.nis = error * error / (prediction.variance + std**2 + spread)
        if self.nis > config.gate_sigma**2:
            self._reject(config)
            return
        self.used, self.unused_in_a_row = self.used + 1, 0
        if config.bearing_noise == "student_t":  # the expected precision of this error (Lange et al. 1989)
            variance *= (_FREEDOM + error * error / (prediction.variance + variance)) / (_FREEDOM + 1)
        self._joint.correct(prediction, error, variance)

    def _reject(self, config: SlamConfig) -> None:
        self.unused, self.unused_in_a_row = self.unused + 1, self.unused_in_a_row + 1
        if self.unused_in_a_row >= config.reset_after and self.slot is not None:
            self._joint.remove(self.slot)
            self.slot, self._sides, self.unused_in_a_row = None, [], 0
            self.restarts += 1

    def _try_to_start(self, config: SlamConfig, raw: Pose) -> None:
        mean, self.lines_bias = self._joint.mean, None
        self.both_sides = len(self._sides) == 2
        if self.both_sides and self._sides[0].turn < _TURN:
            return
        pose = Pose(float(mean[0]), float(mean[1]), float(mean[YAW]), raw.time)
        biases, bias_cov = mean[BIASES], self._joint.cov[np.ix_(BIASES, BIASES)]
        found = [side.meeting(raw, pose, biases, biases, bias_cov) for side in self._sides]
        best = _decided([m for m in found if m is not None], len(found), config.mirror_probability)
        self.both_sides = self.both_sides and best is None
        bent = best is not None and abs(best.biases[0] - biases[0]) * self._sides[0].age > _BEARABLE
        if best is not None and (bent or not best.fits):
            there = self._sides[found.index(best)].meeting(raw, pose, best.biases, biases, bias_cov)
            if there is not None and there.sharp:
                self.lines_bias = Estimate(there.biases.item(0), there.bias_cov.item(0, 0))
        if best is None or not best.sharp:
            return
        dx, dy = best.fix.mean - (pose.x, pose.y)
        distance = math.hypot(dx, dy)
        if not config.range_min <= distance <= config.range_max:
            return
        alone, together = (
            np.trace(best.fix.cov + best.by_bias @ C @ best.by_bias.T) for C in (bias_cov, best.bias_cov)
        )
        if min(alone, math.inf if bent else together) < (config.start_share * distance) ** 2:
            J = np.zeros((2, SIZE))
            J[0, 0] = J[1, 1] = 1.0
            J[:, YAW], J[:, BIASES] = (-dy, dx), best.by_bias
            self.slot, self._sides = self._joint.add(best.fix, J), []
            if alone >= (config.start_share * distance) ** 2:  # known only with what the lines say of the biases
                self._joint.learn(BIASES, best.information, best.pull)


def images_of(bearing: float, config: SlamConfig) -> list[float]:
    """The bearing, and with `mirror` its image."""
    return [bearing, mirror_bearing(bearing, config.array_yaw)][: 1 + config.mirror]


def _decided(found: list[Meeting], sides: int, least: float) -> Meeting | None:
    """The only side, or the one of two that is far likelier."""
    if len(found) < sides:
        return None
    best = min(found, key=lambda m: m.cost)
    return best if sum(m.cost - best.cost for m in found) > 2 * math.log(1 / least - 1) or sides == 1 else None


_EVERY = 5  # bearings
_TURN = 0.7  # rad; on a straight track the mirror image fits as well, and what the gyro drifts looks like evidence
_BEARABLE = 0.05  # rad of yaw that the lines bend the track; beyond, they are drawn and started in another pass
_FREEDOM = 4.0
