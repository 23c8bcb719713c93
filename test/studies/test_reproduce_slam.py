"""`uwloc reproduce slam`: names, repeatability, and that its numbers are what the runs say."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.studies.slam import study, trials
from uw_acoustic_loc.studies.slam.trials import End

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(trials, "SCENARIO", replace(trials.SCENARIO, duration=10.0))


@pytest.fixture(scope="module")
def run():
    return trials.trial(trials.WHITE, 0, 31)


def test_slam_stays_where_dead_reckoning_drifts(run):
    end = trials.end(run)
    assert set(end.nees) == {"s1", "s2", "s3", "vehicle"}
    assert max(end.distance.values()) < 1.2 and max(end.nees.values()) < 15
    assert end.rmse < 1.5
    assert run.truth[0] == pytest.approx([0, 20]) and run.truth[-1] == pytest.approx([-2.3, 14.4], abs=0.2)
    assert np.ptp([s.time for s in run.snapshots]) == pytest.approx(195.0)


def test_bearings_point_at_the_pingers_from_the_true_path(run):
    heard = run.heard["s2"]
    k = np.searchsorted([s.time for s in run.snapshots], 70.0)
    x, y = np.array(trials.PLACES["s2"]) - run.truth[k]
    heading = math.atan2(*(run.truth[k + 1] - run.truth[k])[::-1])
    near = np.abs(heard[:, 0] - 70.0) < 1.0
    assert np.median(heard[near, 1]) == pytest.approx(math.atan2(y, x) - heading, abs=4 * trials.STD / math.sqrt(20))


def test_numbers_are_percentiles_and_means_of_the_runs():
    places = dict.fromkeys(trials.PLACES, (1.0, 2.0))
    ends = [
        End(dict.fromkeys(trials.PLACES, d), places, dict.fromkeys((*trials.PLACES, "vehicle"), n), d, 10 * d)
        for d, n in ((0.1, 0.5), (0.2, 1.0), (0.6, 3.0))
    ]
    found = study._numbers(ends)
    assert found["runs"] == 3
    assert found["sources"]["s1"] == pytest.approx({"median_m": 0.2, "p90_m": 0.52, "nees_mean": 1.5, "nees_max": 3.0})
    assert found["vehicle"]["rmse_median_m"] == 0.2
    assert found["vehicle"]["dead_reckoning_final_median_m"] == 2.0


@pytest.mark.usefixtures("short")
def test_the_same_seed_gives_the_same_run_and_another_one_does_not():
    one, same, other = (trials.ends(trials.HANDLED, 1, seed, [].append)[0] for seed in (4, 4, 5))
    assert one == same != other


@pytest.mark.usefixtures("short")
def test_json_has_its_names(capsys):
    assert main(["reproduce", "slam", "--runs", "1", "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)) == {"runs", "sources", "vehicle"}


@pytest.mark.usefixtures("short")
def test_the_folder_holds_page_tables_and_pictures(tmp_path):
    assert main(["reproduce", "slam", "--runs", "1", "-o", str(tmp_path)]) == 0
    page = (tmp_path / "README.md").read_text()
    pictures = re.findall(r"\]\((\S+\.png)\)", page)
    assert len(pictures) == 4
    assert all((tmp_path / name).read_bytes()[:8] == PNG for name in pictures)
    assert {p.name for p in tmp_path.glob("*.csv")} == {"slam_table1.csv", "slam_vehicle.csv", "slam_correlated.csv"}
    assert "| s1 | (15.66, 23.79) |" in page
