"""The part of a ping that echoes have not reached.

A ping is correlated in windows that all begin with it, each twice as long as the one before. Where an echo comes in,
the carrier's phase difference between the hydrophones leaves what the shorter windows say, by more than noise explains.
How much it does so, over many pings, is the echoes' variance in each window; the window is taken whose noise and echoes
together are least. It is Lepski's rule (Lepski 1990) with a memory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..types import Array
from .gcc import Correlation

_SHORTEST = 0.25e-3  # s, of the windows
_LAGS = 4.0  # times the array's largest lag that a window lasts at least: both hydrophones hear the same of the ping
_MEMORY = 0.9  # weight of a ping in the memory of the next
_EARLY = 0.25  # of what echoes add to the second window's variance, is in the first one's too
_SIGNIFICANT = 3.0  # standard deviations by which echoes must surpass noise


def gates(pulse: float, max_lag: float) -> tuple[float, ...]:
    """Lengths in s of the windows that are shorter than the pulse; none for arrays so wide that echoes come sooner."""
    lengths, length = [], max(_SHORTEST, _LAGS * max_lag)
    while length < 0.75 * pulse and _LAGS * max_lag < 2.0 * _SHORTEST:
        lengths.append(length)
        length *= 2.0
    return tuple(lengths)


class Choice(NamedTuple):
    """The window that says most."""

    number: int  # among the windows, the shortest first
    echo_std: float  # rad of the carrier, by echoes within the window


class FirstArrival:
    """What echoes do to the windows of one source's pings, learnt from ping to ping."""

    def __init__(self, count: int, phase_std: float) -> None:
        self._least = phase_std**2
        self._seen = np.zeros(count - 1)  # mean square of the steps from window to window, rad^2
        self._noise = np.zeros(count - 1)  # of which noise explains so much
        self._pings = 0.0

    def choose(self, found: Sequence[Correlation], frequency: float, lobes: int) -> Choice:
        """The best of a ping's windows, the shortest first."""
        omega = 2.0 * math.pi * frequency
        phases = omega * np.array([_tdoa(c, found[-1], lobes) for c in found])
        noise = np.square(omega * np.array([c.std for c in found]))
        steps = np.square(np.remainder(np.diff(phases) + math.pi, 2.0 * math.pi) - math.pi)
        expected = np.abs(np.diff(noise)) + self._least
        echoes = self._echoes(steps, expected)
        total = noise + np.concatenate([[0.0], np.cumsum(echoes)])
        index = int(total.argmin())
        early = _EARLY * max(float(self._seen[0] - self._noise[0]), 0.0) if self._seen.size else 0.0
        return Choice(index, math.sqrt(float(total[index] - noise[index]) + self._unknown(expected, index) + early))

    def _echoes(self, steps: Array, expected: Array) -> Array:
        """Takes a ping's steps; (n,) rad^2 that each adds to the variance."""
        self._pings = _MEMORY * self._pings + 1.0
        share = 1.0 / self._pings
        self._seen += share * (steps - self._seen)
        self._noise += share * (expected - self._noise)
        limit = 1.0 + _SIGNIFICANT * math.sqrt(2.0 / self._pings)
        lasting = np.where(self._seen > limit * self._noise, self._seen - self._noise, 0.0)
        now = np.where(steps > (_SIGNIFICANT**2) * expected, steps - expected, 0.0)
        return np.asarray(np.maximum(lasting, now))

    def _unknown(self, expected: Array, index: int) -> float:
        """rad^2 of echoes that so few pings cannot exclude."""
        return float(expected[:index].sum()) / self._pings**2


def best_window(found: Sequence[Correlation], index: int, lobes: int) -> Correlation:
    """The correlation in a window; an array with several lobes takes from it the carrier's phase alone.

    Which cycle it is, a part of a ping that sweeps its band cannot tell as the whole can.
    """
    whole, part = found[-1], found[index]
    if lobes == 1 or part is whole:
        return part
    return whole._replace(tdoas=whole.tdoas + (_tdoa(part, whole, lobes) - whole.tdoas[0]), std=part.std)


def _tdoa(part: Correlation, whole: Correlation, lobes: int) -> float:
    """Of the part's maxima the strongest, or where there are several lobes that of the whole's cycle."""
    if lobes == 1:
        return part.tdoas.item(0)
    return part.tdoas.item(int(np.abs(part.tdoas - whole.tdoas[0]).argmin()))
