"""Synthetic bearings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.sim.scenario import Pinger, Scenario, Vehicle, Waypoint
from uw_acoustic_loc.studies.slam.bearings import bearings

SCENARIO = Scenario(
    vehicle=Vehicle((Waypoint(0, 0), Waypoint(100, 0)), speed=1e-2),
    pingers=(Pinger("a", 0.0, 30.0, 0.0, 1e3, 2e3), Pinger("b", 30.0, -30.0, 0.0, 1e3, 2e3)),
    duration=400.0,
)


def test_a_source_to_port_has_a_positive_bearing_and_stamps_are_in_order():
    events = bearings(SCENARIO, 1e-6)
    assert [e[0] for e in events] == sorted(e[0] for e in events) and len(events) == 8000
    first = {topic: value.bearing for _, topic, value in reversed(events)}
    assert first["sources/a/bearing"] == pytest.approx(math.pi / 2, abs=1e-4)
    assert first["sources/b/bearing"] == pytest.approx(-math.pi / 4, abs=1e-4)


def test_errors_have_their_size_and_their_correlation():
    true, found = bearings(SCENARIO, 1e-12), bearings(SCENARIO, 0.1, 0.9)
    errors = np.array([f[2].bearing - t[2].bearing for t, f in zip(true, found, strict=True) if f[1][8] == "a"])
    assert errors.std() == pytest.approx(0.1, rel=0.15)  # 4000 values, 210 independent ones: 5 %
    assert np.corrcoef(errors[1:], errors[:-1])[0, 1] == pytest.approx(0.9, abs=0.03)
    assert found[0][2].variance == pytest.approx(0.01)


def test_no_vehicle():
    with pytest.raises(ValueError, match="vehicle: the scenario has none"):
        bearings(Scenario(), 0.1)
