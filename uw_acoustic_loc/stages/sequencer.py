"""Puts the messages of several inputs into stamp order, so that a result does not depend on who was delivered first.

A message waits until every input has reached its stamp, or until some input is `lateness` ahead of it: an input that
has gone silent delays the others by that much of stamp time, never for ever. A stamp that does not fit its own input's
course (`stamp_course`) waits for what follows it and lets nobody go meanwhile:

- the input returns to its course: what had left it is refused, alone;
- the others get there, and the input is in line with them: it had paused;
- the row lasts, and no other input has gone on in its old course meanwhile: it is the clock that was set;
- the row lasts while others go on: that input's clock has stepped, which is taken out of its stamps, or it is refused.

Deliveries of different inputs may interleave in any way as long as none is half of `lateness` behind another, and one
fault of an input is settled (after `lateness`, or the three seconds of a row) before the next: then
these decisions, the order and the refusals are the same.
"""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

from .stamp_course import AGREE, NEVER, STAYS_NS, Course, Courses, Held, Row

Ready = list[tuple[str, Any]]


class Refused(NamedTuple):
    """A message that cannot be put in order: `late`, or `stray` as its stamp does not fit its input's course."""

    topic: str
    kind: str
    sentence: str


class Sequencer:
    """`push` returns what may be handled now, in stamp order; equal stamps in the order of the inputs.

    `waits_ns` has how long the others wait for each input. A late message of an input in `rewind_ns` is handled when it
    comes, if it is not later than that. `optional` inputs never let the others go, nor may they be far ahead of them.
    """

    def __init__(
        self,
        waits_ns: Mapping[str, int],
        lateness_ns: int,
        rewind_ns: Mapping[str, int] | None = None,
        optional: Collection[str] = (),
    ) -> None:
        self._waits_ns, self._lateness_ns = dict(waits_ns), lateness_ns
        self._rewind_ns = dict(rewind_ns or {})
        self._optional = optional
        self._rank = {topic: rank for rank, topic in enumerate(waits_ns)}
        self.needed_ns: dict[str, int] = {}  # by input, the longest wait, which nothing that was late would have missed
        self.late_ns: dict[str, int] = {}  # by input, up to where the others were when the last one came late
        self.steps: dict[str, int] = {}  # by input, what was added to its stamps when its clock had stepped
        self._refused: list[Refused] = []
        self.clear()

    def clear(self) -> None:
        """Forgets everything but what is counted: a new run of the clock."""
        self._heap: list[tuple[int, int, int, str, Any]] = []
        self.courses = Courses(self._waits_ns, self._lateness_ns, self._optional)
        self._released = NEVER
        self._count = 0
        self.new_run: list[tuple[str, int, Any]] = []  # the first messages of a new run of the clock, when there is one

    def push(self, topic: str, t_ns: int, value: Any) -> Ready:
        """Takes a message; returns (topic, value) of all that are now in order. `new_run` must be looked at then."""
        course = self.courses.of[topic]
        if shift := course.shift_ns:
            t_ns, value = t_ns + shift, dataclasses.replace(value, t_ns=value.t_ns + shift)
        if course.goes_on(t_ns) and self.courses.in_line(topic, t_ns):
            if course.rows:
                self._stray(topic, course.back())
            course.go_on(t_ns)
            return self._enter(topic, t_ns, value)
        if 0 < course.last_ns - t_ns <= max(_BACK_NS, self._rewind_ns.get(topic, 0)):
            return self._out_of_order(topic, t_ns, value)
        left_ns = self.courses.front_ns if course.last_ns == NEVER or course.goes_on(t_ns) else course.last_ns
        row, stray = course.leave(Held(t_ns, value), left_ns)
        self._stray(topic, stray)
        return self._consider(topic, course, row)

    def insert(self, topic: str, t_ns: int, value: Any) -> Ready:
        """Takes a message that nobody waits for: it has its turn if its stamp is near those to come, else at once."""
        if not self._released <= t_ns <= self.courses.front_ns + self._lateness_ns:
            return [(topic, value)]
        self._insert(topic, t_ns, value)
        return self._release()

    def flush(self) -> Ready:
        """Everything that is still held: the end of the input. A single stamp that has left its course is refused."""
        for topic, course in self.courses.of.items():
            for row in [row for row in course.rows if row.ahead and row.count > 1]:
                if not self.courses.contradicted(course, row):
                    self._adopt(topic, course, row)
            self._stray(topic, course.back())
        return self._released_until(max(item[0] for item in self._heap)) if self._heap else []

    def take_refused(self) -> list[Refused]:
        """The refusals since the last call."""
        refused, self._refused = self._refused, []
        return refused

    def _enter(self, topic: str, t_ns: int, value: Any) -> Ready:
        """A message on its course: into the order, unless it is late."""
        if t_ns < self._released:
            return self._late(topic, t_ns, value)
        self._insert(topic, t_ns, value)
        return self._release()

    def _insert(self, topic: str, t_ns: int, value: Any) -> None:
        heapq.heappush(self._heap, (t_ns, self._rank.get(topic, -1), self._count, topic, value))
        self._count += 1

    def _late(self, topic: str, t_ns: int, value: Any) -> Ready:
        late_ns = self._released - t_ns
        if late_ns <= self._rewind_ns.get(topic, 0):
            return [(topic, value)]
        self.needed_ns[topic] = max(self.needed_ns.get(topic, 0), self._waits_ns[topic] + late_ns)
        self.late_ns[topic] = self._released
        self._refuse(topic, "late", f"stamp {t_ns} ns came after later stamps had been handled")
        return []

    def _out_of_order(self, topic: str, t_ns: int, value: Any) -> Ready:
        """A little behind its own course: refused, or, by an input that is gone back for, used."""
        if topic in self._rewind_ns:
            return self._enter(topic, t_ns, value)
        last = self.courses.of[topic].last_ns
        self._refuse(topic, "late", f"stamp {t_ns} ns came after one of the same topic at {last} ns")
        return []

    # --- off the course -------------------------------------------------------------------------------------------

    def _consider(self, topic: str, course: Course, row: Row) -> Ready:
        """What becomes of messages that have left their course."""
        if row.ahead and (ready := self._release()):
            return ready
        if row.count < AGREE or row not in course.rows:
            return []
        if not row.ahead and self.courses.others_at(course, row.newest_ns):
            return self._step(topic, course, row, 0)
        if not self.courses.lasts(row):
            return []
        if self.courses.contradicted(course, row):
            return self._alone(topic, course, row) if row.span_ns >= STAYS_NS else []
        return self._believe(row.ahead)

    def _believe(self, ahead: bool) -> Ready:
        """The clock was set: the rows on that side are courses now, or the beginning of a new run."""
        rows = self.courses.rows(ahead)
        if not ahead:
            began = [(t, held.t_ns, held.value) for t, c, row in rows for held in c.take(row)]
            self.new_run = sorted(began, key=lambda item: item[1])
            return []
        for topic, course, row in rows:
            if row.count >= AGREE:
                self._adopt(topic, course, row)
        return self._release()

    def _alone(self, topic: str, course: Course, row: Row) -> Ready:
        """A row that lasts while others go on: brought into line as it is, or by its step, or else refused."""
        shifts = [-course.shift_ns]
        if row.left_ns == course.last_ns != NEVER:
            shifts.append(row.left_ns + course.interval_ns - row.begin_ns)
        for shift in shifts:
            if self.courses.others_at(course, row.newest_ns + shift):
                return self._step(topic, course, row, shift)
        self._stray(topic, row.let_go())
        return []

    def _step(self, topic: str, course: Course, row: Row, shift: int) -> Ready:
        """From the newest message on the input's stamps are shifted; the earlier ones are too late by now."""
        t_ns, value = row.held.pop()
        self._stray(topic, course.back())
        self._purge(topic)
        course.step(t_ns + shift, shift)
        if shift:
            self.steps[topic] = course.shift_ns
            value = dataclasses.replace(value, t_ns=value.t_ns + shift)
        return self._enter(topic, t_ns + shift, value)

    def _purge(self, topic: str) -> None:
        """What waits of an input's wrong course is stray as well."""
        wrong = [Held(item[0], item[4]) for item in self._heap if item[3] == topic]
        if wrong:
            self._heap = [item for item in self._heap if item[3] != topic]
            heapq.heapify(self._heap)
            self._stray(topic, wrong)

    def _adopt(self, topic: str, course: Course, row: Row) -> None:
        """A row is the course from now on, and other rows are not."""
        for t_ns, value in course.take(row):
            if t_ns < self._released:
                self._late(topic, t_ns, value)
            else:
                self._insert(topic, t_ns, value)
        self._stray(topic, course.back())

    def _stray(self, topic: str, row: list[Held]) -> None:
        last_ns = self.courses.of[topic].last_ns
        course_ns = self.courses.front_ns if last_ns == NEVER else last_ns
        for held in row:
            off = (held.t_ns - course_ns) * 1e-9
            where = f"{abs(off):.3f} s {'ahead of' if off > 0 else 'behind'} the topic's course"
            self._refuse(topic, "stray", f"stamp {held.t_ns} ns is {where}, and no other input has gone there")

    def _refuse(self, topic: str, kind: str, sentence: str) -> None:
        self._refused.append(Refused(topic, kind, sentence))

    # --- on the course --------------------------------------------------------------------------------------------

    def _release(self) -> Ready:
        until = self.courses.until_ns
        for topic, course in self.courses.of.items():
            for row in [*course.rows]:
                if row.ahead and row.begin_ns <= until and row in course.rows and self.courses.abreast(course, row):
                    self._adopt(topic, course, row)
                    until = self.courses.until_ns
        return self._released_until(until)

    def _released_until(self, until_ns: int) -> Ready:
        ready = []
        while self._heap and self._heap[0][0] <= until_ns:
            self._released, _, _, topic, value = heapq.heappop(self._heap)
            ready.append((topic, value))
        return ready


_BACK_NS = 1_000_000_000  # a smaller step back is a message out of order
