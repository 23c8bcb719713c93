"""The score as tables, at the terminal and in the report: the same titles, columns and digits."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text


@dataclass(frozen=True)
class Sheet:
    """One section of the score: a row per source, mooring or topic."""

    title: str
    columns: tuple[str, ...]  # headings, the first for the rows' names
    rows: tuple[tuple[str, ...], ...]  # as they are shown


def sheets(scored: dict[str, Any]) -> Iterator[Sheet]:
    """Yields the sections that the score has."""
    for section, title in _TITLES.items():
        if section in scored:
            rows = list(_rows(section, scored[section]))
            keys = [key for key in _COLUMNS if any(key in numbers for _, numbers in rows)]
            body = tuple((name, *(_shown(key, numbers) for key in keys)) for name, numbers in rows)
            yield Sheet(title, ("", *(_COLUMNS[key] for key in keys)), body)


def tables(scored: dict[str, Any]) -> Iterator[RenderableType]:
    """Yields the sections for a terminal."""
    for sheet in sheets(scored):
        drawn = Table(*sheet.columns, box=None, padding=(0, 2, 0, 0), header_style="dim")
        for column in drawn.columns[1:]:
            column.justify = "right"
        for row in sheet.rows:
            drawn.add_row(*row)
        yield Text(sheet.title, style="bold")
        yield Padding(drawn, (0, 0, 1, 2))


def write_csv(sheet: Sheet, path: Path) -> None:
    """Writes a table as a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([sheet.columns, *sheet.rows])


def markdown(sheet: Sheet) -> str:
    """Returns a table as Markdown."""
    lines = [sheet.columns, ("---",) * len(sheet.columns), *sheet.rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _rows(section: str, part: dict[str, Any]) -> Iterator[tuple[str, dict[str, float]]]:
    if section in ("toa", "multistatic"):
        yield "", part
    elif section == "slam":
        yield from ((name, numbers) for name, numbers in part.items() if name != "sources")
        yield from ((f"source {name}", numbers) for name, numbers in part.get("sources", {}).items())
    else:
        yield from part.items()


def _shown(key: str, numbers: dict[str, float]) -> str:
    if key not in numbers:
        return ""
    value = numbers[key]
    if isinstance(value, int):
        return str(value)
    if key == "gross_fraction":
        return f"{100 * value:.2f}"
    return f"{value:.1f}" if key.endswith("_ms") or abs(value) >= 100 else f"{value:.3f}"


_TITLES = {
    "bearing": "Bearings",
    "localizer": "Pingers, from bearings and odometry",
    "slam": "Vehicle and pingers, SLAM",
    "toa": "Target and sound speed c, from the buoys",
    "multistatic": "Target, from the sonar net",
    "mooring": "Mooring offsets",
    "latency": "Latency, stamp to recording",
}
_COLUMNS = {
    "n": "n",
    "rmse_deg": "RMSE °",
    "median_deg": "median °",
    "p95_deg": "95 % °",
    "gross_fraction": "over 5° %",
    "nes_mean": "NES",
    "mean_m": "mean m",
    "rmse_m": "RMSE m",
    "median_m": "median m",
    "p95_m": "95 % m",
    "max_m": "max m",
    "horizontal_rmse_m": "horiz. m",
    "vertical_rmse_m": "vert. m",
    "sound_speed_rmse": "c m/s",
    "std_m": "std m",
    "raw_std_m": "raw std m",
    "final_m": "final m",
    "dead_reckoning_final_m": "dead reckoning final m",
    "nees_mean": "NEES/dim",
    "tracks": "tracks",
    "p50_ms": "p50 ms",
    "p99_ms": "p99 ms",
}
