"""A bag with renamed topics, so that a recording from elsewhere feeds the stages of a graph."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from .reader import Bag, Record, Topic


class RemappedBag:
    """`bag` with its topics renamed; names that are not mentioned stay.

    Raises:
        ValueError: the bag has no such topic, or two topics would have one name.
    """

    def __init__(self, bag: Bag, names: Mapping[str, str]) -> None:
        self._bag = bag
        self._new = {name: names.get(name, name) for name in bag.topics}
        self._old = {new: old for old, new in self._new.items()}
        if unknown := sorted(set(names) - set(bag.topics)):
            have = ", ".join(sorted(bag.topics)) or "none"
            raise ValueError(f"bag {bag.path} has no topic {unknown[0]} to be renamed, it has {have}")
        for old, new in self._new.items():
            if self._old[new] != old:
                raise ValueError(f"bag {bag.path}: {old} and {self._old[new]} would both be {new}")

    @property
    def path(self) -> Path:
        """The bag's path."""
        return self._bag.path

    @property
    def damage(self) -> list[str]:
        """What could not be read, one sentence each."""
        return self._bag.damage

    @property
    def topics(self) -> dict[str, Topic]:
        """The topics by their new names."""
        return {
            self._new[old]: dataclasses.replace(topic, name=self._new[old]) for old, topic in self._bag.topics.items()
        }

    @property
    def refused(self) -> dict[str, Topic]:
        """Topics whose messages can only be copied, under their own names."""
        return self._bag.refused

    def span(self) -> tuple[int, int]:
        """Returns log times of the first and the last message in ns."""
        return self._bag.span()

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Yields messages, of `topics` (new names) only when given, in the order of their log times."""
        known = self._old | {name: name for name in self.refused}
        wanted = None if topics is None else [known[name] for name in topics if name in known]
        for record in self._bag.records(wanted):
            new = self._new.get(record.topic, record.topic)
            yield record if new == record.topic else record._replace(topic=new)


def remaps(pairs: Sequence[str], sign: str = ":=") -> dict[str, str]:
    """Reads new names by old ones from pairs such as `/theirs:=/ours`; ValueError for anything else."""
    found: dict[str, str] = {}
    for pair in pairs:
        old, _, new = pair.partition(sign)
        if not (old.startswith("/") and new.startswith("/")):
            raise ValueError(f"a renaming must be two full topic names as in /theirs{sign}/ours, got '{pair}'")
        if old in found:
            raise ValueError(f"{old} is renamed twice")
        found[old] = new
    return found
