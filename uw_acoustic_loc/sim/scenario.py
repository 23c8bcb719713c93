"""The scenario file: one story and one truth for every simulated sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..config import build, param
from ..core.impulsive import AlphaStable, ImpulsiveNoise
from ..resources import resource
from ..yaml_file import load_yaml
from .water import Environment


@dataclass(frozen=True)
class Waypoint:
    """A corner of the path, in map."""

    x: float = param(unit="m")
    y: float = param(unit="m")


@dataclass(frozen=True)
class Thruster:
    """A source that rides on the vehicle: broad-band noise, and lines at multiples of its blade rate."""

    position: tuple[float, ...] = param((-0.4, 0.0, 0.0), unit="m", length=3, doc="in base_link")
    level: float = param(110.0, unit="dB re 1 uPa^2/Hz at 1 m and 1 kHz", low=0, high=200, doc="at 1 m/s, flat below")
    slope: float = param(-20.0, unit="dB/decade", low=-60, high=0, doc="above 1 kHz, as of cavitation (Ross 1976)")
    growth: float = param(50.0, unit="dB/decade", low=1, high=100, doc="of noise and lines with the vehicle's speed")
    line_level: float = param(
        120.0, unit="dB re 1 uPa at 1 m", low=0, high=200, doc="amplitude of the first line at 1 m/s"
    )
    line_fall: float = param(6.0, unit="dB", low=0.1, high=100, doc="from each line to the next")
    blades: int = param(3, low=1, high=12)
    turns_per_metre: float = param(20.0, unit="1/m", low=0.01, high=1000, doc="of the shaft, along the vehicle's path")
    modulation: float = param(0.3, low=0, high=1, doc="of the broad-band noise, at the blade rate")

    def __post_init__(self) -> None:
        if len(self.position) != 3:
            raise ValueError(f"position must have 3 elements, got {len(self.position)}")


@dataclass(frozen=True)
class Vehicle:
    """The AUV: constant speed and depth along waypoints, corners rounded with turn_radius."""

    waypoints: tuple[Waypoint, ...] = param(doc="at least two")
    name: str = param("auv1")
    speed: float = param(1.5, unit="m/s", low=0.01, high=20)
    turn_radius: float = param(8.0, unit="m", low=0.1)
    z: float = param(-15.0, unit="m", high=0)
    imu_rate: float = param(100.0, unit="Hz", low=1, high=1000)
    gyro_std: float = param(0.01, unit="rad/s", low=0, high=1, doc="white, per sample (Choi et al. 2016)")
    accelerometer_std: float = param(0.1, unit="m/s^2", low=0)
    gyro_bias_std: float = param(0.002, unit="rad/s", low=0, high=1, doc="constant bias, drawn once")
    dvl_rate: float = param(5.0, unit="Hz", low=0.1, high=100)
    dvl_std: float = param(0.005, unit="m/s", low=0)
    dvl_bias_std: float = param(0.005, unit="m/s", low=0, doc="constant bias per axis, drawn once")
    odometry_rate: float = param(20.0, unit="Hz", low=0.1, high=1000)
    thrusters: tuple[Thruster, ...] = param((), doc="heard by the hydrophones")


@dataclass(frozen=True)
class Impulses:
    """Alpha-stable impulses in the place of some of a sensor's Gaussian errors; location as in parameterisation S1."""

    fraction: float = param(0.0, low=0, high=1)
    alpha: float = param(1.8, low=0.1, high=2)
    beta: float = param(1.0, low=-1, high=1)
    scale: float = param(10.0, low=1e-9, doc="in the sensor's standard deviation")
    location: float = param(-3.0, doc="in the sensor's standard deviation")

    def on(self, std: float) -> ImpulsiveNoise:
        """The noise of a sensor with this standard deviation."""
        return ImpulsiveNoise(std, self.fraction, AlphaStable(self.alpha, self.beta, self.scale, self.location))


@dataclass(frozen=True)
class Hydrophones:
    """Two hydrophones on the vehicle and their 16-bit converter."""

    spacing: float = param(0.6, unit="m", low=0.001, high=100)
    sample_rate: float = param(100_000.0, unit="Hz", low=1000)
    frame_length: float = param(0.1, unit="s", low=0.001, high=10)
    array_yaw: float = param(0.0, unit="rad", low=-3.15, high=3.15, doc="of the array's +x in base_link")
    array_position: tuple[float, ...] = param((0.0, 0.0, 0.0), unit="m", length=3, doc="in base_link")
    full_scale: float = param(20.0, unit="Pa", low=1e-6, doc="pressure of the largest count")
    format: str = param("int16", choices=("int16", "float32"))
    noise_std: float = param(0.2, unit="Pa", low=0, doc="white noise over the whole band, per sample")
    impulses: Impulses = param(Impulses(), doc="single samples, in noise_std; for snaps see environment")
    channel_gain_db: float = param(0.0, unit="dB", low=-40, high=40, doc="of hydrophone 1 over hydrophone 0")
    channel_delay: float = param(0.0, unit="s", low=-1e-3, high=1e-3, doc="of hydrophone 1 behind hydrophone 0")

    def __post_init__(self) -> None:
        if len(self.array_position) != 3:
            raise ValueError(f"array_position must have 3 elements, got {len(self.array_position)}")


@dataclass(frozen=True)
class Pinger:
    """A source that repeats a pulse in its own band: a linear chirp, a tone at the band's centre, or noise."""

    id: str = param()
    x: float = param(unit="m")
    y: float = param(unit="m")
    z: float = param(unit="m", high=0)
    band_low: float = param(unit="Hz", low=1)
    band_high: float = param(unit="Hz", low=1)
    pulse_length: float = param(0.01, unit="s", low=1e-5, high=1)
    period: float = param(0.1, unit="s", low=1e-3)
    offset: float = param(0.0, unit="s", low=0, doc="first emission after the start")
    source_level: float = param(100.0, unit="Pa at 1 m", low=0, doc="amplitude; of noise, sqrt(2) times its rms")
    pulse: str = param("chirp", choices=("chirp", "tone", "noise"))
    q_factor: float = param(
        0.0, low=0, high=1000, doc="of the resonator through which a tone is sent; 0 = none, raised-cosine edges"
    )

    def __post_init__(self) -> None:
        if self.band_low > self.band_high:
            raise ValueError(f"band_low must be at most band_high, got {self.band_low:g} and {self.band_high:g} Hz")
        if self.q_factor and (self.q_factor <= 0.5 or self.pulse != "tone"):
            raise ValueError(f"q_factor must be 0, or above 0.5 with a tone, got {self.q_factor:g} with a {self.pulse}")


@dataclass(frozen=True)
class Node:
    """A buoy, a transmitter or a receiver."""

    id: int = param(low=0, high=65535)
    x: float = param(unit="m")
    y: float = param(unit="m")
    z: float = param(0.0, unit="m", high=0)


@dataclass(frozen=True)
class Buoys:
    """Buoys that time the vehicle's ping, directly and over the seabed."""

    nodes: tuple[Node, ...] = param()
    period: float = param(1.0, unit="s", low=0.01, doc="of the vehicle's ping")
    toa_std: float = param(1e-3, unit="s", low=1e-9)
    outlier_fraction: float = param(0.0, low=0, high=1, doc="late arrivals")
    outlier_mean: float = param(0.1, unit="s", low=0, doc="mean lateness, exponential")
    impulses: Impulses = param(Impulses(), doc="in toa_std, early or late")
    miss_fraction: float = param(0.0, low=0, high=1, doc="arrivals lost whatever their SNR")
    snr_db: float = param(20.0, unit="dB", doc="of a direct arrival")
    snr_distance: float = param(0.0, unit="m", low=0, doc="where snr_db is, falling as 1/r^2; 0 = it is everywhere")
    detection_threshold: float = param(-100.0, unit="dB", doc="arrivals of less SNR are lost")
    drift_speed: float = param(0.0, unit="m/s", low=0, high=5, doc="of every buoy, in a direction of its own")
    clock_offset_std: float = param(0.0, unit="s", low=0, doc="of each buoy, drawn once")
    clock_drift_std: float = param(0.0, low=0, high=1e-3, doc="s per s, of each buoy, drawn once")


@dataclass(frozen=True)
class Turn:
    """From when a target turns, and how fast."""

    time: float = param(unit="s", low=0, doc="after the start")
    rate: float = param(unit="rad/s", low=-1, high=1, doc="counter-clockwise; 0 = straight on")


@dataclass(frozen=True)
class Target:
    """A target of the sonar net, at constant speed."""

    id: int = param(low=0, high=65535)
    x: float = param(unit="m")
    y: float = param(unit="m")
    z: float = param(0.0, unit="m", high=0)
    vx: float = param(0.0, unit="m/s")
    vy: float = param(0.0, unit="m/s")
    turns: tuple[Turn, ...] = param((), doc="in order of time")


@dataclass(frozen=True)
class Sonar:
    """A transmitter, receivers and the targets that they watch."""

    transmitter: Node = param()
    receivers: tuple[Node, ...] = param()
    targets: tuple[Target, ...] = param()
    period: float = param(4.0, unit="s", low=0.1)
    range_noise: str = param("rayleigh", choices=("rayleigh", "gaussian"))
    range_std: float = param(40.0, unit="m", low=1e-6)
    bearing_std: float = param(0.02, unit="rad", low=1e-9, high=1.6)
    impulses: Impulses = param(Impulses(), doc="of a gaussian range_noise, in range_std")
    false_alarms: float = param(0.0, low=0, doc="mean number per receiver and ping")
    miss_fraction: float = param(0.0, low=0, high=1)
    max_range: float = param(10_000.0, unit="m", low=1, doc="false alarms lie within")
    blanking: float = param(
        0.0, unit="m", low=0, doc="the direct blast masks range sums up to this beyond the distance to the transmitter"
    )


@dataclass(frozen=True)
class Mooring:
    """A buoy on its tether: m x'' + b x' + k x = u, its offset measured with impulsive noise (Lee et al. 2013)."""

    id: str = param()
    receiver: int = param(-1, low=-1, high=65535, doc="the buoy on it, whose x is off by the offset; -1 = none of them")
    mass: float = param(1.0, unit="kg", low=1e-9)
    damping: float = param(0.5, unit="N s/m", low=0)
    stiffness: float = param(1.0, unit="N/m", low=0)
    force: float = param(0.5, unit="N")
    start: float = param(2.0, unit="m")
    period: float = param(0.5, unit="s", low=1e-3)
    process_std: float = param(0.05, unit="m", low=0)
    measurement_std: float = param(0.5, unit="m", low=1e-9)
    impulse_fraction: float = param(0.3, low=0, high=1)
    impulse_alpha: float = param(1.8, low=0.1, high=2)
    impulse_beta: float = param(1.0, low=-1, high=1)
    impulse_scale: float = param(10.0, low=0, doc="in measurement_std")
    impulse_location: float = param(-3.0, doc="in measurement_std")


@dataclass(frozen=True)
class Scenario:
    """Everything that the simulated sensors share. Parts that are left out are simply not simulated."""

    environment: Environment = param(Environment())
    vehicle: Vehicle | None = param(None)
    hydrophones: Hydrophones = param(Hydrophones())
    pingers: tuple[Pinger, ...] = param(())
    buoys: Buoys | None = param(None)
    sonar: Sonar | None = param(None)
    moorings: tuple[Mooring, ...] = param(())
    start_time: int = param(1_780_272_000, unit="s since 1970", low=1)
    duration: float = param(120.0, unit="s", low=0.1)
    seed: int = param(1, low=0)

    def __post_init__(self) -> None:
        for name, place in self._places():
            self.environment.check_inside(name, place)
        for pinger in self.pingers if self.vehicle else ():
            self._check_band(pinger)

    def _check_band(self, pinger: Pinger) -> None:
        name, high, half = (
            f"pinger {pinger.id}: band_high must be",
            pinger.band_high,
            0.5 * self.hydrophones.sample_rate,
        )
        if high >= half:
            raise ValueError(f"{name} below half the hydrophones' sample_rate, {half:g} Hz, got {high:g} Hz")
        if high < 1e3 and high * pinger.pulse_length < 10:
            raise ValueError(f"{name} in Hz, got {high:g} Hz, of which not even 10 cycles fit the pulse_length")

    def _places(self) -> Iterator[tuple[str, tuple[float, float, float]]]:
        """What must lie in the water and within the walls."""
        if self.vehicle:
            z = self.vehicle.z
            for k, point in enumerate(self.vehicle.waypoints):
                yield f"vehicle: waypoint {k}", (point.x, point.y, z)
                yield "hydrophones", (point.x, point.y, z + self.hydrophones.array_position[2])
        for pinger in self.pingers:
            yield f"pinger {pinger.id}", (pinger.x, pinger.y, pinger.z)
        for node in self.buoys.nodes if self.buoys else ():
            yield f"buoy {node.id}", (node.x, node.y, node.z)

    @property
    def start_ns(self) -> int:
        """The first instant."""
        return self.start_time * 1_000_000_000

    def t_ns(self, time: float) -> int:
        """Integer nanoseconds of a time in s after the start."""
        return self.start_ns + round(time * 1e9)

    def rng(self, *key: int) -> np.random.Generator:
        """The random numbers of one sensor (and frame): the same for the same seed and key, whatever else runs."""
        return np.random.default_rng([self.seed, *key])


def find_scenario(name: str, base: Path) -> Path:
    """The file of a scenario: a path, taken from `base` when relative, or the name of one that comes with the package.

    Raises:
        ValueError: there is none.
    """
    if (base / name).is_file():
        return (base / name).resolve()
    try:
        return resource(f"config/{name}/scenario.yaml")
    except FileNotFoundError:
        raise ValueError(f"scenario '{name}' is neither a file below {base} nor one of the package's") from None


def load_scenario(path: Path) -> Scenario:
    """Reads and checks a scenario file.

    Raises:
        ValueError: one sentence naming the file, the key and what is allowed.
    """
    return build(Scenario, load_yaml(path, "scenario"), f"scenario {path}")
