"""Strapdown motion of a vehicle with a gyro bias (Choi et al. 2016, eq. 8-9), and its Jacobian.

State of a vehicle (15,): position, roll pitch yaw, body velocity u v w, gyro bias (3), bias of the velocity log (3).
Gravity points down, so a level vehicle at rest feels a specific force of +9.81 along z.
"""

from __future__ import annotations

import math

import numpy as np

from .types import Array

SIZE = 15
POSITION, ATTITUDE, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)
GYRO_BIAS, LOG_BIAS = slice(9, 12), slice(12, 15)
YAW = 5
GRAVITY = 9.81  # m/s^2


def moved(state: Array, rates: Array, force: Array, dt: float) -> Array:
    """(9,) the state's first 9 after dt s, from measured angular rate (3,) and specific force (3,) (eq. 9).

    Raises:
        ValueError: the pitch has passed 85 degrees.
    """
    roll, pitch, yaw, u, v, w = state[3:9].tolist()
    if abs(pitch) > _STEEPEST:
        raise ValueError(f"pitch must stay within 85 degrees, got {math.degrees(pitch):.1f}")
    p, q, r = (rates - state[GYRO_BIAS]).tolist()
    ax, ay, az = force.tolist()
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    lift = sr * v + cr * w
    forward, port = cp * u + sp * lift, cr * v - sr * w  # velocity in the level frame turned by yaw
    climb = q * sr + r * cr
    derivative = (
        *(cy * forward - sy * port, sy * forward + cy * port, -sp * u + cp * lift),
        *(p + climb * sp / cp, q * cr - r * sr, climb / cp),
        ax + r * v - q * w + GRAVITY * sp,
        ay + p * w - r * u - GRAVITY * sr * cp,
        az + q * u - p * v - GRAVITY * cr * cp,
    )
    return np.asarray(state[:9] + dt * np.array(derivative))


def jacobian(state: Array, rates: Array, dt: float) -> Array:
    """F (9, 12) of `moved` with respect to the state's first 12. Minus its last 3 columns: that of the angular rate."""
    roll, pitch, yaw, u, v, w = state[3:9].tolist()
    p, q, r = (rates - state[GYRO_BIAS]).tolist()
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy, tp = math.cos(yaw), math.sin(yaw), sp / cp
    lift = sr * v + cr * w
    forward, port, rise = cp * u + sp * lift, cr * v - sr * w, -sp * u + cp * lift
    climb, tilt, g = q * sr + r * cr, q * cr - r * sr, GRAVITY
    turning = (cy * sp * port + sy * lift, cy * rise, -sy * forward - cy * port)  # of the velocity over ground, by
    turned = (sy * sp * port - cy * lift, sy * rise, cy * forward - sy * port)  # roll, pitch and yaw
    F = np.zeros((9, 12))
    F[:, 3:] = (
        (*turning, cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, 0.0, 0.0, 0.0),
        (*turned, sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, 0.0, 0.0, 0.0),
        (cp * port, -forward, 0.0, -sp, cp * sr, cp * cr, 0.0, 0.0, 0.0),
        (tilt * tp, climb / cp**2, 0.0, 0.0, 0.0, 0.0, -1.0, -sr * tp, -cr * tp),
        (-climb, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -cr, sr),
        (tilt / cp, climb * tp / cp, 0.0, 0.0, 0.0, 0.0, 0.0, -sr / cp, -cr / cp),
        (0.0, g * cp, 0.0, 0.0, r, -q, 0.0, w, -v),
        (-g * cr * cp, g * sr * sp, 0.0, -r, 0.0, p, -w, 0.0, u),
        (g * sr * cp, g * cr * sp, 0.0, q, -p, 0.0, v, -u, 0.0),
    )
    F *= dt
    F[_DIAGONAL, _DIAGONAL] += 1.0
    return F


_STEEPEST = math.radians(85)  # Euler angles end at 90 degrees
_DIAGONAL = np.arange(9)
