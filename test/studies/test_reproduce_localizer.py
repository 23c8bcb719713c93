import json
import math
import re

import numpy as np
import pytest

from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.localizer.triangulation import intersect
from uw_acoustic_loc.studies.localizer import study, trials

SIMULATION = trials.COURSES["simulation"]


@pytest.fixture(scope="module")
def numbers():
    shares = []
    found = study.measure(40, 11, shares.append).numbers
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1.0)
    return found


def rmse(points, course=SIMULATION):
    return np.sqrt(np.mean(np.abs(points - course.source) ** 2, axis=0))


def test_every_method_has_finite_errors_at_every_sample(numbers):
    assert set(numbers) == {"simulation", "sea_trial"}
    for found in numbers.values():
        assert set(found) == set(study.NAMES) >= {"triangulation", "ekf", "particle_filter", "bayes_grid"}
        for errors in found.values():
            assert set(errors) == {"rmse_m", "median_m"}
            assert all(len(values) == 21 and np.all(np.isfinite(values)) for values in errors.values())


@pytest.mark.parametrize("key", ["simulation", "sea_trial"])
def test_the_particle_filter_is_near_the_exact_answer_and_ahead_of_the_papers_methods(numbers, key):
    found = numbers[key]
    particles, exact = (np.array(found[name]["rmse_m"]) for name in ("particle_filter", "bayes_grid"))
    assert np.all(particles[[15, 20]] < 1.15 * exact[[15, 20]])
    for paper in ("ekf", "triangulation", "ekf_drawn_start"):
        assert particles[20] < found[paper]["rmse_m"][20]
        for k in (15, 20):
            assert found["particle_filter"]["median_m"][k] < found[paper]["median_m"][k]


def test_the_papers_ekf():
    """4000 runs: the RMSE is known to 1.1 %, so 16.3 m lies below 17 m by four of its standard errors."""
    heard = trials.bearings(SIMULATION, 4000, np.random.default_rng(12))
    once = rmse(trials.paper_ekf(SIMULATION, heard, trials.START))
    assert 15.5 < once[20] < 17.0
    assert rmse(trials.paper_ekf(SIMULATION, heard, trials.START, repeated=True))[20] > once[20]
    assert rmse(trials.paper_ekf(SIMULATION, heard, trials.drawn_starts(heard, np.random.default_rng(1))))[15] > 25.0
    assert rmse(trials.log_polar_ekf(SIMULATION, heard))[20] < once[20]


def test_the_ekf_settles_at_the_source_with_exact_bearings():
    heard = np.tile(SIMULATION.truth, (1, 1))
    assert trials.paper_ekf(SIMULATION, heard, SIMULATION.source)[0] == pytest.approx([SIMULATION.source] * 21)


def test_two_lines_meet_where_the_core_says():
    heard = trials.bearings(SIMULATION, 5, np.random.default_rng(2))
    points = trials.two_lines(SIMULATION, heard)
    for row, point in zip(heard, points, strict=True):
        origins = np.stack([SIMULATION.vehicle.real[[0, 20]], np.zeros(2)], axis=1)
        fix = intersect(origins, row[[0, 20]], np.full(2, 1e-6))
        if fix is not None:
            assert point[20] == pytest.approx(complex(*fix.mean), rel=1e-6)
    assert np.abs(points[:, 0]) == pytest.approx(2 / 3 * (140**3 - 1) / (140**2 - 1))


def test_the_batched_log_polar_ekf_is_the_core_ekf(monkeypatch):
    """But for members that wait while the vehicle is too near to them, which the paper's start would be at once."""
    from uw_acoustic_loc.core.localizer import bearing_ekf
    from uw_acoustic_loc.core.localizer.bearing_ekf import single_start

    monkeypatch.setattr(bearing_ekf, "_far_enough", lambda member: member)
    heard = trials.bearings(SIMULATION, 3, np.random.default_rng(3))
    batch = trials.log_polar_ekf(SIMULATION, heard)
    for row, answers in zip(heard, batch, strict=True):
        ekf = single_start(np.zeros(2), np.array([50.0, 50.0]), trials.START_STD**2 * np.eye(2))
        for ray, answer in zip(trials.rays(SIMULATION, row), answers, strict=True):
            ekf.update(ray)
            assert answer == pytest.approx(complex(*ekf.estimate().mean))


def test_the_sea_trial_spans_the_papers_bearings():
    course = trials.COURSES["sea_trial"]
    assert np.degrees(course.truth[[0, 10, 20]]) == pytest.approx([70.0, 90.0, 110.0])
    assert np.diff(course.vehicle.real) == pytest.approx(1.5)
    errors = trials.bearings(course, 500, np.random.default_rng(4)) - course.truth
    assert np.abs(errors).max() < math.radians(10.0)
    assert errors.std() == pytest.approx(trials.STD, rel=0.03)


def test_the_same_seed_gives_the_same_json_and_another_one_does_not(capsys):
    printed = []
    for seed in ("4", "4", "5"):
        assert main(["reproduce", "localizer", "--runs", "2", "--seed", seed, "--json"]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1] != printed[2]
    assert set(json.loads(printed[0])) == {"simulation", "sea_trial"}


def test_the_folder_holds_page_tables_numbers_and_pictures(tmp_path):
    assert main(["reproduce", "localizer", "--runs", "2", "-o", str(tmp_path)]) == 0
    pictures = re.findall(r"\]\((\S+\.png)\)", (tmp_path / "README.md").read_text())
    assert len(pictures) == 5
    assert all((tmp_path / name).read_bytes()[:4] == b"\x89PNG" for name in pictures)
    assert {path.name for path in tmp_path.glob("*.csv")} == {"localizer_simulation.csv", "localizer_sea_trial.csv"}
