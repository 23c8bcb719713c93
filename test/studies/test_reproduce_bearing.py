import csv
import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.studies.bearing import study, trials
from uw_acoustic_loc.studies.slam import trials as slam_trials

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def short(monkeypatch):
    """A fraction of the trials: enough to see that the command works."""
    for name, value in {"PINGS": 12, "SWEEP_PINGS": 25, "POSITION_PINGS": 25}.items():
        monkeypatch.setattr(trials, name, value)
    monkeypatch.setattr(slam_trials, "SCENARIO", replace(slam_trials.SCENARIO, duration=5.0))


@pytest.fixture(scope="module")
def numbers():
    shares = []
    found = study.measure(3, 1, shares.append).numbers
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    return found


def test_the_bound_is_that_of_a_flat_band_but_for_the_chirps_soft_edges():
    bounds = [math.degrees(trials.bearing_bounds(trials.clean_scene(), snr)[0]) for snr in (10.0, 20.0, 30.0)]
    assert np.round(bounds, 3) == pytest.approx([0.029, 0.009, 0.003])
    omega = 2 * np.pi * np.linspace(20e3, 30e3, 1001)
    for snr_db, bound in zip((10.0, 20.0, 30.0), bounds, strict=True):
        g = 10 ** (snr_db / 10)
        flat = math.sqrt((1 + 2 * g) / (2 * g * g * 100 * np.mean(omega**2))) * 1500 / 0.6
        assert bound == pytest.approx(math.degrees(flat), rel=0.02)


def test_the_bound_is_the_inverse_fisher_information_of_two_gaussian_channels():
    """J = sum tr(R^-1 dR R^-1 dR) of the covariance R of a complex bin, dR by finite differences."""
    scene, snr_db, tdoa, step = trials.clean_scene(), 3.0, 7e-5, 1e-9
    omega, snr = trials.spectrum(scene, scene.noise_std(snr_db))

    def cov(w, g, tau):
        turn = np.exp(-1j * w * tau)
        return np.array([[g + 1, g * turn], [g * turn.conjugate(), g + 1]])

    information = 0.0
    for w, g in zip(omega, snr, strict=True):
        slope = (cov(w, g, tdoa + step) - cov(w, g, tdoa - step)) / (2 * step)
        solved = np.linalg.solve(cov(w, g, tdoa), slope)
        information += np.trace(solved @ solved).real
    expected = 1500 / 0.6 / math.sqrt(information)
    assert trials.bearing_bounds(scene, snr_db)[0] == pytest.approx(expected, rel=1e-4)


def test_a_known_waveform_never_does_worse_and_the_bounds_meet_at_high_snr():
    scene = trials.clean_scene()
    pairs = {snr: trials.bearing_bounds(scene, snr) for snr in (-5.0, 0.0, 10.0, 40.0)}
    assert all(known < unknown for unknown, known in pairs.values())
    assert pairs[40.0][0] == pytest.approx(pairs[40.0][1], rel=1e-3)


def test_single_pings_reach_the_bound(numbers):
    """An RMSE of 375 pings is known to 1 / sqrt(750) = 3.7 %, a robust spread to 6 %: 1.15 and 1.3 lie 4 sigma off."""
    assert [row["snr_db"] for row in numbers["crlb"]] == [0.0, 10.0, 20.0, 30.0]
    for row in numbers["crlb"]:
        assert set(row) == {"snr_db", "rmse_deg", "robust_deg", "crlb_deg"}
        if row["snr_db"] > 0:
            assert row["rmse_deg"] < 1.15 * row["crlb_deg"]
        assert row["robust_deg"] < 1.3 * row["crlb_deg"]


@pytest.mark.parametrize(
    ("band", "factor", "filter_"),
    [
        ([20e3, 30e3], 10, "particle"),
        ([20e3, 30e3], 10, "histogram"),
        ([24e3, 26e3], 6, "particle"),
        ([24e3, 26e3], 6, "histogram"),
    ],
)
def test_the_filters_cut_gross_errors(numbers, band, factor, filter_):
    rows = {row["filter"]: row for row in numbers["multipath"] if row["band_hz"] == band}
    assert list(rows) == ["none", "particle", "histogram"]
    assert all(set(row) == {"band_hz", "filter", "gross_fraction", "median_deg"} for row in rows.values())
    assert rows[filter_]["gross_fraction"] <= rows["none"]["gross_fraction"] / factor
    assert rows[filter_]["median_deg"] <= 1.2


def test_the_course_stays_in_its_sector_and_is_slow():
    course = np.degrees(trials.course_of(np.random.default_rng(3)))
    assert course.min() >= 35.0
    assert course.max() <= 145.0
    assert np.ptp(course) > 50.0
    steps = np.abs(np.diff(course))
    assert np.median(steps) == pytest.approx(0.3)
    assert steps.max() < 0.301


def test_errors_are_summed_up_as_named():
    errors = np.radians([-1.0, 1.0, 2.0, -20.0])
    found = trials.BearingErrors(5, errors, np.radians([1.0, 0.4, 1.5, 1.0]))
    assert found.rmse_deg == pytest.approx(math.sqrt(406 / 4))
    assert found.median_deg == pytest.approx(1.5)
    assert found.robust_deg == pytest.approx(1.4826 * 1.5)  # around the median 0: 1, 1, 2, 20
    assert found.gross_fraction == 0.25
    assert found.within_2_sigma == 0.5
    assert found.heard == 0.8


def test_positions_lie_as_in_the_sea_trial():
    x, y = trials.map_positions()
    assert x.size == 21
    assert np.diff(x) == pytest.approx(-1.5)
    assert np.degrees(np.arctan2(y, x))[[0, 10, 20]] == pytest.approx([70.0, 90.0, 110.0])


@pytest.mark.usefixtures("short")
def test_the_same_seed_gives_the_same_json_and_another_one_does_not(capsys):
    printed = []
    for seed in ("4", "4", "5"):
        assert main(["reproduce", "bearing", "--runs", "1", "--seed", seed, "--json"]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1] != printed[2]
    assert set(json.loads(printed[0])) == {"crlb", "multipath"}


@pytest.mark.usefixtures("short")
def test_all_gives_every_study_by_its_name(capsys):
    assert main(["reproduce", "all", "--runs", "1", "--json"]) == 0
    assert "crlb" in json.loads(capsys.readouterr().out)["bearing"]


@pytest.mark.usefixtures("short")
def test_the_folder_holds_page_tables_numbers_and_pictures(tmp_path):
    assert main(["reproduce", "bearing", "--runs", "1", "-o", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "README.md").read_text()
    pictures = re.findall(r"\]\((\S+\.png)\)", page)
    assert len(pictures) == 8
    assert all((tmp_path / "out" / name).read_bytes()[:8] == PNG for name in pictures)
    numbers = json.loads((tmp_path / "out" / "bearing.json").read_text())
    with (tmp_path / "out" / "bearing_crlb.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["SNR dB"]) for row in rows] == [row["snr_db"] for row in numbers["crlb"]]
    assert [float(row["RMSE °"]) for row in rows] == pytest.approx([r["rmse_deg"] for r in numbers["crlb"]], abs=5e-5)
    assert "| 20-30 | 0 | yes | particle |" in page


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["sonar"], "uwloc: reproduce: NAME must be one of .*bearing.*, all, got 'sonar'"),
        (["bearing", "--runs", "-1"], "uwloc: reproduce: --runs and --seed must not be negative, got -1 and 1"),
        (["bearing", "--seed", "-2"], "uwloc: reproduce: --runs and --seed must not be negative, got 0 and -2"),
    ],
)
def test_error_sentences(arguments, sentence, capsys):
    assert main(["reproduce", *arguments]) == 1
    assert re.fullmatch(sentence + "\n", capsys.readouterr().err)
