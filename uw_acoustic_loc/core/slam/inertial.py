"""Strapdown motion of a vehicle with a gyro bias (Choi et al. 2016, eq. 8-9), and its Jacobian.

State of a vehicle (15,): position, roll pitch yaw, body velocity u v w, gyro bias (3), bias of the velocity log (3).
Gravity points down, so a level vehicle at rest feels a specific force of +9.81 along z.
"""

from __future__ import annotations

import math

import numpy as np

from ..types import Array

SIZE = 15
POSITION, ATTITUDE, VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)
GYRO_BIAS, LOG_BIAS = slice(9, 12), slice(12, 15)
YAW, YAW_BIAS = 5, 11
GRAVITY = 9.81  # m/s^2


def moved(state: Array, rates: Array, force: Array, dt: float) -> tuple[Array, Array]:
    """The state's first 9 after dt s, from measured angular rate (3,) and specific force (3,) (eq. 9).

    With them F (9, 12), their Jacobian with respect to the state's first 12; minus its last 3 columns is that with
    respect to the angular rate. Plain numbers: calls of numpy would take most of the time.

    Raises:
        ValueError: the pitch has passed 85 degrees.
    """
    x, y, z, roll, pitch, yaw, u, v, w, on_p, on_q, on_r = state[:12].tolist()
    if abs(pitch) > _STEEPEST:
        raise ValueError(f"pitch must stay within 85 degrees, got {math.degrees(pitch):.1f}")
    p, q, r = rates.tolist()
    p, q, r = p - on_p, q - on_q, r - on_r
    ax, ay, az = force.tolist()
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    lift, climb = sr * v + cr * w, q * sr + r * cr
    midway = yaw + 0.5 * dt * climb / cp  # or a steady turn would be drawn too wide
    cy, sy = math.cos(midway), math.sin(midway)
    forward, port = cp * u + sp * lift, cr * v - sr * w  # velocity in the level frame turned by yaw
    after = (
        *(x + dt * (cy * forward - sy * port), y + dt * (sy * forward + cy * port), z + dt * (cp * lift - sp * u)),
        *(roll + dt * (p + climb * sp / cp), pitch + dt * (q * cr - r * sr), yaw + dt * climb / cp),
        u + dt * (ax + r * v - q * w + GRAVITY * sp),
        v + dt * (ay + p * w - r * u - GRAVITY * sr * cp),
        w + dt * (az + q * u - p * v - GRAVITY * cr * cp),
    )
    F = _IDENTITY.copy()
    F[_FILLED] = dt * np.array(_slopes(cr, sr, cp, sp, cy, sy, u, v, w, p, q, r, dt)) + _DIAGONAL
    return np.array(after), F.reshape(9, 12)


def _slopes(*attitude_and_motion: float) -> tuple[float, ...]:
    """The Jacobian of the state's derivative where it is not zero, row by row."""
    cr, sr, cp, sp, cy, sy, u, v, w, p, q, r, dt = attitude_and_motion
    lift, tp, g = sr * v + cr * w, sp / cp, GRAVITY
    forward, port, rise = cp * u + sp * lift, cr * v - sr * w, cp * lift - sp * u
    climb, tilt = q * sr + r * cr, q * cr - r * sr
    east, north = cy * forward - sy * port, sy * forward + cy * port
    half = 0.5 * dt / cp
    to_roll, to_pitch, to_q, to_r = half * tilt, half * climb * tp, -half * sr, -half * cr  # of midway
    return (
        *(cy * sp * port + sy * lift - north * to_roll, cy * rise - north * to_pitch, -north),
        *(cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, -north * to_q, -north * to_r),
        *(sy * sp * port - cy * lift + east * to_roll, sy * rise + east * to_pitch, east),
        *(sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, east * to_q, east * to_r),
        *(cp * port, -forward, -sp, cp * sr, cp * cr),
        *(tilt * tp, climb / cp**2, -1.0, -sr * tp, -cr * tp),
        *(-climb, -cr, sr),
        *(tilt / cp, climb * tp / cp, -sr / cp, -cr / cp),
        *(g * cp, r, -q, w, -v),
        *(-g * cr * cp, g * sr * sp, -r, p, -w, u),
        *(g * sr * cp, g * cr * sp, q, -p, v, -u),
    )


_STEEPEST = math.radians(85)  # Euler angles end at 90 degrees
_COLUMNS = (  # of `_slopes`
    *((3, 4, 5, 6, 7, 8, 10, 11), (3, 4, 5, 6, 7, 8, 10, 11), (3, 4, 6, 7, 8)),
    *((3, 4, 9, 10, 11), (3, 10, 11), (3, 4, 10, 11)),
    *((4, 7, 8, 10, 11), (3, 4, 6, 8, 9, 11), (3, 4, 6, 7, 9, 10)),
)
_FILLED = np.array([12 * row + column for row, columns in enumerate(_COLUMNS) for column in columns])
_IDENTITY = np.eye(9, 12).ravel()
_DIAGONAL = _IDENTITY[_FILLED]
