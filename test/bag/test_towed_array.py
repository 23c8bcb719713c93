"""The real recording through the offline run and its picture."""

from __future__ import annotations

import math
import runpy
from pathlib import Path

import numpy as np
import pytest

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "bags" / "draw_towed_array.py"))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return SCRIPT["processed"](tmp_path_factory.mktemp("towed") / "out")


@pytest.mark.parametrize(("animal", "side"), [(animal, side) for animal in "bc" for side in (0, 1)])
def test_the_published_fix_lies_in_the_ellipse_and_the_ellipse_is_not_vain(recording, animal, side):
    series = recording.one(("source", "mirror")[side], name=animal)
    last, published = series.values[-1], SCRIPT["PUBLISHED"][animal][side]
    off, cov = last.position[:2] - published, last.cov[:2, :2]
    assert math.hypot(*off) < 150.0
    assert off @ np.linalg.solve(cov, off) < 4.0
    across, along = np.sqrt(np.linalg.eigvalsh(cov))
    assert 30 < across < 100 and 200 < along < 600  # 1 degree of array shape is 60 m at 3.4 km


def test_the_picture_is_drawn(tmp_path):
    SCRIPT["main"](tmp_path / "towed.png")
    assert (tmp_path / "towed.png").read_bytes()[:4] == b"\x89PNG"
