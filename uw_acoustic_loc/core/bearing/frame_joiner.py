"""Frames joined to blocks, for pings that straddle a boundary."""

from __future__ import annotations

import math

import numpy as np

from ..types import Samples

_JITTER = 0.015  # s by which the stamps of adjoining frames may disagree
_SHARE = 0.45  # of a frame, alike: a lost one is seen
_FRAMES = 10  # over which the clock of the samples follows the stamps


class FrameJoiner:
    """Puts the tail of the last frame before the next, for pings that straddle the boundary.

    Sound is counted: a frame begins where the one before ended, and its stamp, which the driver's machine sets when it
    finds the time, only corrects the clock of the count, little by little.
    """

    def __init__(self, sample_rate: float, tail: float) -> None:
        self._rate = sample_rate
        self.tail = round(tail * sample_rate)
        self._last: Samples | None = None
        self._begin_ns = 0
        self._counted = 0  # frames since the clock was set
        self._square = 0.0  # s^2
        self.gaps = self.overlaps = 0

    @property
    def jitter(self) -> float:
        """s, root mean square of the stamps against the count of samples."""
        return math.sqrt(self._square)

    def join(self, frame: Samples) -> Samples:
        """The block that ends with the frame; after a gap or an overlap in the stamps it is the frame alone.

        Raises:
            ValueError: the frame begins no later than the last one did.
        """
        if frame.t_ns <= self._begin_ns:
            self.overlaps += 1
            raise ValueError(f"samples must begin after the frame before, at {self._begin_ns} ns, got {frame.t_ns} ns")
        self._begin_ns = frame.t_ns
        block = frame if self._last is None else self._joined(self._last, frame)
        keep = slice(max(0, block.h0.size - self.tail), None)
        t_ns = block.t_ns + round(1e9 * keep.start / self._rate)
        self._last = Samples(t_ns, block.h0[keep], block.h1[keep])
        return block

    def _joined(self, last: Samples, frame: Samples) -> Samples:
        expected = last.t_ns + round(1e9 * last.h0.size / self._rate)
        off = (frame.t_ns - expected) * 1e-9
        allowed = min(_JITTER, _SHARE * frame.h0.size / self._rate)
        if abs(off) > allowed or last.h0.dtype != frame.h0.dtype:
            self.gaps += off > -allowed
            self.overlaps += off < -allowed
            self._counted = 0
            return frame
        self._counted += 1
        self._square += (off**2 - self._square) / min(self._counted, _FRAMES)
        corrected = expected + round(1e9 * off / min(self._counted + 1, _FRAMES))
        t_ns = corrected - round(1e9 * last.h0.size / self._rate)
        return Samples(t_ns, np.concatenate([last.h0, frame.h0]), np.concatenate([last.h1, frame.h1]))
