"""`uwloc reproduce`: the papers' tables and figures, theirs beside ours."""

from __future__ import annotations

import csv
import json
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from .console import STDERR, progress
from .tables import Sheet

if TYPE_CHECKING:
    from .plot import Picture

NAMES = ("bearing", "localizer", "slam", "toa", "multistatic", "impulsive")  # modules of cli/studies


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a study has measured."""

    numbers: Mapping[str, Any]  # NAME.json
    sheets: Mapping[str, Sheet]  # tables by file name
    text: str  # Markdown: what was run


class Study(Protocol):
    """What a module of cli/studies offers."""

    TITLE: str
    RUNS: int  # when --runs is not given

    def measure(self, runs: int, seed: int, tell: Callable[[float], None]) -> Outcome:
        """Runs the trials; `tell` gets the share that is done. The same seed gives the same outcome."""

    def pictures(self, numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
        """Figures by file name."""


def reproduce(options: Namespace) -> int:
    """Runs one study or all.

    Raises:
        ValueError: there is no such study, or fewer than one run.
    """
    if options.name not in (*NAMES, "all"):
        raise ValueError(f"reproduce: NAME must be one of {', '.join((*NAMES, 'all'))}, got '{options.name}'")
    if options.runs < 0 or options.seed < 0:
        raise ValueError(f"reproduce: --runs and --seed must not be negative, got {options.runs} and {options.seed}")
    names = NAMES if options.name == "all" else (options.name,)
    outcomes = {name: _measured(name, options.runs, options.seed) for name in names}
    if options.json:
        found = {name: outcome.numbers for name, outcome in outcomes.items()}
        print(json.dumps(found if options.name == "all" else found[options.name], indent=2))
    else:
        _write(outcomes, options.seed, options.output)
    return 0


def _study(name: str) -> Study:
    return cast(Study, import_module(f".studies.{name}", __package__))


def _measured(name: str, runs: int, seed: int) -> Outcome:
    study = _study(name)
    with _share(f"reproduce {name}") as tell:
        return study.measure(runs or study.RUNS, seed, tell)


@contextmanager
def _share(title: str) -> Iterator[Callable[[float], None]]:
    with progress(title, 100.0, "%") as bar:
        yield lambda share: bar(100.0 * share)


def _write(outcomes: Mapping[str, Outcome], seed: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    parts = [part for name, outcome in outcomes.items() for part in _section(name, outcome, seed, folder)]
    (folder / "README.md").write_text("\n".join(parts), encoding="utf-8")
    STDERR.print(f"{folder / 'README.md'}")


def _section(name: str, outcome: Outcome, seed: int, folder: Path) -> Iterator[str]:
    """Writes a study's files and yields its part of the page."""
    study = _study(name)
    (folder / f"{name}.json").write_text(json.dumps(outcome.numbers, indent=2) + "\n", encoding="utf-8")
    yield f"# {study.TITLE}\n\n{outcome.text}"
    for key, sheet in outcome.sheets.items():
        write_csv(sheet, folder / f"{name}_{key}.csv")
        yield f"## {sheet.title}\n\n{markdown(sheet)}"
    for key, picture in study.pictures(outcome.numbers, seed):
        file = folder / f"{name}_{key}.png"
        file.write_bytes(picture.png)
        yield f"## {picture.title}\n\n![{picture.title}]({file.name})\n\n{picture.caption}\n"


def write_csv(sheet: Sheet, path: Path) -> None:
    """A table as a file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([sheet.columns, *sheet.rows])


def markdown(sheet: Sheet) -> str:
    """A table as Markdown."""
    lines = [sheet.columns, ("---",) * len(sheet.columns), *sheet.rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
