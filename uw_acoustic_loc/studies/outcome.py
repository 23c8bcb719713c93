"""What a study gives, and what a study is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from ..evaluation.plot import Picture
from ..evaluation.tables import Sheet


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a study has measured."""

    numbers: Mapping[str, Any]  # NAME.json
    sheets: Mapping[str, Sheet]  # tables by file name
    text: str  # Markdown: what was run


class Study(Protocol):
    """What a module studies/<name>/study.py offers."""

    TITLE: str
    RUNS: int  # when --runs is not given

    def measure(self, runs: int, seed: int, progress: Callable[[float], None]) -> Outcome:
        """Runs the trials; `progress` gets the share that is done. The same seed gives the same outcome."""

    def pictures(self, numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
        """Figures by file name."""
