"""From frames of samples to the correlation of every ping of every band."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..types import AnyArray, HydrophoneInfo, Samples
from .clicks import click_block, limit_clicks
from .config import BearingConfig
from .detection import DB, Onset, PingDetector
from .first_arrival import FirstArrival, best_window, gates
from .frame_joiner import FrameJoiner
from .gcc import BandSplitter, Correlation, Correlator, Envelopes, Piece
from .ping_schedule import PingSchedule, Timing

_GUARD = 0.1  # of a pulse length, correlated before and after the ping
_MARGIN = 4e3  # Hz on either side of a band, in which a ping's beginning is looked for
_WHOLE = 0.02  # cycles, by which elements half a wavelength apart may be further
_TAIL = 2.0  # pulse lengths kept of the last frame: one for the ping, the rest to find its onset


@dataclass(frozen=True, eq=False)
class Heard:
    """A ping of one source."""

    source: int
    t_ns: int  # when it reached the middle of the array
    correlation: Correlation
    length: float  # s from the ping's beginning, that were correlated
    echo_std: float  # s, of the TDOA by echoes within them
    snr_db: float  # in the band, over the pulse


class Ear:
    """What separates the pings of one band from their echoes, and the part of a ping that they have not reached."""

    def __init__(self, timing: Timing, arrival: FirstArrival) -> None:
        self.schedule, self.arrival = PingSchedule(timing), arrival
        self.echoes = 0  # onsets outside the window of the next ping: echoes, or leakage from other bands

    def pings(self, onsets: list[Onset]) -> Iterator[Onset]:
        """The direct paths' among the onsets of a block."""
        for ping in onsets:
            if self.schedule.is_ping(ping.t_ns, ping.level):
                yield ping
            else:
                self.echoes += 1


class Listener:
    """Takes frames in stamp order; a ping that straddles two frames is heard with the second.

    Raises:
        ValueError: a band beyond half the sample rate.
    """

    def __init__(self, info: HydrophoneInfo, config: BearingConfig, sound_speed: float) -> None:
        self._info, self._bands, self._pulse = info, tuple(config.bands), config.detection.pulse_length
        self._max_lag = info.spacing / sound_speed
        self._joiner = FrameJoiner(info.sample_rate, _TAIL * self._pulse + self._max_lag)
        self._timing, self._phase_std = config.timing(sound_speed, self._max_lag), config.noise.phase_std
        self._electronics = config.electronics
        self._gates = gates(self._pulse, self._max_lag)
        self.detector = PingDetector(
            self._pulse, len(self._bands), config.detection.false_alarm_rate / 3600.0, self._max_lag
        )
        self.ears = [self._ear() for _ in self._bands]
        self._length = self._joiner.tail
        self._click_block = click_block(info.sample_rate, self._pulse)
        self.clicks = np.zeros(2, int)  # per hydrophone; one at a frame's end counts again with the next
        self._plan()

    @property
    def gaps(self) -> int:
        """Frames that came later than the one before ends: samples were lost."""
        return self._joiner.gaps

    @property
    def jitter(self) -> float:
        """s, of the frames' stamps against the count of samples."""
        return self._joiner.jitter

    @property
    def overlaps(self) -> int:
        """Frames that began before the one before ends, or that were sent again."""
        return self._joiner.overlaps

    def noise_db(self, source: int) -> float:
        """Noise floor in a source's band, dB re 1 Pa rms; NaN before the first block."""
        return DB * math.log(self.detector.noise_power(source) / 2.0)

    def lobes(self, source: int) -> int:
        """Carrier cycles among which a source's TDOA may lie; 1 = there is no ambiguity."""
        return max(1, math.ceil(sum(self._bands[source]) * self._max_lag - _WHOLE))

    def tune(self, bands: Sequence[tuple[float, float]]) -> None:
        """Listens to other bands from now on; what was learnt in a band that stays is kept."""
        self.check(bands)
        for k, (old, new) in enumerate(zip(self._bands, bands, strict=True)):
            if old != new:
                self.detector.forget(k)
                self.ears[k] = self._ear()
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
        spectrum, n = self._splitter.spectrum(*self._pressure(block)), block.h0.size
        envelopes = self._splitter.envelopes(spectrum, n)
        end_ns = block.t_ns + round(1e9 * n / self._info.sample_rate)
        due = [ear.schedule.due(block.t_ns, end_ns) for ear in self.ears]
        onsets = self.detector.detect(envelopes, block.t_ns, threshold_db, due)
        pings: list[tuple[int, Onset]] = []
        pieces: list[Piece] = []
        for source, ear in enumerate(self.ears):
            if onsets[source]:
                wide = self._wide.envelopes(spectrum, n, slice(source, source + 1))
                for ping in ear.pings(
                    [self.detector.refined(onset, source, wide, block.t_ns) for onset in onsets[source]]
                ):
                    pings.append((source, ping))
                    pieces += self._pieces(source, ping, wide)
        found = self._correlator.correlate(pieces, weighting, peaks) if pieces else []
        count = len(self._gates) + 1
        for k, (source, ping) in enumerate(pings):
            yield self._heard(source, ping, found[k * count : (k + 1) * count])

    def _pieces(self, source: int, ping: Onset, wide: Envelopes) -> Iterator[Piece]:
        """Windows that begin with the ping, the shortest first; the last ends with it: what comes later is echo."""
        guard = round(_GUARD * self._pulse * wide.rate)
        for length in self._gates:
            yield self._piece(source, ping, wide, ping.start, ping.start + round(length * wide.rate))
        end = ping.start + round((self._pulse + self._max_lag) * wide.rate) + guard
        yield self._piece(source, ping, wide, max(0, ping.start - guard), end)

    def _piece(self, source: int, ping: Onset, wide: Envelopes, begin: int, end: int) -> Piece:
        return Piece(source, wide.values[0][:, begin:end], ping.noise)

    def _heard(self, source: int, ping: Onset, found: list[Correlation]) -> Heard:
        """Of the windows the one that noise and echoes disturb least."""
        frequency = 0.5 * sum(self._bands[source])
        lobes = self.lobes(source)
        choice = self.ears[source].arrival.choose(found, frequency, lobes)
        lengths = (*self._gates, self._pulse)
        overall = found[-1].snr * (1.0 + 2.0 * _GUARD + self._max_lag / self._pulse)
        snr = max(overall, *(part.snr for part in found[:-1]), 1e-30)
        best = best_window(found, choice.number, lobes)
        return Heard(
            source,
            ping.t_ns + round(0.5e9 * abs(best.tdoas[0])),
            best,
            lengths[choice.number],
            choice.echo_std / (2.0 * math.pi * frequency),
            DB * math.log(snr),
        )

    def _ear(self) -> Ear:
        return Ear(self._timing, FirstArrival(len(self._gates) + 1, self._phase_std))

    def _plan(self) -> None:
        low, high = np.array(self._bands).T
        self._splitter = BandSplitter(self._info.sample_rate, low, high, self._length)
        self._wide = BandSplitter(self._info.sample_rate, low, high, self._length, _MARGIN, self._electronics)
        length = math.ceil(((1.0 + 2.0 * _GUARD) * self._pulse + 2.0 * self._max_lag) * self._wide.rate) + 2
        self._correlator = Correlator(self._wide, length, self._max_lag)

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
_PLAUSIBLE = {"sample_rate": (10.0, 1e7), "spacing": (1e-3, 1000.0), "sound_speed": (300.0, 1e4), "scale": (1e-15, 1e6)}


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
