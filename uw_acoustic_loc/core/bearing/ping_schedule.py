"""When the next ping of a source is due: its period and phase, learnt from what was heard.

The direct path arrives first, whatever its level; echoes repeat with the same period. So of all the onsets that repeat,
the direct path's are those after the longest silence.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..types import Array

_REMEMBERED = 32  # onsets
_HEARD = 256  # loud onsets, echoes among them
_ENDS = 6  # latest onsets that a period is looked for from: some of them are strays
_REPEATED = 0.45  # share of the onsets that a period must explain
_AS_GOOD = 0.85  # of the best share, for a shorter period: its multiples explain as much
_REFINEMENTS = 2
_FOLDED = 3  # periods in which an onset must have come to be looked at
_LOOK_BACK = 12  # periods, for the onsets that are always there
_RELIABLE = 0.6  # share of the most reliable one's appearances
_ALPHA, _BETA = 0.5, 0.1  # gains of the phase and of the period
_LONGER = 1.9  # times the known period is not yet twice it, which is what lost pings look like
_LOST = 4  # pings expected in vain, after which strays mean another phase
_FAINTER = 4.6  # of the logarithm of a power: onsets that are fainter by more do not end another's silence
_LEAD = 0.25  # of the longest silence of late, that lies before a direct path's onset
_RECENT = 3.0  # times a silence, for which it counts as of late
_STRAYS = 8  # that are not known to repeat, after which the phase is looked at again


@dataclass(frozen=True)
class Timing:
    """What is known of a source's pings beforehand; times in s."""

    jitter: float  # of an onset
    drift: float  # largest change of the travel time per s, against what it was when the period was learnt
    shortest: float  # period
    longest: float
    pings: int  # in a row that make a period

    def tolerance(self, elapsed: float) -> float:
        """Of a ping that is due `elapsed` after the last."""
        return self.jitter + self.drift * elapsed


class PingSchedule:
    """Tells pings from echoes and leakage. Until a period is known, whatever comes `shortest` after a ping is one."""

    def __init__(self, timing: Timing) -> None:
        self._timing = timing
        self._onsets: deque[float] = deque(maxlen=_REMEMBERED)
        self._heard: deque[tuple[float, float]] = deque(maxlen=_HEARD)  # time and level of all that was loud
        self._silences: deque[tuple[float, float]] = deque()  # time and lead, each shorter than the one before
        self._origin_ns: int | None = None
        self._phase = -1e9  # of the last ping
        self._strays = self._news = 0  # onsets that were no pings since the last look; without those that repeat
        self._echoes: list[float] = []  # s after the ping, the onsets that repeated when last looked at
        self.period = 0.0  # s, 0 while it is not known

    def due(self, begin_ns: int, end_ns: int) -> list[tuple[float, float, float]]:
        """When pings are expected in a stretch of time: first and last s after its begin, and period over their width.

        Nothing while the period is not known.
        """
        self._origin_ns = begin_ns if self._origin_ns is None else self._origin_ns
        if not self.period:
            return []
        begin, end = ((t - self._origin_ns) * 1e-9 for t in (begin_ns, end_ns))
        found, count = [], max(1, math.floor((begin - self._phase) / self.period))
        while (t := self._phase + count * self.period) < end + self.period / 4:
            half = min(self._timing.tolerance(t - self._phase), self.period / 4)
            if t + half > begin and count <= _LOST:
                found.append((t - half - begin, t + half - begin, self.period / (2.0 * half)))
            count += 1
        return found

    def is_ping(self, t_ns: int, level: float = 0.0) -> bool:
        """Takes the next onset, in time order, with the logarithm of its power.

        Echoes follow upon others that are as loud; a direct path's onset stands after a silence.
        """
        self._origin_ns = t_ns if self._origin_ns is None else self._origin_ns
        t = (t_ns - self._origin_ns) * 1e-9
        if not self._leads(t, level):
            return bool(self.period) and self._expected(t, self._timing.jitter / 2)
        self._onsets.append(t)
        if self.period and self._expected(t, math.inf):
            return True
        self._strays += 1
        self._news += not self._repeats(t)
        if not self.period or self._news >= _STRAYS or self._overdue(t):
            return self._learn(t)
        return False

    def _leads(self, t: float, level: float) -> bool:
        """Whether nothing nearly as loud came shortly before, as silences go."""
        lead = t - next((before for before, other in reversed(self._heard) if other > level - _FAINTER), 0.0)
        first = not self._heard
        self._heard.append((t, level))
        while self._silences and t - self._silences[0][0] > _RECENT * self._silences[0][1]:
            self._silences.popleft()
        longest = self._silences[0][1] if self._silences else 0.0
        while self._silences and self._silences[-1][1] <= lead:
            self._silences.pop()
        self._silences.append((t, lead))
        return first or lead >= max(_LEAD * longest, self._timing.shortest)

    def _expected(self, t: float, limit: float) -> bool:
        elapsed = t - self._phase
        count = round(elapsed / self.period)
        off = elapsed - count * self.period
        if count < 1 or abs(off) > min(self._timing.tolerance(elapsed), self.period / 4, limit):
            return False
        self._phase += count * self.period + _ALPHA * off
        self.period += _BETA * off / count
        return True

    def _repeats(self, t: float) -> bool:
        offs = (math.remainder(t - self._phase - echo, self.period) for echo in self._echoes)
        return any(abs(off) < self._timing.jitter for off in offs)

    def _overdue(self, t: float) -> bool:
        return t - self._phase > _LOST * self.period and self._strays > 2

    def _learn(self, t: float) -> bool:
        """Whether the onset at t is a ping by what has been heard so far."""
        self._strays = self._news = 0
        lost = not self.period or t - self._phase > _LOST * self.period
        found = learn(np.array(self._onsets), self._timing, self._timing.longest if lost else _LONGER * self.period)
        if found is not None:
            self.period, phase, self._echoes = found
            now = abs(phase - t) <= min(self._timing.jitter, self.period) / 2
            fresh = phase > self._phase + self.period / 2
            self._phase = t if now else phase
            return fresh and now
        if not lost:
            return False
        self.period, self._echoes = 0.0, []
        if t - self._phase < self._timing.shortest:
            return False
        self._phase = t
        return True


def learn(times: Array, timing: Timing, longest: float) -> tuple[float, float, list[float]] | None:
    """Shortest period, the direct path's last onset, and how long after it the others come that repeat.

    Of onsets (n,) in time order; None if they do not repeat.
    """
    gaps = np.sort(times[-_ENDS:, None] - times, axis=None)
    periods = gaps[(gaps >= timing.shortest) & (gaps <= min(longest, (times[-1] - times[0]) / 2))]
    if times.size < timing.pings or periods.size == 0:
        return None
    shares = _repeated(times, periods, timing)
    if shares.max() < _REPEATED:
        return None
    period = periods.item(np.argmax(shares >= _AS_GOOD * shares.max()))
    for _ in range(_REFINEMENTS):
        period += _later(times, period, timing)
    first, steady = _first_path(times, period, timing)
    return period, first, (steady - first).tolist()


def _repeated(times: Array, periods: Array, timing: Timing) -> Array:
    """Share of the onsets that are followed by another a period (m,) later.

    A follower counts the less the further off it is: among several echoes a wrong period finds one within the tolerance
    as often as not. What chance would do with as many onsets is taken off the share.
    """
    tolerance = np.minimum(timing.jitter + timing.drift * periods, periods / 4)[:, None]
    due = times + periods[:, None]
    off = times.take(_nearest(times, due)) - due
    near = np.maximum(1.0 - np.abs(off) / tolerance, 0.0)
    possible = np.maximum((due <= times[-1] + tolerance).sum(axis=1), 1)
    density = 2.0 * tolerance[:, 0] * times.size / (times[-1] - times[0])
    chance = 1.0 + np.expm1(-density) / density
    shares = np.minimum((near.sum(axis=1) / possible - chance) / (1.0 - chance), 1.0)
    return np.where((near > 0.0).sum(axis=1) >= timing.pings - 1, shares, 0.0)


def _later(times: Array, period: float, timing: Timing) -> float:
    """How much later than a period the onsets that are followed by another are followed, on average."""
    due = times + period
    off = times.take(_nearest(times, due)) - due
    hits = np.abs(off) < min(timing.jitter + timing.drift * period, period / 4)
    return float(off @ hits) / max(int(np.count_nonzero(hits)), 1)


def _first_path(times: Array, period: float, timing: Timing) -> tuple[float, Array]:
    """Of the onsets that repeat, the one after the longest silence: when it came, or was due, in the last period.

    And all of them.
    """
    recent = _folded(times, period, timing.tolerance(0.0))
    back = period * np.arange(1, max(2, min(_LOOK_BACK, math.floor((times[-1] - times[0]) / period))) + 1)
    expected = recent[:, None] - back
    off = np.abs(times[_nearest(times, expected)] - expected)
    often = (off <= np.minimum(timing.jitter + timing.drift * back, period / 4)).mean(axis=1)
    steady = recent[often >= _RELIABLE * often.max()]
    silences = np.diff(steady, prepend=steady[-1] - period)
    first = float(steady[np.argmax(silences)])
    return first if first <= times[-1] else first - period, steady  # due at any moment


def _folded(times: Array, period: float, tolerance: float) -> Array:
    """The onsets of the last periods as they would repeat in the last one: one ping may have failed in it."""
    latest = times[times > times[-1] - _FOLDED * period + tolerance]
    due = np.sort(latest + period * np.floor((times[-1] + tolerance - latest) / period))
    kept = [due[0]]
    for t in due[1:]:
        if t - kept[-1] > min(tolerance, period / 4):
            kept.append(t)
    return np.array(kept)


def _nearest(times: Array, wanted: Array) -> NDArray[np.intp]:
    """Indices of the onsets (n,) nearest to the wanted times."""
    return np.searchsorted((times[1:] + times[:-1]) / 2, wanted)
