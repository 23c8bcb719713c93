"""The buoy tracker's parameters, motion model and times of arrival (Choi 2025, eq. 1-7).

State (7,): position x y z (m, map, z up), velocity (m/s), effective sound speed (m/s).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from ...config import param
from ..impulsive import AlphaStable, ImpulsiveNoise
from ..types import Array
from .sound_speed import mackenzie

STATES = 7
BIAS_STD = 1.0  # s; what is left of an unknown emission time after centring at the median, far above any noise


@dataclass(frozen=True)
class ToaConfig:
    """Parameters of the time-of-arrival tracker."""

    emission: str = param("known", choices=("known", "unknown"), doc="whether the stamp is the instant of emission")
    bottom_depth: float = param(0.0, unit="m", low=0, doc="flat seabed below z = 0; 0 = no bottom path")
    gate_sigma: float = param(3.5, unit="sigma", low=0.5, changeable=True, doc="innovations beyond are ignored")
    noise: str = param("gaussian", choices=("gaussian", "mixture"), doc="of the arrivals; mixture: with impulses")
    impulse_fraction: float = param(0.2, low=0, high=1, changeable=True, doc="this and below: for a noise of mixture")
    impulse_alpha: float = param(1.8, low=0.5, high=2)
    impulse_beta: float = param(1.0, low=-1, high=1)
    impulse_scale: float = param(10.0, low=1e-9, doc="in an arrival's std")
    impulse_location: float = param(-3.0, doc="in an arrival's std, parameterisation S1")
    sound_speed: float = param(1500.0, unit="m/s", low=0, high=1650, doc="at the start; 0 = by the temperature")
    temperature: float = param(10.0, unit="deg C", low=-2, high=40, doc="for a sound_speed of 0")
    salinity: float = param(35.0, unit="psu", low=0, high=45, doc="for a sound_speed of 0")
    depth: float = param(0.0, unit="m", low=0, high=8000, doc="of temperature and salinity, for a sound_speed of 0")
    sound_speed_std: float = param(2.0, unit="m/s", low=1e-3, doc="at the start")
    sound_speed_walk: float = param(0.3, unit="m/s per sqrt(s)", low=0, changeable=True)
    acceleration_noise: float = param(0.2, unit="m/s^2 per sqrt(Hz)", low=0, changeable=True, doc="horizontal")
    vertical_acceleration_noise: float = param(0.02, unit="m/s^2 per sqrt(Hz)", low=0, changeable=True)
    cold_start: bool = param(True, doc="find the first position from the arrivals, without initial_position")
    initial_position: tuple[float, ...] = param((0.0, 0.0, 0.0), unit="m", length=3, doc="without cold_start")
    initial_position_std: tuple[float, ...] = param((10.0, 10.0, 10.0), unit="m", low=1e-3, length=3)
    initial_velocity: tuple[float, ...] = param((0.0, 0.0, 0.0), unit="m/s", length=3)
    initial_velocity_std: tuple[float, ...] = param((2.0, 2.0, 0.5), unit="m/s", low=1e-3, length=3)
    max_depth: float = param(200.0, unit="m", low=0.1, doc="no target is deeper, nor below bottom_depth")
    start_epochs: int = param(5, low=1, high=50, doc="solved together at a start, before the filter goes on alone")
    lost_epochs: int = param(3, low=1, doc="in a row with half the arrivals rejected: the target is acquired anew")
    max_delay: float = param(60.0, unit="s", low=1e-3, doc="of an arrival after the stamp; later ones are refused")
    rewind: float = param(2.0, unit="s", low=0, high=60, doc="late arrivals are used if not later than this")
    pressure_std: float = param(0.0, unit="Pa", low=0, doc="of the target's `pressure` messages; 0 = there are none")
    surface_pressure: float = param(101_325.0, unit="Pa", low=5e4, high=1.2e5, doc="of the air")
    water_density: float = param(1025.0, unit="kg/m^3", low=950, high=1100)
    moving_receivers: bool = param(False, doc="buoys/positions comes all the time, and is taken in stamp order")
    buoy_clock_offset_std: float = param(0.0, unit="s", low=0, doc="of each clock at the start; 0 = all are right")
    buoy_clock_drift_std: float = param(0.0, unit="s/s", low=0, doc="of each clock, constant; 0 = none drifts")
    mooring_ids: tuple[str, ...] = param((), doc="moorings whose `mooring/<id>/odometry` moves a receiver along x")
    mooring_receivers: tuple[int, ...] = param((), low=0, high=65535, doc="the receiver on each of mooring_ids")
    receiver_positions: tuple[float, ...] = param((), unit="m", doc="x y z of each receiver; empty = from the topic")
    receiver_ids: tuple[int, ...] = param((), low=0, high=65535)
    seed: int = param(1, low=0, doc="nothing is drawn at random here")

    @property
    def start_sound_speed(self) -> float:
        """m/s, as given or by Mackenzie 1981."""
        return self.sound_speed or mackenzie(self.temperature, self.salinity, self.depth)

    def __post_init__(self) -> None:
        if 0 < self.sound_speed < _SLOWEST:
            raise ValueError(f"sound_speed must be 0 or at least {_SLOWEST:g} m/s, got {self.sound_speed:g}")
        if len(self.receiver_positions) != 3 * len(self.receiver_ids):
            raise ValueError(
                f"receiver_positions must have 3 numbers for each of the {len(self.receiver_ids)} receiver_ids, "
                f"got {len(self.receiver_positions)}"
            )
        if len(set(self.receiver_ids)) < len(self.receiver_ids):
            raise ValueError(f"receiver_ids must differ from each other, got {list(self.receiver_ids)}")
        if self.buoy_clock_drift_std > 0 and self.buoy_clock_offset_std == 0:
            raise ValueError("buoy_clock_drift_std needs a buoy_clock_offset_std above 0, got 0 s")
        if len(set(self.mooring_ids)) < len(self.mooring_ids) or len(self.mooring_ids) != len(self.mooring_receivers):
            raise ValueError(
                f"mooring_ids must differ and be as many as mooring_receivers, got {list(self.mooring_ids)} "
                f"for {list(self.mooring_receivers)}"
            )
        for name in ("initial_position", "initial_position_std", "initial_velocity", "initial_velocity_std"):
            if len(getattr(self, name)) != 3:
                raise ValueError(f"{name} must have 3 elements, got {len(getattr(self, name))}")


def height_from_pressure(pressure: float, variance: float, config: ToaConfig) -> tuple[float, float]:
    """z in m and its variance from an absolute pressure in Pa; a variance of 0 is unknown, `pressure_std` stands in.

    At 1e5 Pa above that of the air, in sea water: -9.95 m.
    """
    weight = config.water_density * _GRAVITY
    return (config.surface_pressure - pressure) / weight, (variance or config.pressure_std**2) / weight**2


def with_height(mean: Array, cov: Array, z: float, variance: float, age: float) -> tuple[Array, Array]:
    """Mean and covariance after a measurement of what z was `age` s ago."""
    PHt = cov[2] - age * cov[5]
    S = PHt[2] - age * PHt[5] + variance
    g = PHt / np.sqrt(S)
    return mean + PHt * ((z - mean[2] + age * mean[5]) / S), cov - np.outer(g, g)


def impulsive_noise(config: ToaConfig) -> ImpulsiveNoise:
    """The noise of an arrival in units of its std."""
    shape = (config.impulse_alpha, config.impulse_beta, config.impulse_scale, config.impulse_location)
    return ImpulsiveNoise(1.0, config.impulse_fraction, _impulse(*shape))


@functools.lru_cache(maxsize=8)
def _impulse(alpha: float, beta: float, scale: float, location: float) -> AlphaStable:
    """Kept, because its density is tabulated at the first use."""
    return AlphaStable(alpha, beta, scale, location)


def water_column(config: ToaConfig) -> tuple[float, float]:
    """Mean and standard deviation in m of the z of a target of which only the water is known."""
    half = min(config.max_depth, config.bottom_depth or math.inf) / 2
    return -half, half


def predict(mean: Array, cov: Array, dt: float, config: ToaConfig) -> tuple[Array, Array]:
    """Mean (7,) and covariance (7, 7) after dt s of nearly constant velocity (eq. 4-5), kept within the water.

    The covariance is symmetric to rounding; the update makes it exactly so.
    """
    F, Q = _step(dt, config.acceleration_noise, config.vertical_acceleration_noise, config.sound_speed_walk)
    if len(mean) > STATES:
        F, Q = _with_drift(F, Q, len(mean), dt * (config.buoy_clock_drift_std > 0))
    return _in_water(F.dot(mean), F.dot(cov).dot(F.T) + Q, config)


def motion(dt: float) -> Array:
    """F (7, 7) of constant velocity over dt s (eq. 4)."""
    F = np.eye(STATES)
    F[0, 3] = F[1, 4] = F[2, 5] = dt
    return F


def _in_water(mean: Array, cov: Array, config: ToaConfig) -> tuple[Array, Array]:
    """Where z has become less certain than the water column makes it, as certain as that and no more."""
    middle, std = water_column(config)
    spread = cov[2, 2]
    if spread <= std**2:
        return mean, cov
    g = cov[2] / spread
    return mean + g * (1 - std**2 / spread) * (middle - mean[2]), cov - (spread - std**2) * np.outer(g, g)


def process_noise(dt: float, config: ToaConfig) -> Array:
    """(7, 7) of white acceleration and a random walk of the sound speed over dt s, forwards or backwards."""
    return _step(dt, config.acceleration_noise, config.vertical_acceleration_noise, config.sound_speed_walk)[1].copy()


@functools.lru_cache(maxsize=64)
def _step(dt: float, acceleration: float, vertical: float, walk: float) -> tuple[Array, Array]:
    """F and Q (7, 7); kept, because most pings come in equal steps."""
    q, age = np.square([acceleration, acceleration, vertical]), abs(dt)
    Q, k = np.zeros((STATES, STATES)), np.arange(3)
    Q[k, k] = q * age**3 / 3
    Q[k, k + 3] = Q[k + 3, k] = q * dt * age / 2
    Q[k + 3, k + 3] = q * age
    Q[6, 6] = walk**2 * age
    return motion(dt), Q


def _with_drift(F: Array, Q: Array, size: int, dt: float) -> tuple[Array, Array]:
    """The same with the buoys' clocks (core/toa_clock.py), whose offsets grow by their drifts, if they have any."""
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
_SLOWEST = 1350.0  # m/s
