"""From frames of samples to the correlation of every ping of every band."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..types import AnyArray, HydrophoneInfo, Samples
from .clicks import click_block, limit_clicks
from .config import ALIKE, Electronics
from .gcc import BandSplitter, Correlation, Correlator, Envelopes, Piece
from .ping import DB, FrameJoiner, Ping, PingDetector, log_energies
from .ping_schedule import PingSchedule, Timing

_GUARD = 0.1  # of a pulse length, correlated before and after the ping
_TAIL = 2.0  # pulse lengths kept of the last frame: one for the ping, the rest to find its onset


@dataclass(frozen=True, eq=False)
class Heard:
    """A ping of one source."""

    source: int
    t_ns: int  # when it reached the middle of the array
    correlation: Correlation
    snr_db: float  # in the band, over the pulse length


class Ear:
    """What tells the pings of one band from their echoes."""

    def __init__(self, timing: Timing) -> None:
        self.schedule = PingSchedule(timing)
        self.echoes = 0  # onsets outside the window of the next ping: echoes, or leakage from other bands

    def pings(self, onsets: list[Ping]) -> Iterator[Ping]:
        """The direct paths' among the onsets of a block."""
        for ping in onsets:
            if self.schedule.is_ping(ping.t_ns):
                yield ping
            else:
                self.echoes += 1


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
        timing: Timing,
        electronics: Electronics = ALIKE,
    ) -> None:
        self._electronics = electronics
        self._info, self._bands, self._max_lag, self._pulse = info, tuple(bands), max_lag, pulse_length
        self._joiner = FrameJoiner(info.sample_rate, _TAIL * pulse_length)
        self._timing = timing
        self.detector = PingDetector(pulse_length, len(bands))
        self.ears = [Ear(timing) for _ in bands]
        self._length = self._joiner.tail
        self._click_block = click_block(info.sample_rate, pulse_length)
        self.clicks = np.zeros(2, int)  # per hydrophone; one at a frame's end counts again with the next
        self._plan()

    @property
    def gaps(self) -> int:
        """Frames that came later than the one before ends: samples were lost."""
        return self._joiner.gaps

    @property
    def overlaps(self) -> int:
        """Frames that began before the one before ends, or that were sent again."""
        return self._joiner.overlaps

    def noise_db(self, source: int) -> float:
        """Noise floor in a source's band, dB re 1 Pa rms; NaN before the first block."""
        return DB * math.log(self.detector.noise_power(source) / 2.0)

    def tune(self, bands: Sequence[tuple[float, float]]) -> None:
        """Listens to other bands from now on; what was learnt in a band that stays is kept."""
        self.check(bands)
        for k, (old, new) in enumerate(zip(self._bands, bands, strict=True)):
            if old != new:
                self.detector.forget(k)
                self.ears[k] = Ear(self._timing)
        self._bands = tuple(bands)
        self._plan()

    def check(self, bands: Sequence[tuple[float, float]]) -> None:
        """Raises ValueError for bands that `tune` would refuse."""
        low, high = np.array(bands).T
        BandSplitter(self._info.sample_rate, low, high, self._length)

    def hear(self, frame: Samples, threshold_db: float, weighting: str, peaks: int) -> Iterator[Heard]:
        """The pings that end in a frame that has been checked.

        Raises:
            ValueError: the frame begins no later than the one before.
        """
        block = self._joiner.join(frame)
        if max(block.h0.size, frame.h0.size + self._joiner.tail) > self._length:
            self._length = frame.h0.size + self._joiner.tail
            self._plan()
        envelopes = self._splitter.split(*self._pressure(block))
        onsets = self.detector.detect(log_energies(envelopes), envelopes.rate, block.t_ns, threshold_db)
        pings, pieces = [], []
        for source, ear in enumerate(self.ears):
            for ping in ear.pings(onsets[source]):
                pings.append(ping)
                pieces.append(self._piece(source, ping, envelopes))
        found = self._correlator.correlate(pieces, weighting, peaks) if pieces else ()
        for ping, piece, correlation in zip(pings, pieces, found, strict=True):
            snr = max(correlation.snr * piece.samples.shape[1] / (self._pulse * envelopes.rate), 1e-30)
            yield Heard(piece.band, ping.t_ns, correlation, DB * math.log(snr))

    def _piece(self, source: int, ping: Ping, envelopes: Envelopes) -> Piece:
        """It ends with the ping: what comes later is echo."""
        pulse = round(self._pulse * envelopes.rate)
        guard = round(_GUARD * pulse)
        samples = envelopes.values[source][:, max(0, ping.start - guard) : ping.start + pulse + guard]
        return Piece(source, samples, self.detector.noise_power(source))

    def _plan(self) -> None:
        low, high = np.array(self._bands).T
        self._splitter = BandSplitter(self._info.sample_rate, low, high, self._length, self._electronics)
        length = math.ceil((1.0 + 2.0 * _GUARD) * self._pulse * self._splitter.rate) + 2
        self._correlator = Correlator(self._splitter, length, self._max_lag)

    def _pressure(self, block: Samples) -> AnyArray:
        """(2, n) Pa, without clicks."""
        channels, scale = (block.h0, block.h1), np.float32(self._info.scale)
        pressure = np.empty((2, block.h0.size), np.result_type(np.float32, *channels))
        for k, samples in enumerate(channels):
            np.multiply(samples, scale if samples.dtype == np.int16 else 1, out=pressure[k])
        limited, counts = limit_clicks(pressure, self._click_block)
        self.clicks += counts
        return limited


# Hz, m, m/s, Pa per count: beyond these the tables of lags would be empty, or fill the memory
_PLAUSIBLE = {"sample_rate": (10.0, 1e7), "spacing": (1e-3, 100.0), "sound_speed": (300.0, 1e4), "scale": (1e-15, 1e6)}


def check_info(info: HydrophoneInfo) -> None:
    """Raises ValueError for an info whose numbers are not positive and finite, or no array's that there is."""
    for name, (low, high) in _PLAUSIBLE.items():
        value = getattr(info, name)
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"hydrophones/info: {name} must be positive and finite, got {value!r}")
        if not low <= value <= high:
            raise ValueError(f"hydrophones/info: {name} must be from {low:g} to {high:g}, got {value!r}")


_LOUDEST = 1e10  # Pa, far beyond any sound; squares of spectra of louder samples overflow


def check_frame(frame: Samples) -> None:
    """Raises ValueError for channels of different length, no samples, a wrong type, or no hydrophone's values."""
    if frame.h0.ndim != 1 or frame.h0.shape != frame.h1.shape or frame.h0.size == 0:
        raise ValueError(f"samples h0 and h1 must be two (N,), N > 0, got {frame.h0.shape} and {frame.h1.shape}")
    for name, samples in (("h0", frame.h0), ("h1", frame.h1)):
        if samples.dtype != np.int16 and samples.dtype.kind != "f":
            raise ValueError(f"samples {name} must be int16 counts or float Pa, got {samples.dtype}")
        if samples.dtype.kind != "f" or (samples.max() <= _LOUDEST and samples.min() >= -_LOUDEST):
            continue
        if count := int((~np.isfinite(samples)).sum()):
            raise ValueError(f"samples {name} must be finite, got {count} that are not")
        raise ValueError(f"samples {name} must be within {_LOUDEST:g} Pa, got {np.abs(samples).max():g} Pa")
