"""Drives a stage: order, counts, refusals. The live node and the offline run both push messages into this."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..config import param
from ..contract import Emission, Input, Stage, Status
from .inputs.latched import Latched, alike
from .inputs.placing import Placing
from .inputs.plausibility import Plausibility
from .inputs.settings import Frames, InputConfig, restamped
from .inputs.stamp_watch import StampWatch
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
    """One stage with its inputs in order. `make_stage` builds another one when the clock is set back.

    `counts` has per topic what was received, used, published, repeated, and not used, by why
    (`REFUSED`); `report` is called with each Refusal. `inputs` has what is set of an input, by topic.
    """

    def __init__(
        self,
        make_stage: Callable[[], Stage],
        lateness: float,
        report: Callable[[Refusal], None],
        inputs: Mapping[str, InputConfig] | None = None,
    ) -> None:
        self._make_stage, self._report = make_stage, report
        self.counts: Counter[tuple[str, str]] = Counter()
        self.stage = make_stage()
        self._inputs = {i.topic: i for i in self.stage.inputs}
        configs = {topic: (inputs or {}).get(topic, InputConfig()) for topic in self._inputs}
        self._offsets_ns = {topic: round(config.stamp_offset * 1e9) for topic, config in configs.items()}
        self._frames = {topic: Frames(self._inputs[topic], config) for topic, config in configs.items()}
        self._placings = {topic: Placing(config) for topic, config in configs.items() if config.mounted}
        self._plausible = {topic: Plausibility(topic) for topic in self._inputs}
        self._first_refusal = ""
        self._rates = np.zeros(3)
        self._sequencer = _sequencer(self._inputs.values(), lateness)
        self._watch = StampWatch(self._inputs, self._sequencer, lateness)
        self._latched = Latched({i.topic: i.merge for i in self.stage.inputs if i.latched})
        self._held: deque[tuple[str, Any]] = deque()
        kept = {i.topic: _RECENT if i.rewind else 1 for i in self._inputs.values()}
        self._recent: dict[str, deque[Any]] = {topic: deque(maxlen=count) for topic, count in kept.items()}
        self._waiting = bool(self.missing)

    @property
    def missing(self) -> list[str]:
        """The latched inputs that have not come yet; the streams wait for them."""
        return self._latched.missing

    def status(self) -> Status:
        """The stage's, with what its inputs say of themselves."""
        own = self.stage.status()
        faults = [fault for look in self._plausible.values() for fault in look.faults] + self._watch.faults()
        notes = {f"{topic} note": "; ".join(p.notes.values()) for topic, p in self._plausible.items() if p.notes}
        if not faults:
            return Status(own.level, own.message, {**own.values, **notes})
        shown = faults[:_SENTENCES] + [f"and {len(faults) - _SENTENCES} more"] * (len(faults) > _SENTENCES)
        message = "; ".join(shown if own.message == "running" else [*shown, own.message])
        return Status(max(own.level, Status.WARN), message, {**own.values, **notes})

    def idle_reason(self) -> str:
        """Why the stage has used none of the messages that it needs, though some came; empty when it has."""
        needed = [i.topic for i in self._inputs.values() if not i.latched and not i.optional]
        received, used = (sum(self.counts[topic, what] for topic in needed) for what in ("received", "used"))
        if used or not received:
            return ""
        waiting = f"it waits for {', '.join(self.missing)}" if self.missing else self._first_refusal
        return f"used none of {received} messages: {waiting}"

    def malformed(self, topic: str, sentence: str) -> None:
        """Counts a message that could not be read."""
        self.counts[topic, "received"] += 1
        self._refuse("malformed", topic, sentence)

    def push(self, topic: str, value: Any) -> list[Emission]:
        """Takes a message of an input; returns what the stage publishes."""
        self.counts[topic, "received"] += 1
        try:
            self._frames[topic].check(value)
            self._plausible[topic].check(value)
        except ValueError as error:
            self._refuse("malformed", topic, str(error))
            return []
        value = restamped(value, self._offsets_ns[topic])
        if self._inputs[topic].latched:
            return self._latch(topic, value)
        if self._repeated(topic, value):
            self.counts[topic, "repeated"] += 1
            return []
        if not self._waiting:
            return self._stream(topic, value)
        self._hold(topic, value)
        return []

    def flush(self) -> list[Emission]:
        """The end of the input: handles what the sequencer still holds."""
        emissions = self._handle_all(self._sequencer.flush())
        self._report_refused()
        return emissions

    def _latch(self, topic: str, value: Any) -> list[Emission]:
        """Skips what changes nothing; what is new has its turn among the streams."""
        if self._latched.repeated(topic, value):
            self.counts[topic, "repeated"] += 1
            return []
        if not self._waiting:
            return self._handle_all(self._sequencer.insert(topic, value.t_ns, value))
        emissions = self._handle(topic, value) or []
        self._waiting = bool(self.missing)
        while self._held and not self._waiting:
            emissions += self._stream(*self._held.popleft())
        return emissions

    def _repeated(self, topic: str, value: Any) -> bool:
        """Whether a stream has said just this before, with this stamp; what lies farther back is another run of it."""
        recent = self._recent[topic]
        newest_ns = max((other.t_ns for other in recent), default=value.t_ns)
        if newest_ns - value.t_ns > self._inputs[topic].rewind * 1e9:
            recent.clear()
        if any(value.t_ns == other.t_ns and alike(other, value) for other in recent):
            return True
        recent.append(value)
        return False

    def _stream(self, topic: str, value: Any) -> list[Emission]:
        emissions = self._handle_all(self._sequencer.push(topic, _turn_ns(self._inputs[topic], value), value))
        self._watch.pushed(topic)
        self._report_refused()
        if start := self._sequencer.new_run:
            emissions += self._restart(start)
        return emissions

    def _report_refused(self) -> None:
        for refused in self._sequencer.take_refused():
            self._refuse(refused.kind, refused.topic, refused.sentence)

    def _restart(self, start: list[tuple[str, int, Any]]) -> list[Emission]:
        emissions = self.flush()  # what still waits belongs to the old run
        self._report(Refusal(start[0][0], f"the clock was set back to {start[0][1]} ns: the estimator restarts"))
        self.counts["", "restarts"] += 1
        self._sequencer.clear()
        self._watch.clear()
        self.stage = self._make_stage()
        self._inputs = {i.topic: i for i in self.stage.inputs}
        emissions += self._handle_all(self._latched)
        for topic, t_ns, value in start:
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
        wanted = self._inputs[topic]
        try:
            emissions = list(wanted.handle(self._placed(topic, value)))
        except ValueError as error:
            self._refuse("rejected", topic, str(error))
            return None
        self.counts[topic, "used"] += 1
        if wanted.latched:
            if self._latched.heard(topic):
                self._plausible[topic].notes["changed"] = f"what it says has changed at {value.t_ns} ns"
            self._latched.take(topic, value)
        for out, _ in emissions:
            self.counts[out, "published"] += 1
        return emissions

    def _placed(self, topic: str, value: Any) -> Any:
        """As a sensor at base_link would give it."""
        if not self._placings:
            return value
        if topic in self._placings:
            value = self._placings[topic].place(value, self._rates)
        self._rates = getattr(value, "angular", self._rates)
        return value

    def _refuse(self, count: str, topic: str, sentence: str) -> None:
        self._first_refusal = self._first_refusal or f"{topic}: {sentence}"
        self.counts[topic, count] += 1
        self._report(Refusal(topic, sentence))


# Why messages are not used: refused by the stage; unreadable, in another frame or beyond physics; after later stamps
# had been handled; with a stamp off the topic's course; held too long while a latched input was missing.
REFUSED = ("rejected", "malformed", "late", "stray", "overflowed")
_SENTENCES = 4  # about the inputs in one status
_RECENT = 32  # messages of an input that is gone back for, among which a repeated one is looked for
_HELD = 1000  # messages kept while a latched input is missing


def _sequencer(inputs: Iterable[Input], lateness: float) -> Sequencer:
    """Of all inputs that are not latched; what comes through other estimators is waited for as long as each of them."""
    streams = [wanted for wanted in inputs if not wanted.latched]
    waits_ns = {wanted.topic: round(lateness * (1 + wanted.upstream) * 1e9) for wanted in streams}
    rewind_ns = {wanted.topic: round(wanted.rewind * 1e9) for wanted in streams if wanted.rewind > 0}
    optional = {wanted.topic for wanted in streams if wanted.optional}
    return Sequencer(waits_ns, round(lateness * 1e9), rewind_ns, optional)


def _turn_ns(wanted: Input, value: Any) -> int:
    return int(value.t_ns) if wanted.until_ns is None else wanted.until_ns(value)
