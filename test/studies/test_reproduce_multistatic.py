import json

import numpy as np
import pytest

from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.multistatic.estimator import METHODS
from uw_acoustic_loc.studies.multistatic import figures, study, trials

KEYS = {"receivers", "distance_m", "range_std", "bearing_std", "crlb", *METHODS, "worst_cell_ratio"}


@pytest.fixture
def coarse(monkeypatch):
    """A fifth of the grid's rows and columns."""
    monkeypatch.setattr(trials, "SPACING", 5 * trials.SPACING)


def test_the_grid_is_the_papers():
    axis = trials.grid_axis()
    assert axis.size == 70
    assert np.diff(axis) == pytest.approx(144.0)
    assert axis[-1] == -axis[0] == pytest.approx(4968.0)
    assert trials.grid().shape == (4900, 2)


@pytest.mark.usefixtures("coarse")
def test_what_the_study_must_show():
    """A mean RMSE of 225 targets x 40 trials is known to about 0.5 %; 1.02 of the bound lies 4 sigma off."""
    shares = []
    outcome = study.measure(40, 7, shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    numbers = outcome.numbers
    assert {name: len(rows) for name, rows in numbers.items()} == {"noise": 9, "receivers": 7, "distance": 6}
    for row in (row for rows in numbers.values() for row in rows):
        assert set(row) == KEYS
        assert row["ml_exact"] < row["ml_range_bearing"] <= 1.02 * row["crlb"]
        assert row["ml_range_bearing"] < min(row["ls"], row["ml_range"])
    by_count = [row["ml_range_bearing"] for row in numbers["receivers"]]
    assert by_count == sorted(by_count, reverse=True)
    by_distance = {name: [row[name] for row in numbers["distance"][:5]] for name in ("ls", "ml_range")}
    assert by_distance["ls"] == sorted(by_distance["ls"])  # as published
    assert by_distance["ml_range"] == sorted(by_distance["ml_range"], reverse=True)
    stalled = [float(row[4]) for row in outcome.sheets["bias"].rows]
    assert stalled[-1] > 0.85 * stalled[2]  # from 7 to 15 receivers
    assert by_count[-1] < 0.7 * by_count[2]


@pytest.mark.usefixtures("coarse")
def test_the_command_writes_numbers_tables_and_pictures(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(figures, "TRIALS", 2)
    assert main(["reproduce", "multistatic", "--runs", "2", "--seed", "3", "-o", str(tmp_path)]) == 0
    capsys.readouterr()
    names = {path.name for path in tmp_path.iterdir()}
    assert {f"multistatic_{key}.png" for key in ("noise", "map", "cut", "distance", "receivers")} <= names
    assert {
        f"multistatic_{key}.csv" for key in ("noise", "receivers", "distance", "bias", "placement", "paper")
    } <= names
    assert main(["reproduce", "multistatic", "--runs", "2", "--seed", "3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((tmp_path / "multistatic.json").read_text())
