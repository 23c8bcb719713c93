"""Bearings of several pingers from the samples of two hydrophones (Shin et al. 2013; Choi, Lee, Choi 2016)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..geometry import wrap_angle
from ..types import Bearing, HydrophoneInfo, Odometry, Particles, Samples
from .array_motion import ArrayMotion, Displacement
from .config import BearingConfig
from .filters import HistogramFilter, LastPeak, ParticleFilter, PeakLikelihood, angle_variance, lobe_width
from .hydrophone_health import HydrophoneHealth
from .listener import Heard, Listener, check_frame, check_info
from .tdoa_likelihood import OUTLIER, SURE

_HEADING_STD = 0.03  # rad/s, errors of the odometry's turn and of all else that the motion model leaves out
_LARGEST_SPREAD = 0.3  # rad per prediction; a few of them and a source may be anywhere
_USEFUL = 0.3  # rad, standard deviation of a bearing that another filter may begin with
_BELOW, _NEAR = 0.2, 4.0  # share of a turn by which a bearing's may differ, and m of a source
_REMEMBERED = 5.0  # s for which clipping is reported
_SHOWN = 200  # particles of a display cloud

BearingFilter = LastPeak | HistogramFilter | ParticleFilter


class SourceTrack:
    """One pinger: its filter and its counts."""

    def __init__(self, state: BearingFilter) -> None:
        self.filter = state
        self.pings = self.clipped = 0
        self.tdoa_std = 0.0  # s, what averaging leaves
        self.snr_db = math.nan
        self.heard_ns = 0  # of the last ping
        self.state_ns = 0  # of the filter

    @property
    def std(self) -> float:
        """rad, of the bearing as it is known now."""
        return math.sqrt(self.filter.estimate()[1])


class SourceReport(NamedTuple):
    """What diagnostics show of a source."""

    pings: int
    echoes: int
    too_short: int
    rate: float  # Hz
    period: float  # s, 0 while it is not known
    clipped: int
    lobes: int  # carrier cycles among which the TDOA may lie; 1 = no ambiguity
    snr_db: float  # NaN before the first ping, as the next two before the first frame
    noise_db: float  # re 1 Pa rms
    std: float  # rad
    silent: float  # s since the last ping, or the first frame


class BearingEstimator:
    """Bearings from frames in stamp order; `move` gives it the odometry between them.

    Raises:
        ValueError: an info that is not positive, or a band beyond half its sample rate.
    """

    def __init__(self, config: BearingConfig, info: HydrophoneInfo) -> None:
        check_info(info)
        info = replace(info, spacing=info.spacing * config.array.spacing_scale)
        self._config, self._info = config, info
        self._sound_speed = config.array.sound_speed or info.sound_speed
        max_lag = info.spacing / self._sound_speed
        max_lag = info.spacing / self._sound_speed
        self.listener = Listener(info, config, self._sound_speed)
        self.tracks = [SourceTrack(self._filter(k)) for k in range(len(config.bands))]
        self._max_lag = max_lag
        self.health = HydrophoneHealth(info, _REMEMBERED)
        self._motion = ArrayMotion(config.array.array_yaw, config.array.array_position)
        self.frames, self.begin_ns, self.end_ns = 0, 0, 0

    def check(self, config: BearingConfig) -> None:
        """Raises ValueError for a config that `change` would refuse: a band beyond half the sample rate."""
        self.listener.check(config.bands)

    def change(self, config: BearingConfig) -> None:
        """Takes over other bands, threshold and filter.

        A source whose band stays keeps all that is known of it; one whose band changes keeps its bearing, and learns
        its noise floor and period again. Another filter begins with the last one's estimate of each source.
        """
        if config.bands != self._config.bands:
            self.listener.tune(config.bands)
        before, self._config = self._config.filter, config
        if config.filter != before:
            for k, track in enumerate(self.tracks):
                track.filter = self._successor(k, track.filter)

    def report(self, source: int) -> SourceReport:
        """Of a source, up to now."""
        track, listener = self.tracks[source], self.listener
        ear, noise_db = listener.ears[source], listener.noise_db(source) if self.frames else math.nan
        return SourceReport(
            track.pings,
            ear.echoes,
            listener.detector.too_short[source],
            track.pings / max((self.end_ns - self.begin_ns) * 1e-9, 1e-9),
            ear.schedule.period,
            track.clipped,
            listener.lobes(source),
            track.snr_db,
            noise_db,
            track.std if self.frames else math.nan,
            (self.end_ns - (track.heard_ns or self.begin_ns)) * 1e-9,
        )

    def move(self, odometry: Odometry) -> None:
        """The vehicle's motion up to now.

        Raises:
            ValueError: a pose or a velocity that is not finite.
        """
        self._motion.add(odometry)

    def process(self, frame: Samples) -> Iterator[tuple[int, Bearing]]:
        """(source, bearing) of every ping that ends in the frame, in time order per source, port before starboard."""
        c = self._config
        check_frame(frame)
        heard = list(self.listener.hear(frame, c.detection.threshold, c.correlation.weighting, c.correlation.peaks))
        self._count(frame)
        if not self.health.watch(frame):
            heard = []  # the other channel alone has no bearing
        for ping in heard:
            yield from self._bearings(ping)
        present = {ping.source for ping in heard}
        for source, track in enumerate(self.tracks):
            if source not in present:  # one that is heard is brought up to date by its next ping
                self._predict(track, self.end_ns - round(2e9 * c.detection.pulse_length))

    def cloud(self, source: int, t_ns: int) -> Particles | None:
        """At most 200 particles of a source in base_link, for display; None without a particle filter."""
        state = self.tracks[source].filter
        if not isinstance(state, ParticleFilter):
            return None
        (x, y), weight = state.cloud
        step = math.ceil(weight.size / _SHOWN)
        x, y, weight = x[::step], y[::step], weight[::step] / weight[::step].sum()
        if len(sides := self._config.array.sides) == 1:
            y = sides[0] * np.abs(y)
        array = self._config.array
        cos, sin = math.cos(array.array_yaw), math.sin(array.array_yaw)
        px, py, pz = array.array_position
        z = np.full(x.size, pz)
        return Particles(t_ns, px + cos * x - sin * y, py + sin * x + cos * y, z, weight)

    def _filter(self, source: int) -> BearingFilter:
        c = self._config
        if c.filter == "none":
            return LastPeak(c.array.sides[0])
        lobe = lobe_width(self._info.spacing, self._sound_speed, sum(c.bands[source]) / 2)
        if c.filter == "histogram":
            return HistogramFilter(self._info.spacing, self._sound_speed, lobe, c.array.sides)
        rng = np.random.default_rng([c.seed, source])
        ranges, count = (c.source.range_min, c.source.range_max), c.source.particles
        return ParticleFilter(self._info.spacing, self._sound_speed, ranges, count, rng, lobe, c.array.sides)

    def _successor(self, source: int, old: BearingFilter) -> BearingFilter:
        """A filter of the configured kind that begins with another's estimate; from nothing where there is none."""
        new, (theta, variance) = self._filter(source), old.estimate()
        if variance < _USEFUL**2:
            std = self._max_lag * max(math.sin(theta), math.sqrt(variance)) * math.sqrt(variance)
            new.update(PeakLikelihood(np.array([self._max_lag * math.cos(theta)]), np.ones(1), std, self._max_lag))
        return new

    def _count(self, frame: Samples) -> None:
        self.begin_ns = self.begin_ns or frame.t_ns
        self.end_ns = frame.t_ns + round(1e9 * frame.h0.size / self._info.sample_rate)
        self.frames += 1

    def _bearings(self, ping: Heard) -> Iterator[tuple[int, Bearing]]:
        """The correlation gives the bearing at the ping's middle; the turn since its beginning is taken back."""
        track, c = self.tracks[ping.source], self._config
        phase_std = c.noise.phase_std / math.sqrt(max(ping.correlation.curvature, 1.0))
        track.tdoa_std = math.hypot(phase_std, ping.echo_std)
        outlier = SURE if self.listener.lobes(ping.source) == 1 else OUTLIER
        likelihood = PeakLikelihood.of(ping.correlation, track.tdoa_std, c.noise.height_std, self._max_lag, outlier)
        track.pings += 1
        track.clipped += bool(abs(ping.correlation.tdoas[0]) >= self._max_lag)
        track.snr_db = ping.snr_db
        middle_ns = ping.t_ns + round(0.5e9 * ping.length)
        self._predict(track, middle_ns)
        track.heard_ns = middle_ns
        turn = self._motion.between(ping.t_ns, middle_ns).turn
        track.filter.update(likelihood)
        theta, variance = track.filter.estimate()
        honest = self._honest(theta, variance, track.tdoa_std)
        for side in c.array.sides:
            bearing = wrap_angle(c.array.array_yaw + side * theta + turn)
            yield ping.source, Bearing(ping.t_ns, bearing, honest, np.array(c.array.array_position))

    def _honest(self, theta: float, variance: float, tdoa_std: float) -> float:
        """The filter's variance, which averaging makes too small, with the errors that all pings share."""
        floor = angle_variance(theta, tdoa_std / self._max_lag)
        c = self._config
        elevation = math.sqrt(3.0) / 2.0 * c.noise.elevation_std**2  # root mean square of 1 - cos
        scale = math.hypot(c.noise.sound_speed_std / self._sound_speed, elevation)  # of cos(theta)
        return max(variance, floor) + angle_variance(theta, abs(math.cos(theta)) * scale)

    def _predict(self, track: SourceTrack, t_ns: int) -> None:
        """Moves the filters to an instant; the spread grows with the time since the last ping, not with its root."""
        if track.state_ns == 0 or t_ns <= track.state_ns:
            track.state_ns = max(track.state_ns, t_ns)
            return
        dt, since = (t_ns - track.state_ns) * 1e-9, (track.state_ns - track.heard_ns) * 1e-9 if track.heard_ns else 0.0
        step, c = self._motion.between(track.state_ns, t_ns), self._config
        rate_std = math.hypot(_HEADING_STD, self._unmodelled(track, step, dt))
        rate_std = math.hypot(rate_std, c.source.bearing_rate_std * math.sqrt(step.guessed))
        spread = min(rate_std * math.sqrt((since + dt) ** 2 - since**2), _LARGEST_SPREAD)
        track.filter.predict(step.turn, step.move, spread)
        track.state_ns = t_ns

    def _unmodelled(self, track: SourceTrack, step: Displacement, dt: float) -> float:
        """rad/s, of what the motion model leaves out: the unknown range, and a source that lies deeper.

        Particles have ranges. Where there is no cycle to be lost it costs nothing to allow for a source near and below.
        """
        speed = math.hypot(*step.move) / dt
        if self.listener.lobes(self.tracks.index(track)) == 1:
            return math.hypot(_BELOW * step.turn / dt, speed / _NEAR)
        return 0.0 if self._config.filter == "particle" else speed / (self._config.source.range_min * math.sqrt(3.0))
