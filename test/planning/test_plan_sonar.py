import dataclasses
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.core.multistatic.bound import cramer_rao, dilution, position_error
from uw_acoustic_loc.core.multistatic.estimator import Noise, SonarNet
from uw_acoustic_loc.planning.sonar import POINTS, maps
from uw_acoustic_loc.sim.scenario import Scenario, load_scenario

HARBOUR = load_scenario(Path(__file__).parents[2] / "config/harbour/scenario.yaml")


def test_the_sheet_has_the_bound_and_the_dilution_at_every_point():
    ((name, sheet, picture),) = maps(HARBOUR)
    assert name == "sonar"
    assert picture.png[:4] == b"\x89PNG"
    assert sheet.columns == ("x_m", "y_m", "range_sums_and_bearings_m", "range_sums_alone_m", "range_dop")
    table = np.array(sheet.rows, dtype=float)
    assert table.shape == (POINTS**2, 5)
    net = SonarNet(np.zeros(2), np.array([[2000.0, 0.0], [-1000.0, 1732.0], [-1000.0, -1732.0]]))
    noise = Noise(np.full(3, 40.0), np.full(3, 0.02))
    row = table[4321]
    cov = cramer_rao(net, row[:2], noise)
    assert row[2] == pytest.approx(float(position_error(cov)), rel=1e-3)
    assert row[4] == pytest.approx(float(dilution(net, row[:2])), rel=1e-3)
    assert np.all(table[:, 3] >= table[:, 2])


def test_one_receiver_is_enough_with_its_bearing_and_never_without():
    one = dataclasses.replace(HARBOUR.sonar, receivers=HARBOUR.sonar.receivers[:1])
    ((_, sheet, _),) = maps(dataclasses.replace(HARBOUR, sonar=one))
    table = np.array(sheet.rows, dtype=float)
    assert np.isinf(table[:, 3]).all()
    assert np.isfinite(table[:, 2]).mean() > 0.9


def test_a_scenario_without_receivers_is_refused():
    with pytest.raises(ValueError, match="plan: sonar must have at least one receiver"):
        list(maps(Scenario()))
