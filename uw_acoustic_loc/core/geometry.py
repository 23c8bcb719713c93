"""Sign and frame conventions, stated once.

Array frame: hydrophone 0 at (-d/2, 0, 0), hydrophone 1 at (+d/2, 0, 0). TDOA = t_0 - t_1, the arrival at hydrophone 0
minus the arrival at hydrophone 1, so a source towards +x has a positive TDOA. In the far field d cos(theta) = c tdoa
(Choi, Lee, Choi 2016, eq. 2), theta in [0, pi] from the array's +x. Port is the side of +y.
Bearings and yaw are counter-clockwise from +x, in (-pi, pi]; quaternions are x, y, z, w.
"""

from __future__ import annotations

import math

import numpy as np

from .types import Array


def wrap_angle(angle: float) -> float:
    """The same direction in (-pi, pi]. `wrap_angle(-math.pi)` is pi."""
    wrapped = math.remainder(angle, 2 * math.pi)
    return math.pi if wrapped <= -math.pi else wrapped


def wrap_angles(angles: Array) -> Array:
    """`wrap_angle` for arrays."""
    wrapped = np.pi - np.mod(np.pi - np.asarray(angles, dtype=float), 2 * np.pi)
    return np.asarray(wrapped)


def quat_from_yaw(yaw: float) -> Array:
    """(4,) quaternion x, y, z, w of a level attitude."""
    return np.array([0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)])


def quat_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """(4,) quaternion x, y, z, w; yaw, then pitch, then roll (REP-103)."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def rpy_from_quat(quat_xyzw: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a unit quaternion."""
    x, y, z, w = quat_xyzw.tolist()
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw


def yaw_from_quat(quat_xyzw: Array) -> float:
    """Heading of a unit quaternion, counter-clockwise from +x."""
    return rpy_from_quat(quat_xyzw)[2]


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """(3, 3) matrix that turns body coordinates into the fixed frame's."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def hydrophone_positions(spacing: float) -> Array:
    """(2, 3) positions in the array frame."""
    return np.array([[-spacing / 2, 0.0, 0.0], [spacing / 2, 0.0, 0.0]])


def tdoa_of_points(points: Array, spacing: float, sound_speed: float) -> Array:
    """Exact (near-field) TDOA in s of points (D, n) in the array frame, D = 2 or 3 (Shin et al. 2013, fig. 4)."""
    across = np.square(points[1:]).sum(axis=0)
    to_0 = np.sqrt(np.square(points[0] + spacing / 2) + across)
    to_1 = np.sqrt(np.square(points[0] - spacing / 2) + across)
    return np.asarray((to_0 - to_1) / sound_speed)


def angle_from_tdoa(tdoa: float, spacing: float, sound_speed: float) -> tuple[float, bool]:
    """Angle from the array's +x in [0, pi] (Choi et al. eq. 3), and whether |c tdoa / d| > 1 had to be clipped."""
    cosine = sound_speed * tdoa / spacing
    return math.acos(max(-1.0, min(1.0, cosine))), abs(cosine) > 1.0


def mirror_bearing(bearing: float, array_yaw: float) -> float:
    """The other direction with the same TDOA: the reflection at the array's axis."""
    return wrap_angle(2 * array_yaw - bearing)
