"""Both sides carried, with bearings whose side is right after all, near the bow and the stern too."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.core.localizer.config import LocalizerConfig
from uw_acoustic_loc.core.localizer.localizer import SourceLocalizer

STD = math.radians(1.0)


def nees_after_turns(seed: int, ahead: bool, **options: object) -> float:
    """NEES / 2 of the first side after 100 s of straights and turns, past a source anywhere or ahead or astern."""
    rng = np.random.default_rng([5, seed, ahead])
    values = {"source_ids": ("a",), "bearing_correlation_time": 0.0, "process_noise": 0.0} | options
    localizer = SourceLocalizer(build(LocalizerConfig, values, "test"), 0)
    speed, course = rng.uniform(0.5, 2.0), rng.uniform(-math.pi, math.pi)
    if ahead:
        course = float(rng.choice([0.0, math.pi]) + rng.normal(0, 0.1))
    source = rng.uniform(15, 80) * np.array([math.cos(course), math.sin(course)])
    x = y = yaw = rate = 0.0
    change = rng.uniform(5, 30)
    for k in range(200):
        t = 0.5 * (k + 1)
        if t > change:
            rate = rng.uniform(-0.25, 0.25) if rate == 0 else 0.0
            change = t + (rng.uniform(3, 12) if rate else rng.uniform(5, 25))
        x, y, yaw = x + 0.5 * speed * math.cos(yaw), y + 0.5 * speed * math.sin(yaw), yaw + 0.5 * rate
        bearing = math.atan2(source[1] - y, source[0] - x) - yaw + rng.normal(0, STD)
        localizer.update(round(t * 1e9), x, y, yaw, math.remainder(bearing, math.tau), STD**2)
    fix = localizer.sides[0].fix
    if fix is None:
        return math.nan
    off = fix.mean - source
    return float(off @ np.linalg.solve(fix.cov, off)) / 2


@pytest.mark.parametrize("ahead", [False, True])
@pytest.mark.parametrize("options", [{"method": "triangulation"}, {}, {"method": "particle_filter", "particles": 500}])
def test_bearings_whose_side_is_right_are_not_mixed_with_their_image(options, ahead):
    """NEES / 2; triangulation of what lies ahead, whose lines cannot be taken back, is what docs/localizer.md says."""
    runs = 24 if options.get("method") == "triangulation" else 8
    nees = np.array([nees_after_turns(seed, ahead, **options) for seed in range(runs)])
    known = nees[~np.isnan(nees)]
    assert len(known) >= 0.7 * runs
    tolerated = 1 if ahead and options.get("method") == "triangulation" else 0
    assert (known > 13.8).sum() <= tolerated  # chi-square, 2 degrees of freedom: once in a million
    assert known[known <= 13.8].mean() < 1 + tolerated + 4 / math.sqrt(len(known))
