import csv
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.cli.main import main

HARBOUR = Path(__file__).parents[2] / "config/harbour/scenario.yaml"


def test_maps_of_the_harbours_buoys(tmp_path):
    assert main(["plan", str(HARBOUR), "-o", str(tmp_path)]) == 0
    page = (tmp_path / "README.md").read_text()
    for emission in ("known", "unknown"):
        name = f"buoys_emission_{emission}"
        assert f"({name}.png)" in page
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "buoys_emission_known.csv").open(newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    middle = min(rows, key=lambda row: np.hypot(row["x_m"] - 30, row["y_m"] - 20))
    # four buoys around the middle: half the range error per axis (Cramer-Rao, sound speed known)
    slant = np.hypot(400 * np.sqrt(2), 15) / (400 * np.sqrt(2))
    assert middle["direct_hdop"] == pytest.approx(slant, rel=0.01)
    assert middle["direct_and_bottom_vertical_m"] < 0.3 * middle["direct_vertical_m"]


def test_a_scenario_without_nets_is_refused(tmp_path, capsys):
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("duration: 10.0\n")
    assert main(["plan", str(scenario), "-o", str(tmp_path / "out")]) == 1
    assert "must have one of buoys" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
