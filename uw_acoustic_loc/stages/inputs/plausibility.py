"""Units and conventions that show in the data: a warning with the likely reason, or a refusal beyond physics."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.geometry import wrap_angle, yaw_from_quat
from ...core.types import Array, BodyVelocity, Imu, Odometry
from .settings import PREFIX


class Plausibility:
    """Looks at the values of one input. `faults` are sentences about its last `_WINDOW` seconds, `notes` about all."""

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self.faults: list[str] = []
        self.notes: dict[str, str] = {}
        self._window = _Window()

    def check(self, value: Any) -> None:
        """ValueError for what no vehicle does, and for numbers that a driver sends in place of a measurement."""
        if isinstance(value, Imu):
            self._imu(value)
        elif isinstance(value, BodyVelocity):
            self._note_empty("twist.covariance", value.linear_cov)
            _check_speed("twist.linear", value.linear)
        elif isinstance(value, Odometry):
            self._odometry(value)

    def _imu(self, value: Imu) -> None:
        for name, vector, cov in (
            ("angular_velocity", value.angular, value.angular_cov),
            ("linear_acceleration", value.acceleration, value.acceleration_cov),
        ):
            self._note_empty(f"{name}_covariance", cov)
            if cov[0, 0] < 0 and not vector.any():
                raise ValueError(f"{name}_covariance[0] is -1 and {name} is zero: this driver does not measure it")
        if window := self._window.add(value.t_ns, value.acceleration, math.hypot(*value.angular.tolist())):
            self.faults = _imu_faults(self._topic, *window)

    def _odometry(self, value: Odometry) -> None:
        self._note_empty("pose.covariance", value.pose_cov)
        self._note_empty("twist.covariance", value.twist_cov)
        _check_speed("twist.linear", value.linear)
        if math.hypot(*value.position.tolist()) > _FARTHEST:
            raise ValueError(f"pose.position must be within {_FARTHEST:g} m, got {value.position.tolist()}")
        turned = self._window.turned(value)
        if window := self._window.add(value.t_ns, turned, 0.0):
            self.faults = _odometry_faults(window[0])

    def _note_empty(self, name: str, cov: Array) -> None:
        if name not in self.notes and not cov.any():
            self.notes[name] = f"{name} is all zero: taken as unknown, the parameters' noise is used"


@dataclass
class _Window:
    """Means over some seconds of stamps."""

    begin_ns: int = 0
    count: int = 0
    vectors: Array = field(default_factory=lambda: np.zeros(3))
    sizes: float = 0.0
    last: tuple[int, float] | None = None  # stamp and yaw of the odometry before

    def add(self, t_ns: int, vector: Array, size: float) -> tuple[Array, float] | None:
        """Mean vector and mean size when a window is full."""
        if not self.count or not self.begin_ns <= t_ns < self.begin_ns + 2 * _WINDOW_NS:
            self.begin_ns, self.count, self.vectors, self.sizes = t_ns, 0, np.zeros(3), 0.0
        self.count, self.vectors, self.sizes = self.count + 1, self.vectors + vector, self.sizes + size
        if t_ns - self.begin_ns < _WINDOW_NS or self.count < _FEWEST:
            return None
        means = self.vectors / self.count, self.sizes / self.count
        self.count = 0
        return means

    def turned(self, value: Odometry) -> Array:
        """Squares and product of the yaw's rate of change and of what the twist says of it."""
        yaw = yaw_from_quat(value.quat_xyzw)
        last, self.last = self.last, (value.t_ns, yaw)
        dt = (value.t_ns - last[0]) * 1e-9 if last else 0.0
        if last is None or not 0.0 < dt < 1.0:
            return np.zeros(3)
        change, by_twist = wrap_angle(yaw - last[1]), value.angular.item(2) * dt
        return np.array([change * change, change * by_twist, by_twist * by_twist]) / dt**2


def _imu_faults(topic: str, force: Array, rate: float) -> list[str]:
    size, across = math.hypot(*force.tolist()), float(np.abs(force[:2]).max())
    faults = {
        f"{topic}: the specific force averages {size:.2f} in size, so it is in g, not m/s^2": 0.8 < size < 1.2,
        f"{topic}: the specific force averages {size:.2f} m/s^2 in size, as if gravity were removed": size <= 0.8
        or 1.2 <= size < 5.0,
        f"{topic}: the specific force averages {force[2]:.2f} m/s^2 along z, so z points down: set"
        f" {PREFIX}{topic}.convention to ned, or its rotation": size > 5.0 and force[2] < -0.7 * size,
        f"{topic}: {across:.2f} m/s^2 of gravity lie across z: set {PREFIX}{topic}.rotation": size > 5.0
        and abs(force[2]) < 0.5 * size,
        f"{topic}: the angular rate averages {rate:.1f} rad/s, so it is in deg/s": rate > _SPINNING,
    }
    return [sentence for sentence, true in faults.items() if true]


def _odometry_faults(sums: Array) -> list[str]:
    """The slope of the twist's turn over the pose's; nothing of a vehicle that hardly turns."""
    change, product, by_twist = sums.tolist()
    if change < _HARDLY or product * product < 0.5 * change * by_twist:  # or they do not belong together
        return []
    slope = product / change
    if slope < -0.5:
        return [f"twist.angular.z is {slope:.2f} times the turn of the pose: its axes point down, or the pose's do"]
    if slope > 10.0:
        return [f"twist.angular.z is {slope:.1f} times the turn of the pose, so it is in deg/s"]
    return []


def _check_speed(name: str, velocity: Array) -> None:
    """A speed that no vehicle has is often a number that says something else."""
    numbers = velocity.tolist()
    if max(map(abs, numbers)) <= _FASTEST:
        return
    for number in numbers:
        if meaning := next((text for sent, text in _SENTINELS.items() if math.isclose(number, sent, rel_tol=1e-6)), ""):
            raise ValueError(f"{name} has {number:g} m/s: {meaning}")
    raise ValueError(f"{name} must be at most {_FASTEST:g} m/s, got {numbers}; is it in mm/s or cm/s?")


# What drivers send for "not measured"
_SENTINELS = {
    -32.768: "no bottom lock, as PD0 (Teledyne RDI) and Nortek logs say it",
    32.767: "no bottom lock, the largest of 16 bits in mm/s",
    -32768.0: "no bottom lock, as PD0 (Teledyne RDI) logs say it, not converted from mm/s",
    -327.68: "no bottom lock, the smallest of 16 bits in cm/s",
    99.999: "no bottom lock, as LinkQuest logs say it",
    999.0: "not measured, by a fill value",
    9999.0: "not measured, by a fill value",
    -999.0: "not measured, by a fill value",
    -9999.0: "not measured, by a fill value",
    9.969209968386869e36: "not measured, by NetCDF's fill value",
}
_FASTEST = 30.0  # m/s
_FARTHEST = 1e7  # m
_SPINNING = 1.5  # rad/s on average of a window
_HARDLY = 0.05**2  # rad^2/s^2, a turn that decides
_WINDOW_NS = 2_000_000_000
_FEWEST = 10  # messages
