"""Bearings of several pingers from the samples of two hydrophones (Shin et al. 2013; Choi, Lee, Choi 2016)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..config import param
from .bearing_filter import HistogramFilter, LastPeak, ParticleFilter, PeakLikelihood, angle_variance
from .gcc import WEIGHTINGS
from .geometry import wrap_angle
from .listener import Heard, Listener, check_info
from .types import Bearing, HydrophoneInfo, Odometry, Particles, Samples

_STALE_NS = 500_000_000  # odometry older than this says nothing about the motion
_HEADING_STD = 0.03  # rad/s, errors of the yaw rate and of all else that the motion model leaves out
_SHOWN = 200  # particles of a display cloud


@dataclass(frozen=True)
class BearingConfig:
    """Parameters of the bearing estimator."""

    source_ids: tuple[str, ...] = param(("a", "b", "c"), doc="names of the pingers, one per band")
    band_low: tuple[float, ...] = param((18e3, 26e3, 34e3), unit="Hz", low=1.0, changeable=True, doc="one per source")
    band_high: tuple[float, ...] = param((24e3, 32e3, 40e3), unit="Hz", low=1.0, changeable=True, doc="one per source")
    filter: str = param("particle", choices=("none", "particle", "histogram"))
    weighting: str = param("cc", choices=WEIGHTINGS, doc="of the cross-correlation, inside the band")
    assumed_side: str = param("port", choices=("port", "starboard", "both"), doc="two hydrophones cannot tell")
    array_yaw: float = param(0.0, unit="rad", low=-3.15, high=3.15, doc="of the array's +x in base_link")
    array_position: tuple[float, ...] = param((0.0, 0.0, 0.0), unit="m", length=3, doc="of the array in base_link")
    sound_speed: float = param(0.0, unit="m/s", low=0.0, high=1650.0, doc="0 = from hydrophones/info")
    sound_speed_std: float = param(1.0, unit="m/s", low=0.0, high=100.0, doc="its error is part of every variance")
    tdoa_std_floor: float = param(4e-7, unit="s", low=0.0, high=1.0, doc="what averaging leaves: echoes, spacing")
    height_std: float = param(0.02, low=0.0, high=1.0, doc="of a correlation maximum's relative height, by echoes")
    peaks: int = param(
        24, low=1, high=1000, doc="maxima used; Shin et al. use 4, too few for a band of 2 kHz at 25 kHz"
    )
    threshold: float = param(2.0, unit="dB", low=0.1, high=60.0, changeable=True, doc="of a ping over the noise floor")
    pulse_length: float = param(0.01, unit="s", low=1e-4, high=1.0, doc="of the pings")
    min_period: float = param(0.05, unit="s", low=1e-3, high=100.0, doc="what comes sooner after a ping is its echo")
    particles: int = param(2000, low=20, high=1_000_000, doc="per source and side")
    range_min: float = param(10.0, unit="m", low=0.1, doc="of a source")
    range_max: float = param(100.0, unit="m", low=0.2, doc="of a source")
    bearing_rate_std: float = param(0.2, unit="rad/s", low=0.0, high=10.0, doc="of a source, without odometry")
    seed: int = param(1, low=0)

    def __post_init__(self) -> None:
        n = len(self.source_ids)
        if n == 0 or len(set(self.source_ids)) < n:
            raise ValueError(f"source_ids must be one or more different names, got {list(self.source_ids)}")
        if len(self.band_low) != n or len(self.band_high) != n:
            sizes = f"{len(self.band_low)} and {len(self.band_high)}"
            raise ValueError(f"band_low and band_high must have {n} elements, one per source, got {sizes}")
        for name, (low, high) in zip(self.source_ids, self.bands, strict=True):
            if low >= high:
                raise ValueError(f"band_low of source {name} must be below its band_high {high:g} Hz, got {low:g} Hz")
        if len(self.array_position) != 3:
            raise ValueError(f"array_position must have 3 elements, got {len(self.array_position)}")
        if self.range_min >= self.range_max:
            raise ValueError(f"range_min must be below range_max {self.range_max:g} m, got {self.range_min:g} m")

    @property
    def bands(self) -> list[tuple[float, float]]:
        """(low, high) per source, Hz."""
        return list(zip(self.band_low, self.band_high, strict=True))

    @property
    def sides(self) -> tuple[int, ...]:
        """+1 for port, -1 for starboard."""
        return {"port": (1,), "starboard": (-1,), "both": (1, -1)}[self.assumed_side]


BearingFilter = LastPeak | HistogramFilter | ParticleFilter


class SourceTrack:
    """One pinger: a filter per assumed side, and its counts."""

    def __init__(self, filters: dict[int, BearingFilter]) -> None:
        self.filters = filters
        self.pings = self.clipped = 0
        self.snr_db = math.nan
        self.heard_ns = 0  # of the last ping
        self.state_ns = 0  # of the filters

    @property
    def std(self) -> float:
        """rad, of the first side's bearing as it is known now."""
        return math.sqrt(next(iter(self.filters.values())).estimate()[1])


class BearingEstimator:
    """Bearings from frames in stamp order; `move` gives it the odometry between them.

    Raises:
        ValueError: an info that is not positive, or a band beyond half its sample rate.
    """

    def __init__(self, config: BearingConfig, info: HydrophoneInfo) -> None:
        check_info(info)
        self._config, self._info = config, info
        self._sound_speed = config.sound_speed or info.sound_speed
        max_lag = info.spacing / self._sound_speed
        self.listener = Listener(info, config.bands, max_lag, config.pulse_length, config.min_period)
        self.tracks = [SourceTrack({s: self._filter(k, s) for s in config.sides}) for k in range(len(config.bands))]
        self._max_lag = max_lag
        self._odometry: Odometry | None = None
        self.frames, self.begin_ns, self.end_ns = 0, 0, 0

    def change(self, config: BearingConfig) -> None:
        """Takes over other bands and another threshold; the filters stay."""
        if config.bands != self._config.bands:
            self.listener.tune(config.bands)
        self._config = config

    def move(self, odometry: Odometry) -> None:
        """The vehicle's motion from now on.

        Raises:
            ValueError: a velocity that is not finite.
        """
        if not (np.isfinite(odometry.linear).all() and np.isfinite(odometry.angular).all()):
            raise ValueError(f"odometry twist must be finite, got {odometry.linear} and {odometry.angular}")
        self._odometry = odometry

    def process(self, frame: Samples) -> Iterator[tuple[int, Bearing]]:
        """(source, bearing) of every ping that ends in the frame, in time order per source, port before starboard."""
        c = self._config
        heard = list(self.listener.hear(frame, c.threshold, c.weighting, c.peaks))
        self._count(frame)
        for ping in heard:
            yield from self._bearings(ping)
        for track in self.tracks:
            self._predict(track, self.end_ns - round(2e9 * c.pulse_length))

    def cloud(self, source: int, t_ns: int) -> Particles | None:
        """At most 200 particles of a source in base_link, for display; None without a particle filter."""
        clouds = [(s, *f.cloud) for s, f in self.tracks[source].filters.items() if isinstance(f, ParticleFilter)]
        if not clouds:
            return None
        step = math.ceil(sum(w.size for _, _, w in clouds) / _SHOWN)
        x = np.concatenate([xy[0, ::step] for _, xy, _ in clouds])
        y = np.concatenate([s * xy[1, ::step] for s, xy, _ in clouds])
        weight = np.concatenate([w[::step] / w[::step].sum() for _, _, w in clouds]) / len(clouds)
        cos, sin = math.cos(self._config.array_yaw), math.sin(self._config.array_yaw)
        px, py, pz = self._config.array_position
        z = np.full(x.size, pz)
        return Particles(t_ns, px + cos * x - sin * y, py + sin * x + cos * y, z, weight)

    def _filter(self, source: int, side: int) -> BearingFilter:
        c = self._config
        if c.filter == "none":
            return LastPeak()
        if c.filter == "histogram":
            return HistogramFilter(self._info.spacing, self._sound_speed)
        rng = np.random.default_rng([c.seed, source, side + 1])
        ranges = (c.range_min, c.range_max)
        return ParticleFilter(self._info.spacing, self._sound_speed, ranges, c.particles, rng)

    def _count(self, frame: Samples) -> None:
        self.begin_ns = self.begin_ns or frame.t_ns
        self.end_ns = frame.t_ns + round(1e9 * frame.h0.size / self._info.sample_rate)
        self.frames += 1

    def _bearings(self, ping: Heard) -> Iterator[tuple[int, Bearing]]:
        track, c = self.tracks[ping.source], self._config
        likelihood = PeakLikelihood.of(ping.correlation, c.tdoa_std_floor, c.height_std, self._max_lag)
        track.pings += 1
        track.clipped += bool(abs(ping.correlation.tdoas[0]) > self._max_lag)
        track.snr_db, track.heard_ns = ping.snr_db, ping.t_ns
        self._predict(track, ping.t_ns)
        for state in track.filters.values():
            state.update(likelihood)
        for side, state in track.filters.items():
            theta, variance = state.estimate()
            bearing = wrap_angle(c.array_yaw + side * theta)
            yield ping.source, Bearing(ping.t_ns, bearing, self._honest(theta, variance), np.array(c.array_position))

    def _honest(self, theta: float, variance: float) -> float:
        """The filter's variance, which averaging makes too small, with the errors that all pings share."""
        floor = angle_variance(theta, self._config.tdoa_std_floor / self._max_lag)
        scale = angle_variance(theta, abs(math.cos(theta)) * self._config.sound_speed_std / self._sound_speed)
        return max(variance, floor) + scale

    def _predict(self, track: SourceTrack, t_ns: int) -> None:
        """Moves the filters to an instant; the spread grows with the time since the last ping, not with its root."""
        if track.state_ns == 0 or t_ns <= track.state_ns:
            track.state_ns = max(track.state_ns, t_ns)
            return
        dt, since = (t_ns - track.state_ns) * 1e-9, max(0, track.state_ns - track.heard_ns) * 1e-9
        turn, move, rate_std = self._motion(t_ns, dt)
        spread = rate_std * math.sqrt((since + dt) ** 2 - since**2)
        for side, state in track.filters.items():
            state.predict(side * turn, (move[0], side * move[1]), spread)
        track.state_ns = t_ns

    def _motion(self, t_ns: int, dt: float) -> tuple[float, tuple[float, float], float]:
        """Turn and move of the array in its own axes, and the bearing rate that they leave open."""
        odometry, c = self._odometry, self._config
        if odometry is None or abs(t_ns - odometry.t_ns) > _STALE_NS:
            return 0.0, (0.0, 0.0), c.bearing_rate_std
        yaw_rate = float(odometry.angular[2])
        vx = float(odometry.linear[0]) - yaw_rate * c.array_position[1]
        vy = float(odometry.linear[1]) + yaw_rate * c.array_position[0]
        cos, sin = math.cos(c.array_yaw), math.sin(c.array_yaw)
        move = ((cos * vx + sin * vy) * dt, (cos * vy - sin * vx) * dt)
        parallax = 0.0 if c.filter == "particle" else math.hypot(vx, vy) / (c.range_min * math.sqrt(3.0))
        return yaw_rate * dt, move, math.hypot(_HEADING_STD, parallax)
