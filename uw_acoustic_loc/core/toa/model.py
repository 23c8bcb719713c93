"""The buoy tracker's motion model and times of arrival (Choi 2025, eq. 1-7).

State (7,): position x y z (m, map, z up), velocity (m/s), effective sound speed (m/s). Where the receivers' clocks are
estimated, or their ranges' biases, by how many s each is ahead and its drift follow: all offsets in the order of the
net's rows, then, with a drift, all drifts.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from ..impulsive import AlphaStable, ImpulsiveNoise
from ..types import AnyArray, Array
from .config import ArrivalNoise, PressureSensor, ProcessNoise, ToaConfig, Water

STATES = 7
BIAS_STD = 1.0  # s; what is left of an unknown emission time after centring at the median, far above any noise


def height_from_pressure(pressure: float, variance: float, sensor: PressureSensor) -> tuple[float, float]:
    """z in m and its variance from an absolute pressure in Pa; `pressure_std` for a variance that is not above 0.

    At 1e5 Pa above that of the air, in sea water: -9.95 m.
    """
    weight = sensor.water_density * _GRAVITY
    return (sensor.surface_pressure - pressure) / weight, (
        variance if variance > 0 else sensor.pressure_std**2
    ) / weight**2


def with_height(mean: Array, cov: Array, z: float, variance: float, age: float) -> tuple[Array, Array]:
    """Mean and covariance after a measurement of what z was `age` s ago."""
    PHt = cov[2] - age * cov[5]
    S = PHt[2] - age * PHt[5] + variance
    g = PHt / np.sqrt(S)
    return mean + PHt * ((z - mean[2] + age * mean[5]) / S), cov - np.outer(g, g)


def impulsive_noise(arrivals: ArrivalNoise) -> ImpulsiveNoise:
    """The noise of an arrival in units of its std."""
    shape = (arrivals.impulse_alpha, arrivals.impulse_beta, arrivals.impulse_scale, arrivals.impulse_location)
    return ImpulsiveNoise(1.0, arrivals.impulse_fraction, _impulse(*shape))


@functools.lru_cache(maxsize=8)
def _impulse(alpha: float, beta: float, scale: float, location: float) -> AlphaStable:
    """Kept, because its density is tabulated at the first use."""
    return AlphaStable(alpha, beta, scale, location)


def water_column(water: Water) -> tuple[float, float]:
    """Mean and standard deviation in m of the z of a target of which only the water is known."""
    half = min(water.max_depth, water.bottom_depth or math.inf) / 2
    return -half, half


def with_clocks(mean: Array, cov: Array, receivers: int, config: ToaConfig) -> tuple[Array, Array]:
    """Mean (7,) and covariance (7, 7) followed by the prior of the clocks, when there is one."""
    variances = np.concatenate([np.diagonal(cov), np.repeat(np.square(config.clock_stds), receivers)])
    whole = np.diag(variances)
    whole[:STATES, :STATES] = cov
    return np.concatenate([mean, np.zeros(len(variances) - STATES)]), whole


def predict(mean: Array, cov: Array, dt: float, config: ToaConfig) -> tuple[Array, Array]:
    """Mean (7,) and covariance (7, 7) after dt s of nearly constant velocity (eq. 4-5), kept within the water.

    The covariance is symmetric to rounding; the update makes it exactly so.
    """
    F, Q = _step(dt, config.process)
    if len(mean) > STATES:
        F, Q = _with_drift(F, Q, len(mean), dt * (len(config.clock_stds) > 1))
    return _in_water(F.dot(mean), F.dot(cov).dot(F.T) + Q, config.water)


def motion(dt: float) -> Array:
    """F (7, 7) of constant velocity over dt s (eq. 4)."""
    F = np.eye(STATES)
    F[0, 3] = F[1, 4] = F[2, 5] = dt
    return F


def _in_water(mean: Array, cov: Array, water: Water) -> tuple[Array, Array]:
    """Where z has become less certain than the water column makes it, as certain as that and no more."""
    middle, std = water_column(water)
    spread = cov[2, 2]
    if spread <= std**2:
        return mean, cov
    g = cov[2] / spread
    return mean + g * (1 - std**2 / spread) * (middle - mean[2]), cov - (spread - std**2) * np.outer(g, g)


def process_noise(dt: float, process: ProcessNoise) -> Array:
    """(7, 7) of white acceleration and a random walk of the sound speed over dt s, forwards or backwards."""
    return _step(dt, process)[1].copy()


@functools.lru_cache(maxsize=64)
def _step(dt: float, process: ProcessNoise) -> tuple[Array, Array]:
    """F and Q (7, 7); kept, because most pings come in equal steps."""
    horizontal, vertical = process.acceleration_noise, process.vertical_acceleration_noise
    q, age = np.square([horizontal, horizontal, vertical]), abs(dt)
    Q, k = np.zeros((STATES, STATES)), np.arange(3)
    Q[k, k] = q * age**3 / 3
    Q[k, k + 3] = Q[k + 3, k] = q * dt * age / 2
    Q[k + 3, k + 3] = q * age
    Q[6, 6] = process.sound_speed_walk**2 * age
    return motion(dt), Q


def _with_drift(F: Array, Q: Array, size: int, dt: float) -> tuple[Array, Array]:
    """The same with the receivers' clocks, whose offsets grow by their drifts, if they have any."""
    whole, noise, offsets = np.eye(size), np.zeros((size, size)), np.arange(STATES, (size + STATES) // 2)
    whole[:STATES, :STATES], noise[:STATES, :STATES] = F, Q
    whole[offsets, offsets + len(offsets)] = dt
    return whole, noise


def arrival_times(
    mean: Array, images: Array, bias: Array | float = 0.0, lag: Array | float | None = None
) -> tuple[Array, Array]:
    """Times (n,) after the epoch's stamp of a ping at the images (n, 3) (eq. 6), and their Jacobian (n, 7) (eq. 7).

    `bias` (n,): the emission after its epoch's stamp, s; `lag` (n,): the emission after the instant of `mean`. Without
    a lag the emission is at both.
    """
    path = mean[:3, None] - images.T
    if lag is not None:
        path += mean[3:6, None] * lag
    slowness = np.array(1 / mean.item(6))  # an array without dimensions: numpy multiplies by it in half the time
    length = np.sqrt(_ONES.dot(path * path) + _LEAST)
    times = length * slowness
    rows = np.zeros((STATES, len(images)))
    np.multiply(path, slowness / length, out=rows[:3])
    np.multiply(times, -slowness, out=rows[6])
    if lag is not None:
        np.multiply(rows[:3], lag, out=rows[3:6])
        times += bias
    return times, rows.T


def heard_times(
    mean: Array, images: Array, receiver: AnyArray, bias: Array | float = 0.0, lag: Array | float | None = None
) -> tuple[Array, Array]:
    """`arrival_times` by the clocks of the receivers, rows (n,) of the net; the Jacobian is (n, D)."""
    times, H = arrival_times(mean, images, bias, lag)
    clocks = len(mean) - STATES
    if not clocks:
        return times, H
    rows = np.zeros((len(times), clocks))
    rows[np.arange(len(times)), receiver] = 1.0
    return times + rows @ mean[STATES:], np.hstack([H, rows])


def by_emission(mean: Array, H: Array) -> Array:
    """(n,) derivative of the times with the Jacobian H (n, 7) with respect to the instant of emission."""
    return np.asarray(H[:, :3].dot(mean[3:6]) + 1)


def curvature(slowness: Array, cov: Array, travel_time: Array) -> Array:
    """(n,) mean excess of a travel time over that of the mean position: second order of the square root.

    It keeps a poorly known direction (depth above a shallow net) from being taken for a measured one.
    """
    speed2 = 1 / np.maximum(np.square(slowness).sum(axis=1), 1e-12)
    across = np.trace(cov) - ((slowness @ cov) * slowness).sum(axis=1) * speed2
    return np.asarray(across / (2 * speed2 * np.maximum(travel_time, 1e-6)))


_ONES = np.ones(3)
_LEAST = np.array(1e-18)  # m^2, that a ping at a receiver has a direction
_GRAVITY = 9.80665  # m/s^2
