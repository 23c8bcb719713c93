"""From frames of samples to the correlation of every ping of every band."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .gcc import OVERSAMPLING, BandSplitter, Correlation, Correlator, Envelopes
from .ping import DB, FrameJoiner, Ping, PingDetector, log_energies
from .types import AnyArray, HydrophoneInfo, Samples

_GUARD = 0.1  # of a pulse length, correlated before and after the ping
_TAIL = 2.0  # pulse lengths kept of the last frame: one for the ping, the rest to find its onset


@dataclass(frozen=True, eq=False)
class Heard:
    """A ping of one source."""

    source: int
    t_ns: int  # when it reached the middle of the array
    correlation: Correlation
    snr_db: float  # in the band, over the pulse length


class Listener:
    """Takes frames in stamp order; a ping that straddles two frames is heard with the second.

    Raises:
        ValueError: a band beyond half the sample rate.
    """

    def __init__(
        self,
        info: HydrophoneInfo,
        bands: Sequence[tuple[float, float]],
        max_lag: float,
        pulse_length: float,
        min_period: float,
    ) -> None:
        self._info, self._bands, self._max_lag, self._pulse = info, tuple(bands), max_lag, pulse_length
        self._joiner = FrameJoiner(info.sample_rate, _TAIL * pulse_length)
        self._detectors = [PingDetector(pulse_length, min_period) for _ in bands]
        self._length = self._joiner.tail
        self._plan()

    @property
    def gaps(self) -> int:
        """Frames that did not adjoin the one before."""
        return self._joiner.gaps

    def noise_db(self, source: int) -> float:
        """Noise floor in the source's band, dB re 1 Pa rms; NaN before the first block."""
        return DB * math.log(self._detectors[source].noise_power / 2.0)

    def tune(self, bands: Sequence[tuple[float, float]]) -> None:
        """Listens to other bands from now on."""
        before, self._bands = self._bands, tuple(bands)
        try:
            self._plan()
        except ValueError:
            self._bands = before
            self._plan()
            raise

    def hear(self, frame: Samples, threshold_db: float, weighting: str, peaks: int) -> Iterator[Heard]:
        """The pings that end in the frame.

        Raises:
            ValueError: channels of different length, an empty frame, a wrong type, or samples that are not finite.
        """
        _check_frame(frame)
        block = self._joiner.join(frame)
        if max(block.h0.size, frame.h0.size + self._joiner.tail) > self._length:
            self._length = frame.h0.size + self._joiner.tail
            self._plan()
        envelopes = self._splitter.split(self._pressure(block.h0), self._pressure(block.h1))
        energies = log_energies(envelopes)
        for source, detector in enumerate(self._detectors):
            for ping in detector.detect(energies[source], envelopes.rate, block.t_ns, threshold_db):
                yield self._heard(source, ping, envelopes, weighting, peaks)

    def _heard(self, source: int, ping: Ping, envelopes: Envelopes, weighting: str, peaks: int) -> Heard:
        """The correlation ends with the ping: what comes later is echo."""
        pulse = round(self._pulse * envelopes.rate)
        guard = round(_GUARD * pulse)
        segment = envelopes.values[source][:, max(0, ping.start - guard) : ping.start + pulse + guard]
        noise = self._detectors[source].noise_power
        found = self._correlators[source].correlate(segment, noise, weighting, peaks)
        snr = max(found.snr * segment.shape[1] / pulse, 1e-30)
        return Heard(source, ping.t_ns, found, DB * math.log(snr))

    def _plan(self) -> None:
        low, high = np.array(self._bands).T
        self._splitter = BandSplitter(self._info.sample_rate, low, high, self._length)
        rate, step = self._splitter.rate, 1.0 / (OVERSAMPLING * self._info.sample_rate)
        length = math.ceil((1.0 + 2.0 * _GUARD) * self._pulse * rate) + 2
        self._correlators = [
            Correlator(band, float(base), float(width), rate, length, self._max_lag, step)
            for band, base, width in zip(self._bands, self._splitter.base, self._splitter.noise_width, strict=True)
        ]

    def _pressure(self, samples: AnyArray) -> AnyArray:
        return samples * np.float32(self._info.scale) if samples.dtype == np.int16 else samples


def check_info(info: HydrophoneInfo) -> None:
    """Raises ValueError for an info whose numbers are not positive and finite."""
    for name in ("sample_rate", "spacing", "sound_speed", "scale"):
        value = getattr(info, name)
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"hydrophones/info: {name} must be positive and finite, got {value!r}")


def _check_frame(frame: Samples) -> None:
    if frame.h0.ndim != 1 or frame.h0.shape != frame.h1.shape or frame.h0.size == 0:
        raise ValueError(f"samples h0 and h1 must be two (N,), N > 0, got {frame.h0.shape} and {frame.h1.shape}")
    for name, samples in (("h0", frame.h0), ("h1", frame.h1)):
        if samples.dtype != np.int16 and samples.dtype.kind != "f":
            raise ValueError(f"samples {name} must be int16 counts or float Pa, got {samples.dtype}")
        if samples.dtype.kind == "f" and not np.isfinite(samples).all():
            raise ValueError(f"samples {name} must be finite, got {int((~np.isfinite(samples)).sum())} that are not")
