"""Contestants timed in turn in one process; only ratios of one run mean something, times drift with the machine."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

SLICE = 5e-3  # s that a contestant may repeat itself before it is the next one's turn: 2 ms run on cold caches


@dataclass(frozen=True)
class Row:
    """A contestant: how many of our times it must take (`at_least`), or may take at the least (`ours_within`)."""

    name: str
    seconds: float | None  # None: not installed
    accuracy: str = ""
    at_least: float = 0.0
    ours_within: float = 0.0


def in_turn(contestants: Mapping[str, Callable[[], object]], seconds: float) -> dict[str, float]:
    """Median time of a call of each."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        for name, call in contestants.items():
            until = time.perf_counter() + SLICE
            while True:
                begin = time.perf_counter()
                call()
                now = time.perf_counter()
                times[name].append(now - begin)
                if now > until:
                    break
    return {name: statistics.median(values) for name, values in times.items()}


def report(title: str, ours: str, rows: Sequence[Row]) -> int:
    """Prints the table; 1 if a goal is missed, else 0."""
    own = next(row.seconds for row in rows if row.name == ours)
    assert own is not None
    print(f"## {title}\n\n| | us | ours is | goal | errors |\n|---|---|---|---|---|")
    verdicts = [_line(row, own) for row in rows]
    print()
    return int(not all(verdicts))


def _line(row: Row, own: float) -> bool:
    if row.seconds is None:
        print(f"| {row.name} | - | not installed here | | |")
        return True
    ratio, cost = row.seconds / own, own / row.seconds
    good, goal, shown = True, "", f"{ratio:.1f} times faster"
    if row.at_least:
        good, goal = ratio >= row.at_least, f">= {row.at_least:g}"
    if row.ours_within:
        good, goal, shown = cost <= row.ours_within, f"<= {row.ours_within:g}", f"{cost:.2f} times its cost"
    shown = "" if row.seconds == own else shown
    print(
        f"| {row.name} | {1e6 * row.seconds:.3g} | {shown} | {goal}{'' if good else ' **missed**'} | {row.accuracy} |"
    )
    return good
