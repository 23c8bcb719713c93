"""IMU, Doppler log and bearings in, the vehicle's corrected state and the pingers' positions in odom out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import ClassVar

import numpy as np

from ..contract import Emission, Input, Output, Status
from ..core.geometry import quat_from_rpy
from ..core.inertial import ATTITUDE, POSITION, VELOCITY
from ..core.slam import Slam, SlamConfig
from ..core.types import Bearing, BodyVelocity, Imu, Odometry, Position

_PINGER_PERIOD_NS = 500_000_000  # of a pinger's published position
_POSE = [*range(POSITION.start, ATTITUDE.stop)]  # x y z roll pitch yaw


class BearingSlamStage:
    """Publishes the vehicle at every Doppler log stamp, a pinger at most twice a second."""

    Config: ClassVar[type] = SlamConfig

    def __init__(self, config: SlamConfig) -> None:
        self._config = config
        self._slam = Slam(config)
        self._published_ns: dict[str, int] = {}

    @property
    def inputs(self) -> tuple[Input, ...]:
        bearings = (
            Input(f"sources/{name}/bearing", Bearing, partial(self._on_bearing, name), frame="base_link")
            for name in self._config.source_ids
        )
        return (
            Input("imu/data", Imu, self._on_imu, frame="base_link"),
            Input("dvl/twist", BodyVelocity, self._on_velocity, frame="base_link"),
            *bearings,
        )

    @property
    def outputs(self) -> tuple[Output, ...]:
        pingers = (Output(f"slam/sources/{name}/position", Position) for name in self._config.source_ids)
        return (Output("slam/odometry", Odometry), *pingers)

    def status(self) -> Status:
        values: dict[str, float | int | str] = {"dvl used": self._slam.dvl.used, "dvl unused": self._slam.dvl.unused}
        for name in self._config.source_ids:
            if (fix := self._slam.position(name)) is not None:
                values[f"{name}.position_std_m"] = math.sqrt(fix.cov[0, 0] + fix.cov[1, 1])
        placed = sum(self._slam.position(name) is not None for name in self._config.source_ids)
        return Status(Status.OK, f"{placed} of {len(self._config.source_ids)} pingers are placed", values)

    def change(self, config: SlamConfig) -> None:
        self._config = self._slam.config = config

    def _on_imu(self, imu: Imu) -> Iterator[Emission]:
        self._slam.on_imu(imu.t_ns, imu.angular, imu.acceleration)
        yield from ()

    def _on_velocity(self, velocity: BodyVelocity) -> Iterator[Emission]:
        self._slam.on_velocity(velocity.t_ns, velocity.linear)
        yield "slam/odometry", self._odometry(velocity.t_ns)

    def _on_bearing(self, name: str, bearing: Bearing) -> Iterator[Emission]:
        self._slam.on_bearing(name, bearing.t_ns, bearing.bearing, bearing.variance, bearing.position[:2])
        fix = self._slam.position(name)
        if fix is None or bearing.t_ns - self._published_ns.get(name, 0) < _PINGER_PERIOD_NS:
            return
        self._published_ns[name] = bearing.t_ns
        cov = np.diag([0.0, 0.0, -1.0])
        cov[:2, :2] = fix.cov
        z = float(self._slam.joint.mean[2])  # two hydrophones say nothing about the depth
        yield f"slam/sources/{name}/position", Position(bearing.t_ns, np.array([*fix.mean, z]), cov)

    def _odometry(self, t_ns: int) -> Odometry:
        mean, cov = self._slam.joint.mean, self._slam.joint.cov
        twist_cov = np.zeros((6, 6))
        twist_cov[:3, :3] = cov[VELOCITY, VELOCITY]
        twist_cov[3:, 3:] = np.eye(3) * self._config.gyro_std**2
        quat = quat_from_rpy(*(float(angle) for angle in mean[ATTITUDE]))
        return Odometry(
            t_ns=t_ns,
            position=mean[POSITION].copy(),
            quat_xyzw=quat,
            linear=mean[VELOCITY].copy(),
            angular=self._slam.angular,
            pose_cov=cov[np.ix_(_POSE, _POSE)],
            twist_cov=twist_cov,
        )
