"""Bearings, IMU and Doppler log in; the vehicle's corrected track and the pingers in odom out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np

from ..contract import ANY_ID, Emission, Input, Output, Stage, Status
from ..core.geometry import quat_from_rpy
from ..core.slam.config import SlamConfig
from ..core.slam.filter import Slam, SourceBearing
from ..core.slam.inertial import ATTITUDE, GYRO_BIAS, POSITION, VELOCITY, YAW
from ..core.slam.relinearise import SlamPasses
from ..core.types import Array, Bearing, BodyVelocity, Imu, Odometry, Position
from ..topics import known

_IMU, _VELOCITY, _BEARING = known("imu/data"), known("dvl/twist"), known("sources/<id>/bearing")
_ODOMETRY, _POSITION = known("slam/odometry"), known("slam/sources/<id>/position")


class BearingSlamStage(Stage):
    """EKF-SLAM; odom is where the vehicle was at the first IMU message."""

    Config: ClassVar[type] = SlamConfig
    any_id: ClassVar[Mapping[str, Any]] = {"source_ids": [ANY_ID]}

    def __init__(self, config: SlamConfig) -> None:
        self._passes = SlamPasses(config)
        self._told_ns: dict[str, int] = {}

    @property
    def _slam(self) -> Slam:
        return self._passes.slam

    @property
    def inputs(self) -> tuple[Input, ...]:
        bearings = (
            _BEARING.input(partial(self._on_bearing, name), name, frame="base_link")
            for name in self._slam.config.source_ids
        )
        return (
            _IMU.input(self._on_imu, frame="base_link"),
            _VELOCITY.input(self._on_velocity, frame="base_link"),
            *bearings,
        )

    @property
    def outputs(self) -> tuple[Output, ...]:
        return (_ODOMETRY.output(), *(_POSITION.output(name) for name in self._slam.config.source_ids))

    def status(self) -> Status:
        slam = self._slam
        values: dict[str, float | int | str] = {"dvl.used": slam.dvl.used, "dvl.unused": slam.dvl.unused}
        values["dvl.uninformative"] = slam.dvl.uninformative
        values |= {"imu.ahead": slam.imu_ahead, "relocations": slam.relocations}
        values |= {"imu.gaps": slam.imu_gaps, "imu.age_s": slam.imu_age, "dvl.age_s": slam.dvl_age}
        values["position_std_m"] = math.sqrt(slam.joint.cov[0, 0] + slam.joint.cov[1, 1])
        values["yaw_std_rad"] = math.sqrt(slam.joint.cov[YAW, YAW])
        for name, pinger in slam.pingers.items():
            values |= {f"{name}.{key}": getattr(pinger, key) for key in ("used", "unused", "restarts", "nis")}
        silent = [name for name in slam.config.source_ids if name not in slam.pingers]
        faults = self._faults()
        message = "; ".join([*faults, *self._open()])
        return Status(Status.WARN if silent or faults else Status.OK, message or "running", values)

    def _faults(self) -> list[str]:
        slam = self._slam
        lost = slam.relocation
        faults = {
            f"lost, looking for known pingers: {lost.reason if lost else ''}": lost is not None,
            f"the IMU is silent for {slam.imu_age:.1f} s": slam.imu_age > slam.config.imu_timeout,
            f"{slam.imu_ahead} IMU stamps in a row are far ahead": slam.imu_ahead > 0,
            f"no velocity for {slam.dvl_age:.1f} s": slam.dvl_age > _DVL_TIMEOUT,
            f"{slam.dvl.in_a_row} velocities in a row do not fit": slam.dvl.in_a_row > 0,
        }
        return [words for words, true in faults.items() if true]

    def _open(self) -> list[str]:
        """What is not known yet of which pingers."""
        slam = self._slam
        heard = [name for name in slam.config.source_ids if name in slam.pingers]
        both = [name for name in heard if slam.pingers[name].both_sides]
        unknown = [name for name in heard if slam.pingers[name].fix is None and name not in both]
        silent = [name for name in slam.config.source_ids if name not in heard]
        parts = {
            "no bearing yet of": silent,
            "range not yet known of": unknown,
            "until the vehicle turns, both sides remain possible of": both,
        }
        return [f"{words} {', '.join(names)}" for words, names in parts.items() if names]

    def change(self, config: SlamConfig) -> None:
        self._passes.change(config)

    def _on_imu(self, imu: Imu) -> Iterator[Emission]:
        self._passes.take(imu)
        if self._due(_ODOMETRY.name, imu.t_ns, _ODOMETRY_PERIOD_NS):
            yield _ODOMETRY.name, _odometry(imu.t_ns, self._slam)

    def _on_velocity(self, velocity: BodyVelocity) -> Iterator[Emission]:
        self._passes.take(velocity)
        yield from ()

    def _on_bearing(self, name: str, bearing: Bearing) -> Iterator[Emission]:
        self._passes.take(SourceBearing(name, bearing))
        fix, topic = self._slam.position(name), _POSITION.named(name)
        if fix is not None and self._due(topic, bearing.t_ns, _POSITION_PERIOD_NS):
            cov = np.zeros((3, 3))
            cov[:2, :2], cov[2, 2] = fix.cov, -1.0  # z is not observed: the vehicle's is published
            yield topic, Position(bearing.t_ns, np.array([*fix.mean, self._slam.joint.mean[2]]), cov, "odom")

    def _due(self, topic: str, t_ns: int, period_ns: int) -> bool:
        due = t_ns - self._told_ns.get(topic, -period_ns) >= period_ns
        if due:
            self._told_ns[topic] = t_ns
        return due


def _odometry(t_ns: int, slam: Slam) -> Odometry:
    slam.settle()
    mean, cov = slam.joint.mean, slam.joint.cov
    roll, pitch, yaw = mean[ATTITUDE].tolist()
    return Odometry(
        t_ns,
        mean[POSITION].copy(),
        quat_from_rpy(roll, pitch, yaw),
        mean[VELOCITY].copy(),
        slam.angular,
        cov[:6, :6].copy(),
        _twist_cov(slam),
    )


def _twist_cov(slam: Slam) -> Array:
    """(6, 6): of the velocity as estimated; of the angular rate, the gyro's noise and that of its bias."""
    twist, cov = np.zeros((6, 6)), slam.joint.cov
    twist[:3, :3] = cov[VELOCITY, VELOCITY]
    twist[3:, 3:] = cov[GYRO_BIAS, GYRO_BIAS] + slam.config.gyro_std**2 * np.eye(3)
    return twist


_DVL_TIMEOUT = 2.0  # s
_ODOMETRY_PERIOD_NS = 100_000_000
_POSITION_PERIOD_NS = 500_000_000
