"""What latched inputs have said: repeated, changed, or in parts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

Merge = Callable[[Any, Any], Any]  # of what is known (None at first) and a message, where neither says all


class Latched:
    """What the stage knows by its latched inputs, by topic; messages that it refused are not kept.

    `merges` has per topic how a message is put together with what is known; None = it replaces that.
    """

    def __init__(self, merges: Mapping[str, Merge | None]) -> None:
        self._merges = dict(merges)
        self._known: dict[str, Any] = {}

    @property
    def missing(self) -> list[str]:
        """Topics of which nothing has been taken yet; the streams wait for them."""
        return [topic for topic in self._merges if topic not in self._known]

    def heard(self, topic: str) -> bool:
        """Whether something of a topic has been taken."""
        return topic in self._known

    def repeated(self, topic: str, value: Any) -> bool:
        """Whether a message changes nothing: many drivers repeat theirs, and so do splits of a bag."""
        if topic not in self._known:
            return False
        try:
            return alike(self._known[topic], self._merged(topic, value))
        except ValueError:
            return False  # the stage will refuse it, and say why

    def take(self, topic: str, value: Any) -> None:
        """Keeps a message for the next stage."""
        self._known[topic] = self._merged(topic, value)

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        """Topic and message, all that a new stage has to know, in the order of the inputs."""
        return iter([(topic, self._known[topic]) for topic in self._merges if topic in self._known])

    def _merged(self, topic: str, value: Any) -> Any:
        merge = self._merges[topic]
        return merge(self._known.get(topic), value) if merge else value


def alike(a: Any, b: Any) -> bool:
    """The same but for the stamp."""
    names = [field.name for field in dataclasses.fields(a) if field.name != "t_ns"]
    return all(_equal(getattr(a, name), getattr(b, name)) for name in names)


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(a == b)
