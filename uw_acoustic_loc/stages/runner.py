"""Drives a stage: order, counts, refusals. The live node and the offline run both push messages into this."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from ..config import param
from ..contract import Emission, Input, Stage
from .sequencer import Sequencer


@dataclass(frozen=True)
class RunnerConfig:
    """Parameters that every estimator has beside its own."""

    lateness: float = param(0.5, unit="s", low=0.0, high=60.0, doc="how long the inputs wait for each other")


@dataclass(frozen=True)
class Refusal:
    """A message that was not used, and why; `topic` is the stage's own name of it."""

    topic: str
    sentence: str


class Runner:
    """One stage with its inputs in order. `make_stage` builds it anew when the clock is set back.

    `counts` has per topic what was received, used, rejected, malformed, late, overflowed (held too long while a latched
    input was missing) and published; `tell` is called with each Refusal.
    """

    def __init__(self, make_stage: Callable[[], Stage], lateness: float, tell: Callable[[Refusal], None]) -> None:
        self._make_stage, self._tell = make_stage, tell
        self.counts: Counter[tuple[str, str]] = Counter()
        self.stage = make_stage()
        self._inputs = {i.topic: i for i in self.stage.inputs}
        streams = [i.topic for i in self.stage.inputs if not i.latched]
        rewind_ns = {i.topic: round(i.rewind * 1e9) for i in self.stage.inputs}
        self._sequencer = Sequencer(streams, round(lateness * 1e9), rewind_ns)
        self._latched: dict[str, Any] = {}
        self._held: deque[tuple[str, Any]] = deque()
        self._waiting = bool(self.missing)

    @property
    def missing(self) -> list[str]:
        """The latched inputs that have not come yet; the streams wait for them."""
        return [i.topic for i in self._inputs.values() if i.latched and i.topic not in self._latched]

    def malformed(self, topic: str, sentence: str) -> None:
        """Counts a message that could not be read."""
        self.counts[topic, "received"] += 1
        self._refuse("malformed", topic, sentence)

    def push(self, topic: str, value: Any) -> list[Emission]:
        """Takes a message of an input; returns what the stage publishes."""
        self.counts[topic, "received"] += 1
        wanted = self._inputs[topic]
        try:
            _check_frame(wanted, value)
        except ValueError as error:
            self._refuse("malformed", topic, str(error))
            return []
        if wanted.latched:
            return self._latch(topic, value)
        if not self._waiting:
            return self._stream(topic, value)
        self._hold(topic, value)
        return []

    def flush(self) -> list[Emission]:
        """The end of the input: handles what the sequencer still holds."""
        return self._handle_all(self._sequencer.flush())

    def _latch(self, topic: str, value: Any) -> list[Emission]:
        emissions = self._handle(topic, value)
        if emissions is None:  # what the stage has refused does not take the place of what it has
            return []
        merge = self._inputs[topic].merge
        self._latched[topic] = merge(self._latched[topic], value) if merge and topic in self._latched else value
        self._waiting = bool(self.missing)
        while self._held and not self._waiting:
            emissions += self._stream(*self._held.popleft())
        return emissions

    def _stream(self, topic: str, value: Any) -> list[Emission]:
        late = self._sequencer.late[topic]
        emissions = self._handle_all(self._sequencer.push(topic, _turn_ns(self._inputs[topic], value), value))
        if self._sequencer.late[topic] > late:
            self._refuse("late", topic, f"stamp {value.t_ns} ns came after later stamps had been handled")
        if start := self._sequencer.new_run:
            emissions += self._restart(list(start))
        return emissions

    def _restart(self, start: list[tuple[str, int, Any]]) -> list[Emission]:
        self._tell(Refusal(start[0][0], f"the clock was set back to {start[0][1]} ns: starting anew"))
        self.counts["", "restarts"] += 1
        self._sequencer.clear()
        self.stage = self._make_stage()
        self._inputs = {i.topic: i for i in self.stage.inputs}
        emissions = self._handle_all(self._latched.items())
        for topic, t_ns, value in start:
            self.counts[topic, "late"] -= 1
            emissions += self._handle_all(self._sequencer.push(topic, t_ns, value))
        return emissions

    def _hold(self, topic: str, value: Any) -> None:
        self._held.append((topic, value))
        if len(self._held) > _HELD:
            lost, _ = self._held.popleft()
            self._refuse("overflowed", lost, f"still waiting for {', '.join(self.missing)}")

    def _handle_all(self, ordered: Iterable[tuple[str, Any]]) -> list[Emission]:
        return [emission for topic, value in ordered for emission in self._handle(topic, value) or ()]

    def _handle(self, topic: str, value: Any) -> list[Emission] | None:
        """What the stage publishes; None when it has refused the message."""
        try:
            emissions = list(self._inputs[topic].handle(value))
        except ValueError as error:
            self._refuse("rejected", topic, str(error))
            return None
        self.counts[topic, "used"] += 1
        for out, _ in emissions:
            self.counts[out, "published"] += 1
        return emissions

    def _refuse(self, count: str, topic: str, sentence: str) -> None:
        self.counts[topic, count] += 1
        self._tell(Refusal(topic, sentence))


_HELD = 1000  # messages kept while a latched input is missing


def _turn_ns(wanted: Input, value: Any) -> int:
    return int(value.t_ns) if wanted.until_ns is None else wanted.until_ns(value)


def _check_frame(wanted: Input, value: Any) -> None:
    frame = getattr(value, "frame_id", "")
    if wanted.frame and frame != wanted.frame and not frame.endswith("/" + wanted.frame):
        raise ValueError(f"header.frame_id must be '{wanted.frame}', got '{frame}'")
