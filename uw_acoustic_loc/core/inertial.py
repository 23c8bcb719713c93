"""Strapdown motion of a vehicle with a gyro bias (Choi et al. 2016, eq. 8-9), and its Jacobians.

State of a vehicle (15,): position, roll pitch yaw, body velocity u v w, gyro bias (3), bias of the velocity log (3).
Gravity points down, so a level vehicle at rest feels a specific force of +9.81 along z.
"""

from __future__ import annotations

import math

import numpy as np

from .geometry import rotation_from_rpy
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


def jacobians(state: Array, rates: Array, dt: float) -> tuple[Array, Array]:
    """F (9, 12) of `moved` with respect to the state's first 12, G (9, 3) with respect to the angular rate."""
    roll, pitch, yaw, u, v, w = state[3:9].tolist()
    p, q, r = (rates - state[GYRO_BIAS]).tolist()
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    tp = sp / cp
    F, G = np.zeros((9, 12)), np.zeros((9, 3))
    G[ATTITUDE] = (1.0, sr * tp, cr * tp), (0.0, cr, -sr), (0.0, sr / cp, cr / cp)
    G[VELOCITY] = (0.0, -w, v), (w, 0.0, -u), (-v, u, 0.0)
    F[POSITION, ATTITUDE] = _turning(cr, sr, cp, sp, yaw, (u, v, w))
    F[POSITION, VELOCITY] = rotation_from_rpy(roll, pitch, yaw)
    F[3:9, 3:5] = _tilting(cr, sr, cp, sp, q, r)
    F[VELOCITY, VELOCITY] = (0.0, r, -q), (-r, 0.0, p), (q, -p, 0.0)
    F[:, GYRO_BIAS] = -G
    F *= dt
    F[_DIAGONAL, _DIAGONAL] += 1.0
    return F, G * dt


def _turning(cr: float, sr: float, cp: float, sp: float, yaw: float, velocity: tuple[float, float, float]) -> Array:
    """(3, 3) derivative of the velocity over ground with respect to roll, pitch and yaw."""
    u, v, w = velocity
    cy, sy = math.cos(yaw), math.sin(yaw)
    lift = sr * v + cr * w
    forward, port, rise = cp * u + sp * lift, cr * v - sr * w, -sp * u + cp * lift
    return np.array(
        (
            (cy * sp * port + sy * lift, cy * rise, -sy * forward - cy * port),
            (sy * sp * port - cy * lift, sy * rise, cy * forward - sy * port),
            (cp * port, -forward, 0.0),
        )
    )


def _tilting(cr: float, sr: float, cp: float, sp: float, q: float, r: float) -> Array:
    """(6, 2) derivative of the attitude's and the velocity's rates with respect to roll and pitch."""
    tp, climb, tilt = sp / cp, q * sr + r * cr, q * cr - r * sr
    return np.array(
        (
            (tilt * tp, climb / cp**2),
            (-climb, 0.0),
            (tilt / cp, climb * sp / cp**2),
            (0.0, GRAVITY * cp),
            (-GRAVITY * cr * cp, GRAVITY * sr * sp),
            (GRAVITY * sr * cp, GRAVITY * cr * sp),
        )
    )


_STEEPEST = math.radians(85)  # Euler angles end at 90 degrees
_DIAGONAL = np.arange(9)
