"""Output for a person at the terminal: progress bars, prefixed log lines.

Texts come from bags, files and the net: what would steer the terminal, or break the encoder, never gets there.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment
from rich.text import Text

_STEERING = [*range(0x20), *range(0x7F, 0xA0), 0x061C, 0x200E, 0x200F, *range(0x2028, 0x202F), *range(0x2066, 0x206A)]
_HARMLESS = str.maketrans(dict.fromkeys([*_STEERING, *range(0xD800, 0xE000)], "\N{REPLACEMENT CHARACTER}"))
_IN_LINES = {code: mark for code, mark in _HARMLESS.items() if chr(code) not in "\n\t"}


class SafeConsole(Console):
    """A console without markup, whose texts cannot hold control characters, those of writing direction included."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, **options)

    def print(self, *objects: Any, **options: Any) -> None:
        """Prints as rich does, a string in one line."""
        super().print(*(harmless(one) if isinstance(one, str) else one for one in objects), **options)

    def render(self, renderable: Any, options: Any = None) -> Iterable[Segment]:
        """Renders as rich does."""
        for segment in super().render(renderable, options):
            text, style, control = segment
            yield segment if control else Segment(text.translate(_IN_LINES), style)


STDERR = SafeConsole(stderr=True)
_REDRAW_S = 0.1
_COLOURS = ("cyan", "green", "yellow", "blue", "magenta", "bright_cyan", "bright_green", "bright_yellow", "bright_blue")


def say(sentence: str) -> None:
    """Prints a sentence on stderr as it is: in one line, however narrow the terminal, and brackets are no styles."""
    STDERR.print(sentence, soft_wrap=True)


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
    return SafeConsole(width=max(Console().width, columns))


def harmless(text: str) -> str:
    """One line without control characters."""
    return text.translate(_HARMLESS)


def complain(sentence: str) -> None:
    """Prints what is wrong, one line on stderr."""
    print(f"uwloc: {harmless(sentence)}", file=sys.stderr)


def damage_code(damage: Sequence[str]) -> int:
    """Prints what is wrong with a bag; returns the exit code for it."""
    for sentence in damage:
        complain(sentence)
    return 1 if damage else 0


class NodeLog:
    """Prints lines of nodes, each under its node's name and colour."""

    def __init__(self) -> None:
        self._colours: dict[str, str] = {}

    def __call__(self, name: str, line: str) -> None:
        colour = self._colours.setdefault(name, _COLOURS[len(self._colours) % len(_COLOURS)])
        STDERR.print(Text.assemble((f"[{name.lstrip('/')}] ", colour), line), soft_wrap=True)
