"""Puts the messages of several inputs into stamp order, so that a result does not depend on who was delivered first.

A message waits until every input has reached its stamp, or until some input is `lateness` ahead of it: an input that
has gone silent delays the others by that much of stamp time, never for ever.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from typing import Any

_NEW_RUN = 3  # messages in a row that lie before everything seen: the clock has been set back
_JUMP_NS = 1_000_000_000  # a smaller step back is a late message


class Sequencer:
    """`push` returns what may be handled now, in stamp order; equal stamps in the order of the inputs.

    A late message of an input in `rewind_ns` is handled when it comes, if it is not later than that.
    """

    def __init__(self, inputs: Sequence[str], lateness_ns: int, rewind_ns: Mapping[str, int] | None = None) -> None:
        self._rewind_ns = dict(rewind_ns or {})
        self._rank = {topic: rank for rank, topic in enumerate(inputs)}
        self._lateness_ns = lateness_ns
        self.late: dict[str, int] = dict.fromkeys(inputs, 0)
        self.clear()

    def clear(self) -> None:
        """Forgets everything but the counts: a new run of the clock."""
        self._heap: list[tuple[int, int, int, str, Any]] = []
        self._reached = dict.fromkeys(self._rank, -1)
        self._released = -1
        self._count = 0
        self._old: list[tuple[str, int, Any]] = []

    @property
    def new_run(self) -> list[tuple[str, int, Any]]:
        """The first messages of a new run of the clock, when there is one: take them, clear, and push them again."""
        return self._old if len(self._old) >= _NEW_RUN else []

    def push(self, topic: str, t_ns: int, value: Any) -> list[tuple[str, Any]]:
        """Takes a message; returns (topic, value) of all that are now in order."""
        if t_ns < self._released:
            return self._late(topic, t_ns, value)
        self._old.clear()
        self._reached[topic] = max(self._reached[topic], t_ns)
        heapq.heappush(self._heap, (t_ns, self._rank[topic], self._count, topic, value))
        self._count += 1
        reached = self._reached.values()
        return self._release(max(min(reached), max(reached) - self._lateness_ns))

    def flush(self) -> list[tuple[str, Any]]:
        """Everything that is still held: the end of the input."""
        return self._release(max(self._reached.values())) if self._heap else []

    def _late(self, topic: str, t_ns: int, value: Any) -> list[tuple[str, Any]]:
        if self._released - t_ns <= self._rewind_ns.get(topic, 0):
            return [(topic, value)]
        self.late[topic] += 1
        if t_ns < self._reached[topic] - _JUMP_NS:
            self._old.append((topic, t_ns, value))
        return []

    def _release(self, until_ns: int) -> list[tuple[str, Any]]:
        ready = []
        while self._heap and self._heap[0][0] <= until_ns:
            self._released, _, _, topic, value = heapq.heappop(self._heap)
            ready.append((topic, value))
        return ready
