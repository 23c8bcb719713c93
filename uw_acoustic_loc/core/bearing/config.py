"""Parameters of the bearing estimator."""

from __future__ import annotations

from dataclasses import dataclass

from ...config import group, param
from .ping_schedule import Timing
from .weighting import WEIGHTINGS


@dataclass(frozen=True)
class Detection:
    """What counts as a ping."""

    false_alarm_rate: float = param(
        0.3, unit="1/h", low=1e-6, high=1e6, doc="pings per source that noise alone makes; sets the threshold"
    )
    threshold: float = param(
        0.0, unit="dB", low=0.0, high=60.0, changeable=True, doc="over the noise floor; 0 = from false_alarm_rate"
    )
    pulse_length: float = param(0.01, unit="s", low=1e-4, high=1.0, doc="of the pings, at most")


@dataclass(frozen=True)
class Schedule:
    """When the next ping of a source is expected."""

    min_period: float = param(0.04, unit="s", low=1e-3, high=100.0, doc="shortest repetition of the pings")
    max_period: float = param(12.0, unit="s", low=2e-3, high=1000.0, doc="longest repetition that is learnt")
    learn_pings: int = param(5, low=3, high=12, doc="pings in a row that make a period")
    max_speed: float = param(5.0, unit="m/s", low=0.0, high=100.0, doc="of approach; widens the next ping's window")

    def __post_init__(self) -> None:
        if self.min_period >= self.max_period:
            raise ValueError(f"min_period must be below max_period {self.max_period:g} s, got {self.min_period:g} s")


@dataclass(frozen=True)
class Correlation:
    """How the two channels are compared."""

    weighting: str = param("cc", choices=WEIGHTINGS, doc="of the cross-correlation, inside the band")
    peaks: int = param(
        24, low=1, high=1000, doc="maxima used; Shin et al. use 4, too few for a band of 2 kHz at 25 kHz"
    )


@dataclass(frozen=True)
class ArrayGeometry:
    """Where the hydrophones are, and what turns a difference of arrival times into an angle."""

    assumed_side: str = param("port", choices=("port", "starboard", "both"), doc="two hydrophones cannot tell")
    array_yaw: float = param(0.0, unit="rad", low=-3.15, high=3.15, doc="of the array's +x in base_link")
    array_position: tuple[float, ...] = param((0.0, 0.0, 0.0), unit="m", length=3, doc="of the array in base_link")
    sound_speed: float = param(0.0, unit="m/s", low=0.0, high=1650.0, doc="0 = from hydrophones/info")
    spacing_scale: float = param(1.0, low=0.5, high=2.0, doc="true spacing over that of hydrophones/info")

    def __post_init__(self) -> None:
        if len(self.array_position) != 3:
            raise ValueError(f"array_position must have 3 elements, got {len(self.array_position)}")

    @property
    def sides(self) -> tuple[int, ...]:
        """+1 for port, -1 for starboard."""
        return {"port": (1,), "starboard": (-1,), "both": (1, -1)}[self.assumed_side]


@dataclass(frozen=True)
class Electronics:
    """What the two channels do to the sound between hydrophone and sample; `uwloc calibrate` measures it."""

    delay_offset: float = param(0.0, unit="s", low=-1e-3, high=1e-3, doc="of channel h0 after h1: all TDOAs are larger")
    invert: str = param("none", choices=("none", "h0", "h1"), doc="the channel that is wired the wrong way round")

    @property
    def signs(self) -> tuple[int, int]:
        """Of both channels."""
        return -1 if self.invert == "h0" else 1, -1 if self.invert == "h1" else 1


ALIKE = Electronics()


@dataclass(frozen=True)
class BearingNoise:
    """What is wrong with each bearing."""

    sound_speed_std: float = param(1.2, unit="m/s", low=0.0, high=100.0, doc="its error is part of every variance")
    elevation_std: float = param(0.05, unit="rad", low=0.0, high=1.5, doc="of the sources off the array's plane; alike")
    phase_std: float = param(0.045, unit="rad", low=0.0, high=3.0, doc="of the carrier, by echoes: averaging leaves it")
    height_std: float = param(0.02, low=0.0, high=1.0, doc="of a correlation maximum's relative height, by echoes")


@dataclass(frozen=True)
class SourcePrior:
    """What is known of a source beforehand, and by how many particles."""

    particles: int = param(2000, low=20, high=1_000_000, doc="at most, per source and side")
    range_min: float = param(10.0, unit="m", low=0.1, doc="of a source")
    range_max: float = param(100.0, unit="m", low=0.2, doc="of a source")
    bearing_rate_std: float = param(0.2, unit="rad/s", low=0.0, high=10.0, doc="of a source, without odometry")

    def __post_init__(self) -> None:
        if self.range_min >= self.range_max:
            raise ValueError(f"range_min must be below range_max {self.range_max:g} m, got {self.range_min:g} m")


@dataclass(frozen=True)
class BearingConfig:
    """The sources with their bands, and what all of them share."""

    source_ids: tuple[str, ...] = param(("a", "b", "c"), doc="names of the pingers, one per band")
    band_low: tuple[float, ...] = param((18e3, 26e3, 34e3), unit="Hz", low=1.0, changeable=True, doc="one per source")
    band_high: tuple[float, ...] = param((24e3, 32e3, 40e3), unit="Hz", low=1.0, changeable=True, doc="one per source")
    filter: str = param("particle", choices=("none", "particle", "histogram"), changeable=True)
    detection: Detection = group(Detection)
    schedule: Schedule = group(Schedule)
    correlation: Correlation = group(Correlation)
    array: ArrayGeometry = group(ArrayGeometry)
    electronics: Electronics = group(Electronics)
    noise: BearingNoise = group(BearingNoise)
    source: SourcePrior = group(SourcePrior)
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

    @property
    def bands(self) -> list[tuple[float, float]]:
        """(low, high) per source, Hz."""
        return list(zip(self.band_low, self.band_high, strict=True))

    def timing(self, sound_speed: float, max_lag: float) -> Timing:
        """Of the pings. Half a pulse length of jitter: nearer echoes cannot be separated from the ping anyway.

        A period learnt while the source comes nearer changes by twice the speed when it goes away. In a wide array the
        second hydrophone hears a ping up to `max_lag` after the first.
        """
        s = self.schedule
        jitter, drift = 0.5 * self.detection.pulse_length, 2.0 * s.max_speed / sound_speed
        return Timing(jitter, drift, max(s.min_period, 1.2 * max_lag), s.max_period, s.learn_pings)
