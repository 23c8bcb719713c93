"""The bearing of a ping by the differences of its arrival times at four hydrophones: numpy, and no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from uw_acoustic_loc.config import param
from uw_acoustic_loc.core.types import AnyArray, Array, Bearing


@dataclass(frozen=True, eq=False)
class FourSamples:
    """A frame of all four hydrophones (FourSamples.msg)."""

    t_ns: int  # of the first sample
    h0: AnyArray  # (N,) float32 Pa
    h1: AnyArray
    h2: AnyArray
    h3: AnyArray
    frame_id: str = "base_link"


@dataclass(frozen=True)
class FourBearingConfig:
    """Parameters; the hydrophones may stand anywhere, but not all on one line."""

    source_id: str = param(doc="the pinger's name in sources/<id>/bearing")
    sound_speed: float = param(unit="m/s", low=1350.0, high=1650.0)
    sample_rate: float = param(100e3, unit="Hz", low=1e3, high=1e6)
    x: tuple[float, ...] = param((0.1, -0.1, -0.1, 0.1), unit="m", length=4, doc="of each hydrophone in base_link")
    y: tuple[float, ...] = param((0.1, 0.1, -0.1, -0.1), unit="m", length=4, doc="of each hydrophone in base_link")
    band_low: float = param(20e3, unit="Hz", low=1.0)
    band_high: float = param(30e3, unit="Hz", low=1.0)
    snr_min: float = param(3.0, low=0.1, changeable=True, doc="in the band, of a frame with a ping")

    def __post_init__(self) -> None:
        if not self.band_low < self.band_high <= self.sample_rate / 2:
            raise ValueError(
                f"band_low, band_high must rise and end by {self.sample_rate / 2:g} Hz, half the sample rate,"
                f" got {self.band_low:g}, {self.band_high:g}"
            )
        if np.linalg.matrix_rank(_centred(self), tol=1e-6) < 2:
            raise ValueError(f"x, y must not put all hydrophones on one line, got {list(self.x)}, {list(self.y)}")


def bearing_of(frame: FourSamples, config: FourBearingConfig) -> Bearing | None:
    """The bearing of the frame's ping, as a plane wave; None when there is none, ValueError when a hydrophone is dead.

    The slowness (2,) that fits the arrival times best, and from its covariance the bearing's variance: the errors of
    the arrival times are independent, each of half the variance of a time difference (Knapp and Carter 1976, for one
    signal-to-noise ratio in the whole band).
    """
    spectra, omega = _in_band(np.stack([frame.h0, frame.h1, frame.h2, frame.h3]), config)
    delays, snr = _delays(spectra, omega, config)
    if snr < config.snr_min:
        return None
    times, positions = delays - delays.mean(), _centred(config)
    inverse = np.linalg.inv(positions.T @ positions)
    x, y = -inverse @ positions.T @ times  # towards the source
    across = np.array([-y, x]) / math.hypot(x, y)
    time_var = (1 + 2 * snr) / (4 * snr**2 * np.sum(omega**2))
    variance = time_var * across @ inverse @ across / (x * x + y * y)
    middle = np.array([np.mean(config.x), np.mean(config.y), 0.0])
    return Bearing(frame.t_ns, math.atan2(y, x), float(variance), middle, frame.frame_id)


def _centred(config: FourBearingConfig) -> Array:
    """(4, 2) hydrophones relative to their middle."""
    positions = np.stack([config.x, config.y], axis=1)
    return positions - positions.mean(axis=0)


def _in_band(samples: AnyArray, config: FourBearingConfig) -> tuple[AnyArray, Array]:
    """(4, bins) spectra and (bins,) angular frequencies in rad/s."""
    frequencies = np.fft.rfftfreq(samples.shape[1], 1 / config.sample_rate)
    band = (frequencies >= config.band_low) & (frequencies <= config.band_high)
    return np.fft.rfft(samples)[:, band], 2 * np.pi * frequencies[band]


def _delays(spectra: AnyArray, omega: Array, config: FourBearingConfig) -> tuple[Array, float]:
    """(4,) how much later in s each hears the same as the first, by the peaks of correlation; and by these the SNR."""
    powers = np.sum(np.abs(spectra) ** 2, axis=1)
    if not np.all(powers > 0):
        raise ValueError(f"all four hydrophones must have a sound in the band, got powers {powers.tolist()}")
    longest = 1.1 * math.hypot(np.ptp(config.x), np.ptp(config.y)) / config.sound_speed
    step = 0.05 / config.band_high  # s, fine enough for a parabola
    lags = np.arange(-longest, longest, step)
    correlation = np.real(np.exp(1j * np.outer(lags, omega)) @ (np.conj(spectra[0]) * spectra).T)  # (lags, 4)
    k = np.clip(np.argmax(correlation, axis=0), 1, len(lags) - 2)
    before, peak, after = (correlation[k + side, range(4)] for side in (-1, 0, 1))
    off = 0.5 * (before - after) / (before - 2 * peak + after)
    coherence = (peak - 0.25 * (before - after) * off) / np.sqrt(powers[0] * powers)
    mean = float(np.mean(coherence[1:]))
    return lags[k] + off * step, mean / max(1 - mean, 1e-9)
