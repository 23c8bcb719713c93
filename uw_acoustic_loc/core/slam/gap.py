"""Where a vehicle may be after its IMU was silent."""

from __future__ import annotations

import math

import numpy as np

from ..geometry import rotation_from_rpy
from .inertial import ATTITUDE, POSITION, VELOCITY, YAW
from .joint import Joint


def bridge(joint: Joint, duration: float, yaw_rate: float) -> None:
    """Lets the vehicle go on for a duration in s of which nothing is known, from its last yaw rate in rad/s.

    Velocity and yaw rate are Ornstein-Uhlenbeck processes that forget what they were; roll and pitch stay about level.
    Integrating the last reading instead would turn a tilt of some degrees into kilometres within half a minute.
    """
    mean, F, added = joint.mean[:9].copy(), np.eye(9), np.zeros(9)
    reach, forgotten = _FORGETS * (1 - math.exp(-duration / _FORGETS)), math.exp(-duration / _FORGETS)
    R, velocity = rotation_from_rpy(*mean[ATTITUDE].tolist()), mean[VELOCITY].copy()
    moved = reach * (R @ velocity)
    turned = integrated_variance(_TURN_RATE, _STEADY_TURN, duration)
    speed = math.hypot(*velocity.tolist())
    mean[POSITION] += moved
    mean[YAW] += yaw_rate * _STEADY_TURN * (1 - math.exp(-duration / _STEADY_TURN))
    mean[VELOCITY] *= forgotten
    F[POSITION, VELOCITY] = reach * R
    F[:2, YAW] = -moved[1], moved[0]
    F[VELOCITY, VELOCITY] *= forgotten
    added[POSITION] = integrated_variance(_SPEED, _FORGETS, duration)
    added[:2] += (speed * duration) ** 2 * min(turned / 3, 1.0)  # it may have turned on the way
    added[ATTITUDE] = *[_TILT**2 * (1 - math.exp(-2 * duration / _STEADY_TURN))] * 2, turned
    added[VELOCITY] = _SPEED**2 * (1 - forgotten**2)
    joint.move(mean, F, np.zeros(9), added)


def integrated_variance(std: float, correlation_time: float, duration: float) -> float:
    """Variance of the integral of an Ornstein-Uhlenbeck process with that stationary `std`, from a known start."""
    t = duration / correlation_time
    return (std * correlation_time) ** 2 * (2 * t - 3 + 4 * math.exp(-t) - math.exp(-2 * t))


_SPEED, _FORGETS = 2.0, 20.0  # m/s per axis, s
_TURN_RATE, _STEADY_TURN = 0.2, 5.0  # rad/s, s
_TILT = 0.1  # rad
