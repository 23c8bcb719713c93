"""The studies by name, and the page that shows what they measured."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import cast

from ..evaluation.tables import markdown, write_csv
from .outcome import Outcome, Study

NAMES = ("bearing", "localizer", "slam", "toa", "multistatic", "impulsive")  # folders beside this file


def study(name: str) -> Study:
    """The study of that name."""
    return cast(Study, import_module(f".{name}.study", __package__))


def write_page(outcomes: Mapping[str, Outcome], seed: int, folder: Path) -> Path:
    """Writes numbers, tables and figures of studies, and the page that shows them; returns the page."""
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / "README.md"
    parts = [part for name, outcome in outcomes.items() for part in _section(name, outcome, seed, folder)]
    page.write_text("\n".join(parts), encoding="utf-8")
    return page


def _section(name: str, outcome: Outcome, seed: int, folder: Path) -> Iterator[str]:
    """Writes a study's files and yields its part of the page."""
    found = study(name)
    (folder / f"{name}.json").write_text(json.dumps(outcome.numbers, indent=2) + "\n", encoding="utf-8")
    yield f"# {found.TITLE}\n\n{outcome.text}"
    for key, sheet in outcome.sheets.items():
        write_csv(sheet, folder / f"{name}_{key}.csv")
        yield f"## {sheet.title}\n\n{markdown(sheet)}"
    for key, picture in found.pictures(outcome.numbers, seed):
        file = folder / f"{name}_{key}.png"
        file.write_bytes(picture.png)
        yield f"## {picture.title}\n\n![{picture.title}]({file.name})\n\n{picture.caption}\n"
