"""The course of one input's stamps: which message goes on from the last one, and which has left it."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Any, NamedTuple

NEVER = -1
AGREE = 3  # messages in a row before it means anything
STAYS_NS = 3_000_000_000  # for which one input by itself must stay off its course, by its own stamps
_MAJORITY = 2  # inputs that go on together know better than one that joins them
_INTERVALS = 5  # so many may be missing before a stamp has left the course
_REMEMBERED, _KNOWN = 9, 3  # intervals
_UNKNOWN_NS = 1_000_000_000
_ROWS = 3  # at a time
_KEPT = 2000  # messages of a row


class Held(NamedTuple):
    """A message with the instant of its turn."""

    t_ns: int
    value: Any


@dataclass(eq=False)
class Row:
    """Messages that go on from each other, but not from the course."""

    left_ns: int  # where the course stood when the row began
    begin_ns: int
    held: list[Held] = field(default_factory=list)
    count: int = 0  # those that were let go included

    def add(self, held: Held) -> None:
        """Takes the next message."""
        self.held.append(held)
        self.count += 1

    def let_go(self) -> list[Held]:
        """Takes all messages but the last out."""
        gone, self.held = self.held[:-1], self.held[-1:]
        return gone

    @property
    def newest_ns(self) -> int:
        return self.held[-1].t_ns

    @property
    def span_ns(self) -> int:
        """How long it lasts, by its own stamps."""
        return self.newest_ns - self.begin_ns

    @property
    def ahead(self) -> bool:
        """Whether it lies after the course, and not before it."""
        return self.begin_ns > self.left_ns


@dataclass(eq=False)
class Course:
    """Stamps of one input that follow each other, and rows of those that do not.

    A stamp goes on when it is not before the last one, nor after it by more than `reach_ns`. Whatever is decided here
    depends on this input's messages alone, so that it does not depend on how the inputs' deliveries interleave.
    """

    wait_ns: int  # how long the other inputs wait for this one
    lateness_ns: int
    last_ns: int = NEVER
    push_ns: int = NEVER  # up to where this input lets the others go: not beyond the stamp before the last one
    reach_ns: int = 0
    shift_ns: int = 0  # added to every stamp since this input's clock stepped
    rows: list[Row] = field(default_factory=list)  # the one that a message came to last is the last
    _intervals: deque[int] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))

    def __post_init__(self) -> None:
        self._learn()

    @property
    def interval_ns(self) -> int:
        """Between two messages, as a rule; the longest so far, or a second, before that is known."""
        if len(self._intervals) >= _KNOWN:
            return round(median(self._intervals))
        return max(_UNKNOWN_NS, *self._intervals, 0)

    def goes_on(self, t_ns: int) -> bool:
        """Whether a stamp follows the last one; the first one always does."""
        return self.last_ns == NEVER or self.last_ns <= t_ns <= self.last_ns + self.reach_ns

    def go_on(self, t_ns: int) -> None:
        """Takes a stamp as the last one; a late message of an input that is gone back for leaves it where it is."""
        if t_ns <= self.last_ns:
            return
        if self.last_ns != NEVER:
            self._intervals.append(t_ns - self.last_ns)
            self._learn()
        self.push_ns, self.last_ns = min(t_ns - self.lateness_ns, self.last_ns), t_ns

    def step(self, t_ns: int, shift_ns: int) -> None:
        """Restarts at a stamp, which has been shifted like all that follow."""
        self.shift_ns += shift_ns
        self.last_ns, self.push_ns = t_ns, NEVER

    def leave(self, held: Held, left_ns: int) -> tuple[Row, list[Held]]:
        """The row of a message that does not go on, and what has become stray by it."""
        for row in self.rows:
            if row.newest_ns <= held.t_ns <= row.newest_ns + self.reach_ns:
                row.add(held)
                self.rows.sort(key=lambda other: other is row)
                return row, row.let_go() if len(row.held) > _KEPT else []
        row = Row(left_ns, held.t_ns)
        row.add(held)
        self.rows.append(row)
        return row, self.rows.pop(0).held if len(self.rows) > _ROWS else []

    def back(self) -> list[Held]:
        """Ends all rows; returns their messages."""
        rows, self.rows = self.rows, []
        return [held for row in rows for held in row.held]

    def take(self, row: Row) -> list[Held]:
        """Makes a row the course; returns its messages."""
        self.rows.remove(row)
        for held in row.held:
            self.go_on(held.t_ns)
        return row.held

    def _learn(self) -> None:
        """A stamp may be ahead of the last one by `lateness`, or by a few of the intervals that are usual."""
        self.reach_ns = max(self.lateness_ns, _INTERVALS * self.interval_ns)


class Courses:
    """The courses of all inputs, by name; `optional` ones lead nobody."""

    def __init__(self, waits_ns: Mapping[str, int], lateness_ns: int, optional: Collection[str]) -> None:
        self._lateness_ns = lateness_ns
        self.of = {topic: Course(wait, lateness_ns) for topic, wait in waits_ns.items()}
        self.leading = {topic: course for topic, course in self.of.items() if topic not in optional} or self.of

    @property
    def front_ns(self) -> int:
        """The latest stamp on any course that others follow."""
        return max(course.last_ns for course in self.leading.values())

    @property
    def until_ns(self) -> int:
        """Up to which stamp nothing more is waited for."""
        front = max(course.push_ns for course in self.leading.values()) + self._lateness_ns
        return min(max(course.last_ns, front - course.wait_ns) for course in self.of.values())

    def others_front(self, course: Course) -> int:
        """The latest stamp of all other inputs."""
        return max((other.last_ns for other in self.of.values() if other is not course), default=NEVER)

    def others_at(self, course: Course, t_ns: int) -> bool:
        """Whether the furthest of the other inputs is about there."""
        return abs(t_ns - self.others_front(course)) <= course.wait_ns

    def in_line(self, topic: str, t_ns: int) -> bool:
        """The first stamp of an input, and any of an optional one, is not far ahead of those that others follow."""
        course, front = self.of[topic], self.front_ns
        if topic in self.leading:
            followed = [other.last_ns for other in self.leading.values() if other is not course]
            if course.last_ns != NEVER or sum(last_ns != NEVER for last_ns in followed) < _MAJORITY:
                return True
        return front == NEVER or t_ns <= front + course.wait_ns + course.reach_ns

    def abreast(self, course: Course, row: Row) -> bool:
        """Whether a row is no further than the other inputs are."""
        return row.newest_ns <= self.others_front(course) + self._lateness_ns

    def rows(self, ahead: bool) -> list[tuple[str, Course, Row]]:
        """The latest row of each input that has left its course to one side."""
        rows = ((topic, course, course.rows[-1]) for topic, course in self.of.items() if course.rows)
        return [(topic, course, row) for topic, course, row in rows if row.ahead == ahead]

    def lasts(self, row: Row) -> bool:
        """Long enough by itself, or, with another input that has left its course the same way, for a shorter time."""
        agreeing = sum(other.count >= AGREE for _, _, other in self.rows(row.ahead))
        return row.span_ns >= (2 * self._lateness_ns if agreeing > 1 else STAYS_NS)

    def contradicted(self, course: Course, row: Row) -> bool:
        """Whether another input has gone on in the old course since."""
        return self.others_front(course) > row.left_ns + self._lateness_ns
