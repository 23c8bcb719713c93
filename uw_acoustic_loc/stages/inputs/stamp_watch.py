"""Clocks that do not agree: how far each input lags behind the furthest, as deliveries show it; for diagnostics."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ...contract import Input
from ..sequencer import Sequencer
from ..stamp_course import NEVER
from .settings import PREFIX


class StampWatch:
    """Looks at the sequencer when a message has been pushed; nothing here changes a result.

    An input's lag is the least, over some seconds, by which it is behind when another one gets further: a healthy
    input is abreast soon after each of its own messages, whichever their rates are.
    """

    def __init__(self, inputs: Mapping[str, Input], sequencer: Sequencer, lateness: float) -> None:
        self._inputs, self._sequencer, self._lateness = inputs, sequencer, lateness
        self.clear()

    def clear(self) -> None:
        """A new run of the clock."""
        self._begin_ns = self._window_ns = NEVER
        self._heard_ns: dict[str, int] = {}  # by input, where the front was at its last message
        self._least: dict[str, float] = {}
        self._lag: dict[str, float] = {}

    def pushed(self, topic: str) -> None:
        """After a message of an input."""
        courses = self._sequencer.courses
        front, own = courses.front_ns, courses.of[topic].last_ns
        self._heard_ns[topic] = front
        if own == NEVER or own < front:
            return
        if self._begin_ns == NEVER:
            self._begin_ns = self._window_ns = front
        for other, course in courses.of.items():
            if course.last_ns != NEVER and other != topic:
                self._least[other] = min(self._least.get(other, math.inf), (own - course.last_ns) * 1e-9)
        self._least.setdefault(topic, 0.0)
        if not 0 <= front - self._window_ns < _WINDOW_NS:
            heard = {name for name, at_ns in self._heard_ns.items() if at_ns >= self._window_ns}
            self._lag = {name: lag for name, lag in self._least.items() if name in heard}
            self._least, self._window_ns = {}, front

    def faults(self) -> list[str]:
        """Sentences on inputs that are silent, off, or late."""
        return [*self._steps(), *self._off_course(), *self._offsets(), *self._silent(), *self._late()]

    def _steps(self) -> list[str]:
        """Clocks that have stepped, and whose step is taken out."""
        return [
            f"the clock of {topic} has stepped, {step * 1e-9:+.3f} s are added to its stamps since"
            for topic, step in self._sequencer.steps.items()
        ]

    def _off_course(self) -> list[str]:
        found = []
        for topic, course in self._sequencer.courses.of.items():
            row, front = course.rows[-1] if course.rows else None, self._sequencer.courses.front_ns
            if row and row.count > _FEW and (front > row.left_ns or not row.ahead):
                off = (row.newest_ns - max(front, row.left_ns)) * 1e-9
                where = f"{abs(off):.3f} s {'ahead of' if off > 0 else 'behind'}"
                found.append(
                    f"stamps of {topic} are {where} the other inputs, {row.count} in a row{_cure(topic, -off)}"
                )
        return found

    def _offsets(self) -> list[str]:
        """Inputs that differ from where most are by more than their way here explains."""
        if not self._lag:
            return []
        lag = min(self._lag.values(), key=lambda lag: (-self._votes(lag), self._spread(lag), lag))
        others = [topic for topic in self._lag if self._agrees(topic, lag)]
        return [
            f"stamps of {topic} are {abs(own - lag):.3f} s {'behind' if own > lag else 'ahead of'}"
            f" {', '.join(others)}{_cure(topic, own - lag)}"
            for topic, own in self._lag.items()
            if topic not in others
        ]

    def _votes(self, lag: float) -> float:
        """How many inputs are about there; those that are done without count half."""
        return sum(1.0 - 0.5 * self._inputs[topic].optional for topic in self._lag if self._agrees(topic, lag))

    def _spread(self, lag: float) -> float:
        """How far those that are about there differ."""
        return sum(abs(own - lag) for topic, own in self._lag.items() if self._agrees(topic, lag))

    def _agrees(self, topic: str, lag: float) -> bool:
        wanted, behind = self._inputs[topic], self._lag[topic] - lag
        return -_NOTICED <= behind <= _NOTICED + wanted.upstream * self._lateness + wanted.rewind

    def _silent(self) -> list[str]:
        """Inputs that have never come, and optional ones that have gone."""
        found = []
        front = self._sequencer.courses.front_ns
        for topic, course in self._sequencer.courses.of.items():
            came, optional = course.last_ns != NEVER, self._inputs[topic].optional
            if self._begin_ns == NEVER or course.rows or (came and not optional):
                continue
            since = (front - self._heard_ns.get(topic, self._begin_ns)) * 1e-9
            if since > _SILENT:
                found.append(f"nothing on {topic} for {since:.0f} s" + optional * ": the estimator does without")
        return found

    def _late(self) -> list[str]:
        """Inputs of which something came too late of late, with the lateness that would have done so far."""
        front, late = self._sequencer.courses.front_ns, self._sequencer.late_ns
        recent = [topic for topic, at_ns in late.items() if front - at_ns < _RECENT_NS]
        needs = {t: self._sequencer.needed_ns[t] * 1e-9 / (1 + self._inputs[t].upstream) for t in recent}
        names = [topic for topic, needed in needs.items() if needed < _BEARABLE]
        if not names:
            return []
        needed = math.ceil(10 * max(needs[topic] for topic in names)) / 10
        return [f"{', '.join(names)} came too late: with a lateness of {needed:.1f} s nothing would have been lost"]


def _cure(topic: str, offset: float) -> str:
    return f"; if its clock is off, set {PREFIX}{topic}.stamp_offset to {offset:.3f}"


_NOTICED = 0.2  # s
_WINDOW_NS = 3_000_000_000
_SILENT = 5.0  # s
_RECENT_NS = 30_000_000_000
_BEARABLE = 60.0  # more is no lateness, but another clock
_FEW = 2  # messages off their course
