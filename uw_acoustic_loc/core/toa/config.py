"""Parameters of the time-of-arrival tracker."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from ...config import group, param


@dataclass(frozen=True)
class ArrivalNoise:
    """How far an arrival may be off: its own std, and impulses on top of it."""

    arrival_std: float = param(1e-3, unit="s", low=1e-9, doc="of an arrival whose std is not given: 0, negative or NaN")
    gate_sigma: float = param(3.5, unit="sigma", low=0.5, changeable=True, doc="innovations beyond are ignored")
    noise: str = param("gaussian", choices=("gaussian", "mixture"), doc="of the arrivals; mixture: with impulses")
    impulse_fraction: float = param(0.2, low=0, high=1, changeable=True, doc="this and below: for a noise of mixture")
    impulse_alpha: float = param(1.8, low=0.5, high=2)
    impulse_beta: float = param(1.0, low=-1, high=1)
    impulse_scale: float = param(10.0, low=1e-9, doc="in an arrival's std")
    impulse_location: float = param(-3.0, doc="in an arrival's std, parameterisation S1")


@dataclass(frozen=True)
class Water:
    """The water column and the speed of sound in it."""

    bottom_depth: float = param(0.0, unit="m", low=0, doc="flat seabed below z = 0; 0 = no bottom path")
    max_depth: float = param(200.0, unit="m", low=0.1, doc="no target is deeper, nor below bottom_depth")
    sound_speed: float = param(1500.0, unit="m/s", low=0, high=1650.0, doc="at the start; 0 = by the temperature")
    sound_speed_std: float = param(2.0, unit="m/s", low=1e-3, doc="at the start")
    temperature: float = param(10.0, unit="deg C", low=-2, high=40, doc="for a sound_speed of 0")
    salinity: float = param(35.0, unit="psu", low=0, high=45, doc="for a sound_speed of 0")
    depth: float = param(0.0, unit="m", low=0, high=8000, doc="of temperature and salinity, for a sound_speed of 0")

    def __post_init__(self) -> None:
        if 0 < self.sound_speed < SLOWEST:
            raise ValueError(f"sound_speed must be 0 or at least {SLOWEST:g} m/s, got {self.sound_speed:g}")

    @property
    def start_sound_speed(self) -> float:
        """m/s, as given or by Mackenzie 1981."""
        return self.sound_speed or mackenzie(self.temperature, self.salinity, self.depth)


SLOWEST, FASTEST = 1350.0, 1650.0  # m/s


def mackenzie(temperature: float, salinity: float, depth: float) -> float:
    """m/s at a temperature in deg C, a salinity in psu and a depth in m (Mackenzie 1981), good to 0.07 m/s.

    For 2 to 30 deg C, 25 to 40 psu, down to 8000 m; at 25 deg C, 35 psu and 1000 m 1550.744 m/s.
    """
    t, s, d = temperature, salinity - 35, depth
    of_temperature = 4.591 * t - 5.304e-2 * t**2 + 2.374e-4 * t**3
    of_depth = 1.630e-2 * d + 1.675e-7 * d**2 - 7.139e-13 * t * d**3
    return 1448.96 + of_temperature + 1.340 * s - 1.025e-2 * t * s + of_depth


@dataclass(frozen=True)
class ProcessNoise:
    """What changes between two pings."""

    acceleration_noise: float = param(0.2, unit="m/s^2 per sqrt(Hz)", low=0, changeable=True, doc="horizontal")
    vertical_acceleration_noise: float = param(0.02, unit="m/s^2 per sqrt(Hz)", low=0, changeable=True)
    sound_speed_walk: float = param(0.3, unit="m/s per sqrt(s)", low=0, changeable=True)


@dataclass(frozen=True)
class Acquisition:
    """Where the target may be at first, and when it is lost."""

    cold_start: bool = param(True, doc="find the first position from the arrivals, without initial_position")
    initial_position: tuple[float, ...] = param((0.0, 0.0, 0.0), unit="m", length=3, doc="without cold_start")
    initial_position_std: tuple[float, ...] = param((10.0, 10.0, 10.0), unit="m", low=1e-3, length=3)
    initial_velocity: tuple[float, ...] = param((0.0, 0.0, 0.0), unit="m/s", length=3)
    initial_velocity_std: tuple[float, ...] = param((2.0, 2.0, 0.5), unit="m/s", low=1e-3, length=3)
    max_speed: float = param(20.0, unit="m/s", low=0.1, doc="no target is faster")
    start_epochs: int = param(5, low=1, high=50, doc="solved together at a start, before the filter goes on alone")
    lost_epochs: int = param(
        3, low=1, doc="a target is acquired again when half of what is heard was rejected so often in a row"
    )

    def __post_init__(self) -> None:
        for name in ("initial_position", "initial_position_std", "initial_velocity", "initial_velocity_std"):
            if len(getattr(self, name)) != 3:
                raise ValueError(f"{name} must have 3 elements, got {len(getattr(self, name))}")

    @property
    def most_epochs(self) -> int:
        """Epochs that a track is judged by."""
        return max(self.start_epochs, self.lost_epochs)


@dataclass(frozen=True)
class PressureSensor:
    """The target's pressure sensor."""

    pressure_std: float = param(0.0, unit="Pa", low=0, doc="of the target's `pressure` messages; 0 = there are none")
    surface_pressure: float = param(101_325.0, unit="Pa", low=5e4, high=1.2e5, doc="of the air")
    water_density: float = param(1025.0, unit="kg/m^3", low=950, high=1100)


@dataclass(frozen=True)
class Receivers:
    """Where the receivers are, what moves them, and their clocks."""

    receiver_positions: tuple[float, ...] = param((), unit="m", doc="x y z of each receiver; empty = from the topic")
    receiver_ids: tuple[int, ...] = param((), low=0, high=65535)
    moving_receivers: bool = param(False, doc="buoys/positions comes all the time, and is taken in stamp order")
    buoy_clock_offset_std: float = param(0.0, unit="s", low=0, doc="of each clock at the start; 0 = all are right")
    range_bias_std: float = param(0.0, unit="m", low=0, doc="of each receiver's constant range error; 0 = none has any")
    buoy_clock_drift_std: float = param(0.0, unit="s/s", low=0, doc="of each clock, constant; 0 = none drifts")
    mooring_ids: tuple[str, ...] = param((), doc="moorings whose `mooring/<id>/odometry` moves a receiver along x")
    mooring_receivers: tuple[int, ...] = param((), low=0, high=65535, doc="the receiver on each of mooring_ids")

    def __post_init__(self) -> None:
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


@dataclass(frozen=True)
class ToaConfig:
    """What a message of arrivals is, and the parameters of all that it is used with."""

    emission: str = param("known", choices=("known", "unknown"), doc="whether the stamp is the instant of emission")
    max_delay: float = param(60.0, unit="s", low=1e-3, doc="of an arrival after the stamp; later ones are refused")
    rewind: float = param(2.0, unit="s", low=0, high=60, doc="late arrivals are used if not later than this")
    arrivals: ArrivalNoise = group(ArrivalNoise)
    water: Water = group(Water)
    process: ProcessNoise = group(ProcessNoise)
    start: Acquisition = group(Acquisition)
    pressure: PressureSensor = group(PressureSensor)
    receivers: Receivers = group(Receivers)
    seed: int = param(1, low=0, doc="nothing is drawn at random here")

    @cached_property
    def clock_stds(self) -> tuple[float, ...]:
        """Of each receiver: none, its offset in s, or that and its drift; a range bias is an offset of the clock."""
        r = self.receivers
        offset = math.hypot(r.buoy_clock_offset_std, r.range_bias_std / self.water.start_sound_speed)
        return tuple(std for std in (offset, r.buoy_clock_drift_std) if std > 0)
