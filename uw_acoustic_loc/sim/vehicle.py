"""The vehicle's own sensors: IMU, DVL, the dead reckoning made of both, and its true motion."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator

import numpy as np

from ..contract import Event, Output
from ..core.geometry import quat_from_yaw
from ..core.types import Array, BodyVelocity, Imu, Odometry
from .scenario import Scenario
from .trajectory import Trajectory


class VehicleSource:
    """IMU and DVL with white noise and constant biases; odometry integrates the same readings from the start pose.

    A reading is available at its stamp. The dead reckoning holds the last DVL reading and takes the vehicle as level.

    Raises:
        ValueError: the scenario has no vehicle.
    """

    def __init__(self, scenario: Scenario) -> None:
        if scenario.vehicle is None:
            raise ValueError("vehicle: the scenario has none")
        self._scenario, self._vehicle = scenario, scenario.vehicle
        self._trajectory = Trajectory(scenario.vehicle)

    @property
    def outputs(self) -> tuple[Output, ...]:
        return (
            Output("imu/data", Imu),
            Output("dvl/twist", BodyVelocity),
            Output("odometry", Odometry),
            Output(self._truth_topic, Odometry),
        )

    def events(self) -> Iterator[Event]:
        rng, vehicle = self._scenario.rng(_KEY), self._vehicle
        gyro_bias = rng.normal(0.0, vehicle.gyro_bias_std, 3)
        dvl_bias = rng.normal(0.0, vehicle.dvl_bias_std, 3)
        angular, force = self._inertial(rng, gyro_bias)
        dvl = self._over_ground(rng, dvl_bias)
        streams = (self._imu(angular, force), self._dvl(dvl), self._odometry(angular, dvl), self._truth())
        return heapq.merge(*streams, key=lambda event: event[0])

    @property
    def _truth_topic(self) -> str:
        return f"/truth/{self._vehicle.name}/odometry"

    def _times(self, rate: float) -> Array:
        return np.arange(math.floor(self._scenario.duration * rate + 1e-9) + 1) / rate

    def _inertial(self, rng: np.random.Generator, bias: Array) -> tuple[Array, Array]:
        """Returns angular rate and specific force, each (n, 3): gravity upwards, and the centripetal force to port."""
        motion = self._trajectory.at(self._times(self._vehicle.imu_rate))
        n = motion.yaw.size
        angular, force = np.zeros((n, 3)), np.zeros((n, 3))
        angular[:, 2] = motion.yaw_rate
        force[:, 1], force[:, 2] = motion.speed * motion.yaw_rate, GRAVITY
        angular += bias + rng.normal(0.0, self._vehicle.gyro_std, (n, 3))
        return angular, force + rng.normal(0.0, self._vehicle.accelerometer_std, (n, 3))

    def _over_ground(self, rng: np.random.Generator, bias: Array) -> Array:
        """Returns the measured body velocity (n, 3) in m/s."""
        speed = self._trajectory.at(self._times(self._vehicle.dvl_rate)).speed
        velocity = bias + rng.normal(0.0, self._vehicle.dvl_std, (speed.size, 3))
        velocity[:, 0] += speed
        return velocity

    def _imu(self, angular: Array, force: Array) -> Iterator[Event]:
        angular_cov = _diagonal(self._vehicle.gyro_std**2)
        force_cov = _diagonal(self._vehicle.accelerometer_std**2)
        for time, rate, acceleration in zip(self._times(self._vehicle.imu_rate), angular, force, strict=True):
            t_ns = self._scenario.t_ns(time)
            yield t_ns, "imu/data", Imu(t_ns, rate, acceleration, angular_cov, force_cov)

    def _dvl(self, velocities: Array) -> Iterator[Event]:
        cov = _diagonal(self._vehicle.dvl_std**2)
        for time, velocity in zip(self._times(self._vehicle.dvl_rate), velocities, strict=True):
            t_ns = self._scenario.t_ns(time)
            yield t_ns, "dvl/twist", BodyVelocity(t_ns, velocity, cov)

    def _odometry(self, angular: Array, dvl: Array) -> Iterator[Event]:
        vehicle, times = self._vehicle, self._times(self._vehicle.odometry_rate)
        imu_times = self._times(vehicle.imu_rate)
        held = dvl[_last(imu_times, vehicle.dvl_rate, len(dvl))]
        path, yaw = _dead_reckoning(angular[:, 2], held, 1 / vehicle.imu_rate)
        covs = self._drift(path, yaw)
        twist_cov = np.diag([vehicle.dvl_std**2 + vehicle.dvl_bias_std**2] * 3 + [vehicle.gyro_std**2] * 3)
        k = _last(times, vehicle.imu_rate, len(imu_times))
        rest = times - imu_times[k]  # 0 unless the odometry runs between two IMU readings
        positions = path[k] + _turned(yaw[k], held[k]) * rest[:, None]
        yaws = yaw[k] + angular[k, 2] * rest
        for time, position, heading, j in zip(times, positions, yaws, k, strict=True):
            t_ns, rates = self._scenario.t_ns(time), np.array([0.0, 0.0, angular[j, 2]])
            pose = (position, quat_from_yaw(heading))
            yield t_ns, "odometry", Odometry(t_ns, *pose, held[j].copy(), rates, covs[j], twist_cov)

    def _drift(self, path: Array, yaw: Array) -> Array:
        """Returns the covariance (n, 6, 6) of the dead-reckoned poses: to first order, the gyro bias to second order.

        Without the second order a bias b, which turns step j by b t_j, seems to move the end along one line only;
        the arc it truly moves on leaves that line by sum (b t_j)^2 / 2 step_j.
        """
        vehicle, dt = self._vehicle, 1 / self._vehicle.imu_rate
        n = np.arange(len(path), dtype=float)
        white, bias = (vehicle.gyro_std * dt) ** 2, (vehicle.gyro_bias_std * dt) ** 2
        lever, spread = _levers(path[:, :2])
        sagitta = np.zeros((len(path), 2))
        sagitta[1:] = np.cumsum(np.square(n[:-1, None]) / 2 * np.diff(path[:, :2], axis=0), axis=0)
        axes = np.zeros((len(path), 2, 2))  # integral of the rotation: what a bias of the DVL is multiplied with
        axes[1:] = np.cumsum(_rotations(yaw[:-1]), axis=0) * dt
        along = vehicle.dvl_std**2 / vehicle.dvl_rate * n * dt
        cov = np.zeros((len(path), 6, 6))
        cov[:, :2, :2] = white * spread + bias * _outer(lever, lever) + along[:, None, None] * np.eye(2)
        cov[:, :2, :2] += vehicle.dvl_bias_std**2 * axes @ axes.transpose(0, 2, 1)
        cov[:, :2, :2] += 3 * bias**2 * _outer(sagitta, sagitta)  # E b^4 = 3 sigma^4
        cov[:, 2, 2] = (vehicle.dvl_bias_std * n * dt) ** 2 + along
        cov[:, 5, 5] = white * n + bias * n * n
        cov[:, :2, 5] = cov[:, 5, :2] = lever * (white + bias * n)[:, None]
        return cov

    def _truth(self) -> Iterator[Event]:
        times = self._times(self._vehicle.odometry_rate)
        motion = self._trajectory.at(times)
        cov, zero = np.zeros((6, 6)), np.zeros(3)
        for k, time in enumerate(times):
            t_ns = self._scenario.t_ns(time)
            linear, angular = zero.copy(), zero.copy()
            linear[0], angular[2] = motion.speed[k], motion.yaw_rate[k]
            pose = (motion.positions[:, k].copy(), quat_from_yaw(motion.yaw[k]))
            yield t_ns, self._truth_topic, Odometry(t_ns, *pose, linear, angular, cov, cov, "map", "base_link")


def _last(times: Array, rate: float, count: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Returns for each time the index of the last of `count` readings at a rate."""
    return np.minimum(np.floor(times * rate + 1e-6).astype(np.intp), count - 1)


def _dead_reckoning(yaw_rate: Array, velocity: Array, dt: float) -> tuple[Array, Array]:
    """Returns path (n, 3) and yaw (n,) at every IMU reading, from the origin; each reading is held until the next."""
    turns = yaw_rate[:-1] * dt
    yaw = np.concatenate([[0.0], np.cumsum(turns)])
    steps = _turned(yaw[:-1] + turns / 2, velocity[:-1]) * dt
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]), yaw


def _turned(yaw: Array, velocity: Array) -> Array:
    """Returns body velocities (n, 3) in the frame that yaw is measured in."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    u, v, w = velocity.T
    return np.stack([cos * u - sin * v, sin * u + cos * v, w], axis=1)


def _levers(xy: Array) -> tuple[Array, Array]:
    """Returns how far yaw errors at the steps j < n move the end p_n by: sum (n, 2) and sum of squares (n, 2, 2).

    An error e at step j turns the rest of the path about its point there: J (p_n - p_j) e, J a quarter turn. White
    errors add in squares, a bias adds first.
    """
    n = np.arange(len(xy), dtype=float)[:, None]
    before = np.cumsum(xy, axis=0) - xy
    squares = np.cumsum(_outer(xy, xy), axis=0) - _outer(xy, xy)
    crossed = _outer(xy, before)
    spread = n[..., None] * _outer(xy, xy) - crossed - crossed.transpose(0, 2, 1) + squares
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    return (n * xy - before) @ quarter.T, quarter @ spread @ quarter.T


def _rotations(yaw: Array) -> Array:
    """Returns the rotations (n, 2, 2) by angles (n,)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)


def _outer(a: Array, b: Array) -> Array:
    return a[:, :, None] * b[:, None, :]


def _diagonal(variance: float) -> Array:
    return np.diag([variance] * 3)


GRAVITY = 9.81  # m/s^2
_KEY = 0x1D50  # of this sensor's random numbers
