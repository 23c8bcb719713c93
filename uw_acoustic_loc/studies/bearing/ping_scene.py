"""One ping of a still source at a chosen azimuth and signal-to-noise ratio, for Monte Carlo studies and tests."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from ...core.geometry import angle_from_tdoa, hydrophone_positions
from ...core.types import Array, HydrophoneInfo, Samples
from ...sim.acoustics import absorption, images, pulse, tone_phases
from ...sim.channel import EmittedPulse, Knots, Paths, Reception
from ...sim.noise import add_snaps
from ...sim.scenario import Hydrophones, Pinger
from ...sim.water import Environment

EMISSION = 0.02  # s after the frame's first sample, and a random part of a sample
SNAP_RATE, SNAP_SCALE = 100.0, 10.0  # 1/s, and in standard deviations of the white noise
_T0 = 10**18  # ns


class PingScene:
    """Frames of float32 Pa that hold one ping each; a chirp's direct path has an amplitude of 1 Pa at broadside.

    The array lies 5 m and the source 12 m below the surface of 20 m of water, 60 m apart over ground; neither moves
    during a frame.
    `multipath` adds one image at the surface (-0.7) and one at the seabed (0.4), `impulses` snapping shrimp with
    alpha 1.7, 100 snaps per second of 10 noise standard deviations scale.

    The signal-to-noise ratio is the energy of the direct path in the band over that of the white noise in the band
    during the ping, for each hydrophone; snaps and echoes come on top.
    """

    def __init__(
        self,
        band: tuple[float, float],
        *,
        spacing: float = 0.6,
        sample_rate: float = 1e5,
        frame_length: float = 0.1,
        pulse_length: float = 0.01,
        sound_speed: float = 1500.0,
        depth: float = 20.0,
        array_depth: float = 5.0,
        source_depth: float = 12.0,
        distance: float = 60.0,
        kind: str = "chirp",
        multipath: bool,
        impulses: bool,
    ) -> None:
        self.band, self.spacing, self.sample_rate, self.sound_speed = band, spacing, sample_rate, sound_speed
        self._distance, self._source_depth = distance, source_depth
        self._snap_rate = SNAP_RATE if impulses else 0.0
        self._env = Environment(sound_speed=sound_speed, depth=depth, reflections=int(multipath))
        self._array = Hydrophones(spacing=spacing, sample_rate=sample_rate, frame_length=frame_length)
        self._hydrophones = hydrophone_positions(spacing).T - np.array([[0.0], [0.0], [array_depth]])
        self._absorption = absorption(0.5 * (band[0] + band[1]), self._env)
        reach = self._direct(0.5 * math.pi)[0]
        level = reach * 10 ** (self._absorption * reach / 20)
        self._pinger = Pinger(
            "scene", 0.0, 0.0, -source_depth, *band, pulse_length=pulse_length, source_level=level, pulse=kind
        )
        self._power = _mean_band_power(self._pinger) / level**2
        self._size = round(frame_length * sample_rate)
        self._knots = Knots(self._size, sample_rate)

    @property
    def info(self) -> HydrophoneInfo:
        """The array as its driver describes it."""
        return HydrophoneInfo(_T0, self.sample_rate, self.spacing, self.sound_speed, 1.0)

    def tdoa(self, azimuth: float) -> float:
        """True TDOA in s of the direct path, exact in the near field, source and array at their depths."""
        r0, r1 = self._direct(azimuth)
        return (r0 - r1) / self.sound_speed

    def bearing(self, azimuth: float) -> float:
        """The angle in [0, pi] that the true TDOA stands for: what a perfect estimator reports.

        It is not the azimuth because the source lies deeper than the array: 35 degrees of azimuth are 35.5.
        """
        return angle_from_tdoa(self.tdoa(azimuth), self.spacing, self.sound_speed)[0]

    def noise_std(self, snr_db: float) -> float:
        """Pa per sample of the white noise at which a ping at broadside has the signal-to-noise ratio."""
        share = 2.0 * (self.band[1] - self.band[0]) / self.sample_rate
        return math.sqrt(self._power / share * 10 ** (-snr_db / 10))

    def frame(self, azimuth: float, snr_db: float, rng: np.random.Generator, t_ns: int = _T0) -> Samples:
        """The samples, first one at t_ns; azimuth in rad from the array's +x, counter-clockwise."""
        std = self.noise_std(snr_db)
        pressure = rng.standard_normal((2, self._size), dtype=np.float32)
        pressure *= np.float32(std)
        snaps = Environment(sound_speed=self.sound_speed, snap_rate=self._snap_rate, snap_scale=SNAP_SCALE * std)
        add_snaps(pressure, snaps, self._array, rng)
        phases = tone_phases(self._pinger, rng)
        emission = EMISSION + rng.random() / self.sample_rate
        wave = partial(pulse, self._pinger, phases=phases)
        ping = EmittedPulse(emission, self._pinger.pulse_length, self.sound_speed, wave)
        self._reception(azimuth).add(ping, pressure)
        return Samples(t_ns, pressure[0], pressure[1])

    def _reception(self, azimuth: float) -> Reception:
        count = self._knots.times.size
        positions = np.repeat(self._hydrophones[:, :, None], count, axis=2)
        paths = Paths(*images(self._source(azimuth), self._env), self._absorption)
        return Reception(self._knots, np.tile(self._knots.times, (2, 1)), positions, paths)

    def _direct(self, azimuth: float) -> tuple[float, float]:
        """Distances of the source to both hydrophones, m."""
        r0, r1 = np.linalg.norm(self._source(azimuth)[:, None] - self._hydrophones, axis=0)
        return float(r0), float(r1)

    def _source(self, azimuth: float) -> Array:
        return np.array([self._distance * math.cos(azimuth), self._distance * math.sin(azimuth), -self._source_depth])


def _mean_band_power(pinger: Pinger) -> float:
    """Pa^2 at 1 m, expected over the draws of a noise pulse, which differ by some per cent."""
    rng = np.random.default_rng(0)
    draws = 64 if pinger.pulse == "noise" else 1
    return sum(_band_power(pinger, tone_phases(pinger, rng)) for _ in range(draws)) / draws


def _band_power(pinger: Pinger, phases: Array) -> float:
    """Pa^2 at 1 m in the band, mean over the pulse."""
    rate = 4.0 * pinger.band_high
    age = np.arange(round(pinger.pulse_length * rate)) / rate
    wave = pulse(pinger, age, phases)
    power = np.square(np.abs(np.fft.rfft(wave, 4 * wave.size)))
    freq = np.fft.rfftfreq(4 * wave.size, 1.0 / rate)
    inside = (freq >= pinger.band_low) & (freq <= pinger.band_high)
    return float(np.mean(np.square(wave)) * power[inside].sum() / power.sum())
