"""What is wrong with the samples themselves: full scale, a dead channel, a sample rate that the stamps contradict."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ..types import AnyArray, HydrophoneInfo, Samples

_FULL_SCALE = 32767  # counts of the converter
_DEAD = 1e-3  # of the other channel's variance
_RATE_ERROR = 1e-3
_RATE_FRAMES = 50  # frames whose stamps are averaged
_RATE_FEWEST = 20
_LOST_FRAME = 0.2  # share by which a step between stamps differs from the others when a frame is missing


class HydrophoneHealth:
    """Watches frames in stamp order; `faults` says what is wrong now, one sentence each."""

    def __init__(self, info: HydrophoneInfo, memory: float) -> None:
        self._info, self._memory_ns = info, round(memory * 1e9)
        self._t_ns = 0
        self._steps: deque[tuple[int, float]] = deque(maxlen=_RATE_FRAMES)
        self._before = (0, 0)  # stamp and size of the frame before
        self._clipped_ns = [-(1 << 62)] * 2
        self._dead: tuple[int, ...] = ()
        self.full_scale = [0, 0]  # samples at full scale
        self.dead_frames = [0, 0]

    def watch(self, frame: Samples) -> bool:
        """Whether both channels of the frame live."""
        self._t_ns = frame.t_ns
        self._time(frame)
        for k, samples in enumerate((frame.h0, frame.h1)):
            clipped = self._at_full_scale(samples)
            self.full_scale[k] += clipped
            self._clipped_ns[k] = frame.t_ns if clipped else self._clipped_ns[k]
        variances = [_variance(samples) for samples in (frame.h0, frame.h1)]
        loudest = max(variances)
        self._dead = tuple(k for k in (0, 1) if variances[k] <= _DEAD * loudest)
        for k in self._dead:
            self.dead_frames[k] += 1
        return not self._dead

    @property
    def sample_rate(self) -> float:
        """By the stamps, in Hz; NaN until enough frames have come. Steps over missing frames are left out."""
        if len(self._steps) < _RATE_FEWEST:
            return math.nan
        sizes, seconds = np.array(self._steps).T
        usual = np.median(seconds / sizes)
        kept = np.abs(seconds / sizes - usual) < _LOST_FRAME * usual
        return float(sizes[kept].sum() / seconds[kept].sum())

    @property
    def faults(self) -> list[str]:
        """Sentences that name the hydrophone."""
        said = [f"hydrophone {k} is dead: its samples do not vary as the other's do" for k in self._dead]
        if len(self._dead) == 2:
            said = ["hydrophones 0 and 1 are dead: their samples do not vary"]
        for k in (0, 1):
            if self._t_ns - self._clipped_ns[k] < self._memory_ns:
                said.append(f"hydrophone {k} clips: {self.full_scale[k]} samples at full scale so far")
        rate, nominal = self.sample_rate, self._info.sample_rate
        if abs(rate / nominal - 1.0) > _RATE_ERROR:
            said.append(f"sample_rate is {nominal:g} Hz by hydrophones/info and {rate:.6g} Hz by the frames' stamps")
        return said

    def _time(self, frame: Samples) -> None:
        (t_ns, size), self._before = self._before, (frame.t_ns, frame.h0.size)
        if size:
            self._steps.append((size, (frame.t_ns - t_ns) * 1e-9))

    def _at_full_scale(self, samples: AnyArray) -> int:
        """Samples at the largest count, or at the pressure that it stands for."""
        limit = _FULL_SCALE if samples.dtype == np.int16 else _FULL_SCALE * self._info.scale * (1.0 - 1e-6)
        if samples.max() < limit and samples.min() > -limit:
            return 0
        return int(np.count_nonzero(samples >= limit) + np.count_nonzero(samples <= -limit))


def _variance(samples: AnyArray) -> float:
    """In two passes: the difference of two large sums would lose a small one."""
    off = samples.astype(np.float32)
    off -= np.add.reduce(off) / np.float32(off.size)  # half the time of `mean`
    return float(off @ off) / off.size
