"""Monte Carlo trials of the bearing node, and the Cramer-Rao bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.bearing.config import BearingConfig
from ...core.bearing.estimator import BearingEstimator
from ...core.geometry import wrap_angle
from ...core.types import Array
from ...sim.acoustics import pulse
from ...sim.scenario import Pinger
from .ping_scene import PingScene

FILTERS = ("none", "particle", "histogram")
SNRS_DB = (0.0, 10.0, 20.0, 30.0)
PINGS = 125  # per run and SNR
SWEEP_DEG = (35.0, 145.0)
SWEEP_RATE_DEG = 3.0  # per s
FRAME_NS = 100_000_000
SWEEP_PINGS = 367  # at 10 per s: once over the sweep
GROSS_DEG = 5.0
POSITIONS = 21  # 1.5 m apart (Shin et al. 2013, fig. 15)
POSITION_PINGS = 50
SETTLING = 1.0  # s, left out
_CLEAN, _ECHOES, _POSITION = 1, 2, 3  # keep the random numbers of the parts apart


@dataclass(frozen=True)
class MultipathChannel:
    """A multipath channel with its pinger."""

    band: tuple[float, float]
    snr_db: float
    impulses: bool

    @property
    def scene(self) -> PingScene:
        """Echoes from surface and seabed."""
        return PingScene(self.band, multipath=True, impulses=self.impulses)


WIDE = MultipathChannel((20e3, 30e3), 0.0, True)
NARROW = MultipathChannel((24e3, 26e3), 10.0, False)
CASES = (WIDE, NARROW)


@dataclass(frozen=True)
class PublishedBearing:
    """A published bearing; its error is against the angle that the true TDOA stands for."""

    filter: str
    time: float  # s after the first frame's begin
    bearing: float  # rad
    std: float  # rad, as published
    error: float  # rad


@dataclass(frozen=True, eq=False)
class BearingErrors:
    """Of all bearings that were published for `pings` pings."""

    pings: int
    errors: Array  # (n,) rad
    stds: Array  # (n,) rad, as published

    @property
    def rmse_deg(self) -> float:
        """Of all, wrong carrier cycles included."""
        return math.degrees(math.sqrt(float(np.mean(np.square(self.errors)))))

    @property
    def robust_deg(self) -> float:
        """1.4826 x median absolute deviation."""
        return math.degrees(1.4826 * float(np.median(np.abs(self.errors - np.median(self.errors)))))

    @property
    def median_deg(self) -> float:
        """Of the absolute errors."""
        return math.degrees(float(np.median(np.abs(self.errors))))

    @property
    def gross_fraction(self) -> float:
        """Share of errors over 5 degrees."""
        return float(np.mean(np.abs(self.errors) > math.radians(GROSS_DEG)))

    @property
    def within_2_sigma(self) -> float:
        """Share of errors below twice the published standard deviation; 0.954 if normal and honest."""
        return float(np.mean(np.abs(self.errors) < 2 * self.stds))

    @property
    def heard(self) -> float:
        """Bearings per ping."""
        return self.errors.size / self.pings


def clean_scene() -> PingScene:
    """One path, white noise, the linear chirp of 10 ms from 20 to 30 kHz."""
    return PingScene((20e3, 30e3), multipath=False, impulses=False)


def estimator(scene: PingScene, filter_: str, seed: int) -> BearingEstimator:
    """The node's core with its defaults, without odometry."""
    low, high = scene.band
    config = BearingConfig(source_ids=("pinger",), band_low=(low,), band_high=(high,), filter=filter_, seed=seed)
    return BearingEstimator(config, scene.info)


def clean_errors(snr_db: float, runs: int, seed: int) -> BearingErrors:
    """Near broadside, 85 to 95 degrees, each ping on its own."""
    scene = clean_scene()
    heard: list[PublishedBearing] = []
    for run in range(runs):
        rng = np.random.default_rng([seed, _CLEAN, round(10 * snr_db), run])
        course = np.radians(rng.uniform(85.0, 95.0, PINGS))
        heard += bearings(scene, snr_db, course, {"none": estimator(scene, "none", seed)}, rng)
    return _errors(PINGS * runs, heard)


def echo_errors(
    case: MultipathChannel, runs: int, seed: int, progress: Callable[[float], None]
) -> dict[str, BearingErrors]:
    """Every filter on the same pings of a source that sweeps to and fro, the filters restarted in each run."""
    heard: list[PublishedBearing] = []
    for run in range(runs):
        heard += one_course(case, run, seed)[1]
        progress((run + 1) / runs)
    return {name: _errors(SWEEP_PINGS * runs, [h for h in heard if h.filter == name]) for name in FILTERS}


def one_course(case: MultipathChannel, run: int, seed: int) -> tuple[Array, list[PublishedBearing]]:
    """(SWEEP_PINGS,) azimuths in rad of a run, and what is heard by every filter."""
    rng = np.random.default_rng([seed, _ECHOES, round(case.band[0]), run])
    scene, course = case.scene, course_of(rng)
    filters = {name: estimator(scene, name, seed + run) for name in FILTERS}
    return course, list(bearings(scene, case.snr_db, course, filters, rng))


def course_of(rng: np.random.Generator) -> Array:
    """(SWEEP_PINGS,) azimuths in rad: to and fro at an even rate, from anywhere, either way."""
    first, last = SWEEP_DEG
    width, step = last - first, SWEEP_RATE_DEG * FRAME_NS * 1e-9
    phase = (rng.uniform(0.0, 2 * width) + step * np.arange(SWEEP_PINGS)) % (2 * width)
    return np.asarray(np.radians(first + np.minimum(phase, 2 * width - phase)))


def map_positions() -> Array:
    """(2, POSITIONS) x and y in m on a line 41.2 m abeam, from right to left: bearings from 70 to 110 degrees."""
    along = 1.5 * (POSITIONS // 2 - np.arange(POSITIONS))
    return np.stack([along, np.full(POSITIONS, along[0] / math.tan(math.radians(20.0)))])


def position_bearings(filter_: str, seed: int) -> Array:
    """(POSITIONS, 2) mean and standard deviation in rad of the bearings, the filter restarted at each position."""
    rows = []
    for k, (x, y) in enumerate(map_positions().T):
        scene = PingScene(WIDE.band, distance=math.hypot(x, y), multipath=True, impulses=WIDE.impulses)
        rng, still = np.random.default_rng([seed, _POSITION, k]), np.full(POSITION_PINGS, math.atan2(y, x))
        heard = bearings(scene, WIDE.snr_db, still, {filter_: estimator(scene, filter_, seed)}, rng)
        found = np.array([h.bearing for h in heard if h.time > SETTLING])
        rows.append((found.mean(), found.std()))
    return np.array(rows)


def bearings(
    scene: PingScene, snr_db: float, course: Array, filters: Mapping[str, BearingEstimator], rng: np.random.Generator
) -> Iterator[PublishedBearing]:
    """What every filter makes of one ping per azimuth, ten per second."""
    begin = scene.info.t_ns
    for k, azimuth in enumerate(course):
        frame, truth = scene.frame(azimuth, snr_db, rng, begin + k * FRAME_NS), scene.bearing(azimuth)
        for name, state in filters.items():
            for _, b in state.process(frame):
                yield PublishedBearing(
                    name, (b.t_ns - begin) * 1e-9, b.bearing, math.sqrt(b.variance), wrap_angle(b.bearing - truth)
                )


def bearing_bounds(scene: PingScene, snr_db: float) -> tuple[float, float]:
    """Cramer-Rao bounds in rad at broadside: waveform unknown, waveform known (docs/bearing.md, eq. 9 and 10)."""
    noise = scene.noise_std(snr_db)
    omega, snr = spectrum(scene, noise)
    unknown = 1.0 / math.sqrt(2.0 * float(np.sum(omega**2 * snr**2 / (1.0 + 2.0 * snr))))
    known = 1.0 / math.sqrt(float(np.sum(omega**2 * snr)))
    scale = scene.sound_speed / scene.spacing
    return scale * unknown, scale * known


def spectrum(scene: PingScene, noise_std: float) -> tuple[Array, Array]:
    """Angular frequencies and signal to noise ratio per bin of the pulse's own length; it reaches 1 Pa."""
    low, high = scene.band
    pinger = Pinger(id="p", x=0.0, y=0.0, z=0.0, band_low=low, band_high=high, source_level=1.0)
    size = round(pinger.pulse_length * scene.sample_rate)
    wave = pulse(pinger, np.arange(size) / scene.sample_rate)
    snr = np.square(np.abs(np.fft.rfft(wave))) / (size * noise_std**2)
    omega = np.asarray(2 * np.pi * np.fft.rfftfreq(size, 1.0 / scene.sample_rate), dtype=np.float64)
    return omega, np.asarray(snr, dtype=np.float64)


def _errors(pings: int, heard: Sequence[PublishedBearing]) -> BearingErrors:
    return BearingErrors(pings, np.array([h.error for h in heard]), np.array([h.std for h in heard]))
