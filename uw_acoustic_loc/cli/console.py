"""Output for a person at the terminal: progress bars, prefixed log lines."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

STDERR = Console(stderr=True, highlight=False)
_REDRAW_S = 0.1
_COLOURS = ("cyan", "green", "yellow", "blue", "magenta", "bright_cyan", "bright_green", "bright_yellow", "bright_blue")


def say(sentence: str) -> None:
    """Prints a sentence on stderr as it is: in one line, however narrow the terminal, and brackets are no styles."""
    STDERR.print(sentence, markup=False, soft_wrap=True)


@contextmanager
def progress(title: str, total_s: float, unit: str = "s") -> Iterator[Callable[[float], None]]:
    """Shows a bar over seconds of the scenario or bag; gives the function that sets it. Silent without a terminal.

    Another unit than seconds has no real time to be compared with.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} {task.fields[unit]}  {task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=STDERR, disable=not sys.stderr.isatty(), transient=True) as bars:
        task = bars.add_task(title, total=max(total_s, 1e-9), rate="", unit=unit)

        drawn = 0.0

        def update(done_s: float) -> None:
            nonlocal drawn
            if time.monotonic() - drawn < _REDRAW_S and done_s < total_s:
                return
            drawn = time.monotonic()
            speed = bars.tasks[0].speed if unit == "s" else None
            bars.update(task, completed=min(done_s, total_s), rate=f"{speed:.1f}x real time" if speed else "")

        yield update


@contextmanager
def importing() -> Iterator[None]:
    """Ctrl-C ends the program at once and silently: C extensions turn an interrupt into errors of import."""
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def wide(columns: int) -> Console:
    """Returns a console for stdout of at least that width, so that names are not broken over lines."""
    return Console(width=max(Console().width, columns))


def damage_code(damage: Sequence[str]) -> int:
    """Prints what is wrong with a bag; returns the exit code for it."""
    for sentence in damage:
        print(f"uwloc: {sentence}", file=sys.stderr)
    return 1 if damage else 0


class NodeLog:
    """Prints lines of nodes, each under its node's name and colour."""

    def __init__(self) -> None:
        self._colours: dict[str, str] = {}

    def __call__(self, name: str, line: str) -> None:
        colour = self._colours.setdefault(name, _COLOURS[len(self._colours) % len(_COLOURS)])
        STDERR.print(f"[{colour}]\\[{name.lstrip('/')}][/{colour}] ", end="")
        say(line)
