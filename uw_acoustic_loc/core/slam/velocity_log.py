"""Velocities over ground as Doppler logs send them, with and without bottom lock."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ..types import BodyVelocity
from .config import SlamConfig
from .inertial import LOG_BIAS, VELOCITY
from .joint import Joint, Prediction


@dataclass
class VelocityLog:
    """Corrects by the axes of which a message says something, and counts.

    An axis' variance is the message's; where that is 0, negative or NaN it is not known and `dvl_std` stands for it;
    where it is huge the axis says nothing.
    """

    used: int = 0
    unused: int = 0  # beyond the gate
    uninformative: int = 0  # without a known axis
    in_a_row: int = field(default=0, repr=False)  # beyond the gate

    def correct(self, joint: Joint, velocity: BodyVelocity, config: SlamConfig) -> bool:
        """Whether the velocity said something and was used.

        Raises:
            ValueError: a value that stands for "no velocity", or that no vehicle reaches.
        """
        linear = velocity.linear.tolist()
        variances = _variances(velocity, config.dvl_std**2)
        known = [axis for axis in range(3) if variances[axis] < _NO_INFORMATION]
        if not known:
            self.uninformative += 1
            return False
        _require_velocity([linear[axis] for axis in known])
        if not self._fits(joint, {axis: linear[axis] for axis in known}, variances, config.gate_sigma):
            return False
        for axis in known:
            prediction = _predicted(joint, axis)
            joint.correct(prediction, linear[axis] - prediction.value, variances[axis])
        return True

    def _fits(self, joint: Joint, linear: dict[int, float], variances: list[float], gate_sigma: float) -> bool:
        """The gate; a vehicle that was pushed fails it too, so the third failure in a row opens it."""
        predictions = {axis: _predicted(joint, axis) for axis in linear}
        errors = {axis: value - predictions[axis].value for axis, value in linear.items()}
        fits = all(e * e / (predictions[k].variance + variances[k]) <= gate_sigma**2 for k, e in errors.items())
        if not fits and not any(linear.values()):
            raise ValueError("velocity of exactly 0, 0, 0 does not fit: logs send it without bottom lock")
        self.in_a_row = 0 if fits else self.in_a_row + 1
        if self.in_a_row == _PUSHED:
            joint.widen(VELOCITY, max(e * e for e in errors.values()))
            self.in_a_row, fits = 0, True
        self.used, self.unused = self.used + fits, self.unused + (not fits)
        return fits


def _predicted(joint: Joint, axis: int) -> Prediction:
    return joint.total(VELOCITY.start + axis, LOG_BIAS.start + axis)


def _variances(velocity: BodyVelocity, usual: float) -> list[float]:
    """Of each axis; a negative first element means that none is known (the ROS convention)."""
    given = velocity.linear_cov.diagonal().tolist()
    return [variance if given[0] >= 0 and variance > 0 else usual for variance in given]


def _require_velocity(linear: list[float]) -> None:
    for value in linear:
        if any(math.isclose(value, sentinel, abs_tol=1e-6) for sentinel in _SENTINELS):
            raise ValueError(f"velocity {value:g} m/s is what logs send without bottom lock")
        if not abs(value) <= _FASTEST:
            raise ValueError(f"velocity must be at most {_FASTEST:g} m/s on each axis, got {value:g}")


_NO_INFORMATION = 1e4  # m^2/s^2
_SENTINELS = (-32.768, -32.767, 32.767, -327.68)  # m/s: the least 16-bit number of mm/s, or of cm/s
_FASTEST = 30.0  # m/s
_PUSHED = 3
