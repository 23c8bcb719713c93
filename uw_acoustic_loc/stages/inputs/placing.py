"""From a sensor's own axes and place to base_link, and from north, east, down to REP-103's axes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ...core.geometry import quat_from_rpy, rotation_from_rpy, wrap_angle
from ...core.types import Array, Bearing, BodyVelocity, Imu, Odometry, Point, Position, unknown
from .settings import InputConfig


class Placing:
    """Turns and moves the values of one input; `rates` (3,) in rad/s are the vehicle's, for the lever arm."""

    def __init__(self, config: InputConfig) -> None:
        self._ned = config.convention == "ned"
        self._arm: Array = np.array(config.translation or (0.0, 0.0, 0.0))
        self._rpy = config.rotation or (0.0, 0.0, 0.0)
        self._turn: Array = rotation_from_rpy(*self._rpy)
        if self._ned:
            self._turn = self._turn @ _DOWN

    def place(self, value: Any, rates: Array) -> Any:
        """The value as a sensor at base_link with its axes would give it."""
        if isinstance(value, Imu):
            return self._imu(value)
        if isinstance(value, BodyVelocity):
            velocity = self._turn @ value.linear - np.cross(rates, self._arm)
            return dataclasses.replace(value, linear=velocity, linear_cov=_turned(self._turn, value.linear_cov))
        if isinstance(value, Bearing):
            return self._bearing(value)
        if isinstance(value, Odometry):
            return self._odometry(value)
        if isinstance(value, Point):
            return dataclasses.replace(value, position=self._world @ value.position)
        assert isinstance(value, Position)
        cov = _turned(self._world, value.cov)
        return dataclasses.replace(value, position=self._world @ value.position, cov=cov)

    @property
    def _world(self) -> Array:
        return _NORTH if self._ned else np.eye(3)

    def _imu(self, value: Imu) -> Imu:
        """What turns the sensor about base_link is taken from its specific force; the turn's change is left."""
        angular = self._turn @ value.angular
        force = self._turn @ value.acceleration - np.cross(angular, np.cross(angular, self._arm))
        covs = _turned(self._turn, value.angular_cov), _turned(self._turn, value.acceleration_cov)
        return Imu(value.t_ns, angular, force, *covs, value.frame_id)

    def _bearing(self, value: Bearing) -> Bearing:
        bearing = (-value.bearing if self._ned else value.bearing) + self._rpy[2]
        position = self._turn @ value.position + self._arm
        return dataclasses.replace(value, bearing=wrap_angle(bearing), position=position)

    def _odometry(self, value: Odometry) -> Odometry:
        """Of base_link instead of the place that the odometry is of."""
        world, quat = self._world, value.quat_xyzw
        if self._ned:
            quat = _product(_product(_NORTH_QUAT, quat), _DOWN_QUAT)
        back = quat_from_rpy(*self._rpy) * np.array([-1.0, -1.0, -1.0, 1.0])
        quat = _product(quat, back)
        angular = self._turn @ value.angular
        linear = self._turn @ value.linear - np.cross(angular, self._arm)
        position = world @ value.position - _matrix(quat) @ self._arm
        pose_cov, twist_cov = _turned(_twice(world), value.pose_cov), _turned(_twice(self._turn), value.twist_cov)
        return dataclasses.replace(
            value,
            position=position,
            quat_xyzw=quat,
            linear=linear,
            angular=angular,
            pose_cov=pose_cov,
            twist_cov=twist_cov,
        )


def _turned(turn: Array, cov: Array) -> Array:
    """A covariance in other axes; one that is unknown in part is then unknown."""
    return unknown(len(cov)) if cov.diagonal().min() < 0 else turn @ cov @ turn.T


def _twice(turn: Array) -> Array:
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = turn
    return both


def _product(a: Array, b: Array) -> Array:
    """Of two quaternions x, y, z, w: first b, then a."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*vector, a[3] * b[3] - a[:3] @ b[:3]])


def _matrix(quat: Array) -> Array:
    """(3, 3) rotation of a unit quaternion."""
    x, y, z, w = quat.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2.0 * (w * cross + cross @ cross))


_DOWN = np.diag([1.0, -1.0, -1.0])  # forward, right, down -> forward, left, up
_DOWN_QUAT = np.array([1.0, 0.0, 0.0, 0.0])
_NORTH = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # north, east, down -> east, north, up
_NORTH_QUAT = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
