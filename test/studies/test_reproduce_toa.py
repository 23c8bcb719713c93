import json
import re

import numpy as np
import pytest

from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.sim.rays import LinearProfile
from uw_acoustic_loc.studies.toa import figures as toa_figures
from uw_acoustic_loc.studies.toa import profile as toa_profile
from uw_acoustic_loc.studies.toa import trials
from uw_acoustic_loc.studies.toa.result import Result

KEYS = {
    "mean_m", "rmse_m", "rmse_after_10_m", "pcrb_after_10_m", "p95_max_m", "sound_speed_rmse", "nees_mean", "lost_runs",
}  # fmt: skip


def test_json_has_every_variant_with_its_figures(capsys):
    printed = []
    for seed in ("4", "4", "5"):
        assert main(["reproduce", "toa", "--runs", "2", "--seed", seed, "--json"]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1] != printed[2]
    numbers = json.loads(printed[0])
    wanted = {"nominal", "direct_only", "outliers", "cold_start", "unlabelled", "unknown_emission"}
    assert wanted <= set(numbers)
    assert all(set(numbers[name]) == KEYS and np.all(np.isfinite(list(numbers[name].values()))) for name in wanted)


def test_the_folder_holds_page_tables_and_pictures(tmp_path, monkeypatch):
    monkeypatch.setattr(toa_figures, "RUNS", 3)
    assert main(["reproduce", "toa", "--runs", "2", "-o", str(tmp_path)]) == 0
    page = (tmp_path / "README.md").read_text()
    pictures = re.findall(r"\]\((\S+\.png)\)", page)
    assert len(pictures) == 4
    assert all((tmp_path / name).read_bytes().startswith(b"\x89PNG") for name in pictures)
    assert "1.2 to 3.5 m" in page
    assert (tmp_path / "toa_variants.csv").read_text().count("\n") == 1 + len(trials.VARIANTS)


def test_figures_of_merit_are_summed_up_as_named():
    truth = np.zeros((2, 50, 7))
    mean, cov = truth.copy(), np.tile(np.eye(7), (2, 50, 1, 1))
    mean[0, :, 2], mean[1, 3, 0], mean[1, 30, 0] = 2.0, 7.0, 31.0
    mean[..., 6] = 0.5
    found = Result(truth, mean, cov, np.tile(np.diag([1.0, 1, 2, 0, 0, 0, 0]), (50, 1, 1)))
    numbers = found.numbers
    assert numbers["mean_m"] == pytest.approx((50 * 2 + 7 + 31) / 100)
    assert numbers["rmse_after_10_m"] == pytest.approx(np.sqrt((40 * 4 + 31**2) / 80))
    assert numbers["pcrb_after_10_m"] == pytest.approx(2.0)
    assert numbers["p95_max_m"] == pytest.approx(np.percentile([2.0, 31.0], 95))
    assert numbers["nees_mean"] == pytest.approx((50 * 4 + 7**2 + 31**2 + 100 * 0.25) / 700)
    assert (numbers["lost_runs"], numbers["sound_speed_rmse"]) == (1, 0.5)
    mean[0, 25:] = np.nan
    assert found.numbers["lost_runs"] == 2  # no estimate is no track


def test_the_target_moves_as_published_and_the_sound_speed_stays_within_its_range():
    truth = trials.truths(300, 7)
    assert truth[:, 0] == pytest.approx(np.tile([500.0, 800, -60, 1.2, 1.0, 0.2, 1500], (300, 1)))
    assert np.ptp(truth[..., 6]) == pytest.approx(4.0)  # the walk reaches either end
    assert np.std(np.diff(truth[..., 3:6], axis=1)) == pytest.approx(0.02, rel=0.02)
    steps = truth[:, 1:, :3] - truth[:, :-1, :3]
    assert steps == pytest.approx((truth[:, 1:, 3:6] + truth[:, :-1, 3:6]) / 2)


def test_the_filter_as_published_fails_with_outliers_unless_it_has_its_gate():
    ungated, gated = (trials.published(0.1, sigma, 30, 6).numbers for sigma in (1e6, 2.0))
    assert ungated["rmse_after_10_m"] > 4 * gated["rmse_after_10_m"]
    clean = trials.published(0.0, 1e6, 30, 6).numbers
    assert clean["rmse_after_10_m"] < 1.2 * clean["pcrb_after_10_m"]  # 30 runs: 2 sigma are 15 %


def test_one_sound_speed_fits_even_water_and_takes_a_gradient_for_depth():
    target = np.array([500.0, 800.0, -60.0])
    error, misfit = toa_profile.fit(LinearProfile(1490.0, 0.0), target)
    assert np.abs(error).max() < 1e-6
    assert misfit < 1e-12
    faster_below, _ = toa_profile.fit(LinearProfile(1490.0, 0.03), target)
    faster_above, _ = toa_profile.fit(LinearProfile(1490.0, -0.03), target)
    assert faster_below[2] < -4 < 4 < faster_above[2]
    assert np.abs(np.stack([faster_below, faster_above])[:, :2]).max() < 1.5
