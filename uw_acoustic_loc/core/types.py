"""What flows between stages: measurements and estimates with their stamps, in SI units and radians.

Every stamped type has ``t_ns``, integer nanoseconds of the measurement it belongs to. The record types (rows of named
columns) have one array per column, named as in ``msg_defs``; the other fields are what the message's header says.
A variance that is positive is known. UNKNOWN (-1) means that the sender does not say, and 0 that it did not fill the
covariance in: whoever uses the value takes the noise of its own parameters then. NO_INFORMATION or nearly so means that
the value says nothing. Each element of a covariance speaks for itself; an unknown one has no covariances with others.
Frames follow REP-103 and REP-105: x forward, y left, z up; ``map``, ``odom``, ``base_link``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
AnyArray = NDArray[Any]


UNKNOWN = -1.0  # a variance that is not known
NO_INFORMATION = 1e12  # larger variances are cut to this


def unknown(size: int) -> Array:
    """A covariance that says "unknown": -1 on its diagonal, of which the first is the ROS convention."""
    return UNKNOWN * np.eye(size)


# --- acoustics of one vehicle -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class HydrophoneInfo:
    """The array and its converter (HydrophoneInfo record, one row)."""

    t_ns: int
    sample_rate: float  # Hz
    spacing: float  # m, hydrophone 0 at -spacing/2, hydrophone 1 at +spacing/2 on the array's x axis
    sound_speed: float  # m/s
    scale: float  # Pa per count of int16 samples
    frame_id: str = "hydrophone_array"


@dataclass(frozen=True, eq=False)
class Samples:
    """A frame of both hydrophones (HydrophoneSample record)."""

    t_ns: int  # of the first sample
    h0: AnyArray  # (N,) float32 Pa or int16 counts
    h1: AnyArray
    frame_id: str = "hydrophone_array"


@dataclass(frozen=True, eq=False)
class Bearing:
    """Direction to a source, counter-clockwise from the frame's +x, in (-pi, pi]."""

    t_ns: int  # when the ping reached the array
    bearing: float  # rad
    variance: float  # rad^2; UNKNOWN when the sender does not say
    position: Array  # (3,) of the array in the frame, m
    frame_id: str = "base_link"


@dataclass(frozen=True, eq=False)
class Particles:
    """A weighted cloud for display (Particle record)."""

    t_ns: int
    x: AnyArray
    y: AnyArray
    z: AnyArray
    weight: AnyArray
    frame_id: str = "base_link"


# --- vehicle ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Odometry:
    """Pose in ``frame_id``, velocity in ``child_frame_id``."""

    t_ns: int
    position: Array  # (3,) m
    quat_xyzw: Array  # (4,)
    linear: Array  # (3,) m/s, body frame
    angular: Array  # (3,) rad/s, body frame
    pose_cov: Array = field(default_factory=lambda: unknown(6))  # (6, 6) x y z roll pitch yaw
    twist_cov: Array = field(default_factory=lambda: unknown(6))  # (6, 6)
    frame_id: str = "odom"
    child_frame_id: str = "base_link"


@dataclass(frozen=True, eq=False)
class Imu:
    """Angular rate and specific force (gravity included) in the body frame."""

    t_ns: int
    angular: Array  # (3,) rad/s
    acceleration: Array  # (3,) m/s^2
    angular_cov: Array = field(default_factory=lambda: unknown(3))  # (3, 3)
    acceleration_cov: Array = field(default_factory=lambda: unknown(3))  # (3, 3)
    frame_id: str = "base_link"


@dataclass(frozen=True, eq=False)
class BodyVelocity:
    """Velocity over ground in the body frame (a DVL's)."""

    t_ns: int
    linear: Array  # (3,) m/s
    linear_cov: Array = field(default_factory=lambda: unknown(3))  # (3, 3)
    frame_id: str = "base_link"


@dataclass(frozen=True, eq=False)
class Position:
    """An estimated position with its covariance."""

    t_ns: int
    position: Array  # (3,) m
    cov: Array = field(default_factory=lambda: unknown(3))  # (3, 3) m^2; -1 on the diagonal = not observed
    frame_id: str = "odom"


@dataclass(frozen=True, eq=False)
class Point:
    """A measured or true point without covariance."""

    t_ns: int
    position: Array  # (3,) m
    frame_id: str = "map"


@dataclass(frozen=True, eq=False)
class Scalar:
    """One number. Its message has no header: the stamp lives in the process and as the bag's log time."""

    t_ns: int
    value: float


@dataclass(frozen=True, eq=False)
class Pressure:
    """Absolute pressure, of the water at a vehicle."""

    t_ns: int
    pressure: float  # Pa
    variance: float = 0.0  # Pa^2; 0 = unknown, as the message has it
    frame_id: str = "base_link"


# --- nets of buoys and sonars -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class NodePositions:
    """Where receivers and transmitters are (NodePosition record)."""

    t_ns: int
    id: AnyArray
    role: AnyArray  # RECEIVER, TRANSMITTER or REMOVED
    x: AnyArray
    y: AnyArray
    z: AnyArray
    frame_id: str = "map"

    RECEIVER = 0
    TRANSMITTER = 1
    REMOVED = 2

    @property
    def positions(self) -> Array:
        """(M, 3) in m."""
        return np.stack([self.x, self.y, self.z], axis=1).astype(float)


@dataclass(frozen=True, eq=False)
class Arrivals:
    """Times of arrival of one ping at the buoys (Arrival record)."""

    t_ns: int  # emission when known, else start of the epoch
    receiver: AnyArray
    path: AnyArray  # UNKNOWN, DIRECT, BOTTOM or SURFACE
    time: AnyArray  # s after the stamp
    std: AnyArray  # s
    snr: AnyArray  # dB
    frame_id: str = "map"

    UNKNOWN = 0
    DIRECT = 1
    BOTTOM = 2
    SURFACE = 3


@dataclass(frozen=True, eq=False)
class ArrivalPaths:
    """Probabilities of the path of each arrival of a ping (ArrivalPath record)."""

    t_ns: int  # as of the arrivals
    receiver: AnyArray
    time: AnyArray  # s after the stamp
    direct: AnyArray
    bottom: AnyArray
    surface: AnyArray
    frame_id: str = "map"


@dataclass(frozen=True, eq=False)
class Detections:
    """Bistatic detections of one ping (BistaticDetection record)."""

    t_ns: int  # ping transmission
    receiver: AnyArray
    range: AnyArray  # m, transmitter - target - receiver
    range_std: AnyArray  # m
    bearing: AnyArray  # rad, ENU at the receiver
    bearing_std: AnyArray  # rad
    snr: AnyArray  # dB
    frame_id: str = "map"


@dataclass(frozen=True, eq=False)
class Tracks:
    """Targets with stable ids (Track record)."""

    t_ns: int
    id: AnyArray
    x: AnyArray
    y: AnyArray
    z: AnyArray
    vx: AnyArray
    vy: AnyArray
    vz: AnyArray
    position_std: AnyArray
    frame_id: str = "map"
