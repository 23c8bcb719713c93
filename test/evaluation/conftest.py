"""Bags of known content."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from test.known_run import Event, write_bag
from uw_acoustic_loc.evaluation.recording import Recording, load


@pytest.fixture
def recorded(tmp_path: Path) -> Callable[[Iterable[Event]], Recording]:
    """Writes events into a bag and loads it again."""
    return lambda events: load(write_bag(tmp_path / "bag", events))
