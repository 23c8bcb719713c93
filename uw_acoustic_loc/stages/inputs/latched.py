"""What latched inputs have said: repeated, changed, or in parts."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np


class Latched:
    """The latched messages that the stage has taken, by topic; what it refused is not kept."""

    def __init__(self, topics: Iterable[str]) -> None:
        self._taken: dict[str, list[Any]] = {topic: [] for topic in topics}

    @property
    def missing(self) -> list[str]:
        """Topics of which nothing has been taken yet; the streams wait for them."""
        return [topic for topic, taken in self._taken.items() if not taken]

    def heard(self, topic: str) -> bool:
        """Whether something of a topic has been taken."""
        return bool(self._taken[topic])

    def repeated(self, topic: str, value: Any) -> bool:
        """Whether a message says what the last one said: many drivers repeat theirs, and so do splits of a bag."""
        return self.heard(topic) and _alike(self._taken[topic][-1], value)

    def take(self, topic: str, value: Any) -> None:
        """Keeps a message for the next stage; those before it as well, as each may tell of another part."""
        others = [taken for taken in self._taken[topic] if not _alike(taken, value)]
        self._taken[topic] = [*others, value][-_KEPT:]

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        """Topic and message, all that a new stage has to know, in their order."""
        return ((topic, value) for topic, taken in self._taken.items() for value in [*taken])


def _alike(a: Any, b: Any) -> bool:
    """The same but for the stamp."""
    names = [field.name for field in dataclasses.fields(a) if field.name != "t_ns"]
    return all(_equal(getattr(a, name), getattr(b, name)) for name in names)


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(a == b)


_KEPT = 100  # messages of a topic
