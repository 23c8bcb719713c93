"""One source's localizer: sides, gate, correlation, a new start, and a real towed array."""

from __future__ import annotations

import cmath
import csv
import math
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.core.geometry import mirror_bearing, wrap_angle
from uw_acoustic_loc.core.impulsive import AlphaStable, ImpulsiveNoise
from uw_acoustic_loc.core.localizer.config import LocalizerConfig
from uw_acoustic_loc.core.localizer.localizer import SourceLocalizer, independent_share

STD = math.radians(2)
SOURCE = (20.0, 15.0)
METHODS = ("triangulation", "ekf", "particle_filter")


def config(**values):
    defaults = {"source_ids": ("a",), "bearing_correlation_time": 0.0, "process_noise": 0.0, "bearing_std": STD}
    return build(LocalizerConfig, defaults | values, "test")


def heard(x: float, y: float, yaw: float, source=SOURCE) -> float:
    return wrap_angle(math.atan2(source[1] - y, source[0] - x) - yaw)


def corner(k: int) -> tuple[float, float, float]:
    """Along x for 200 steps of 0.15 m, then along y."""
    return (0.15 * k, 0.0, 0.0) if k < 200 else (30.0, 0.15 * (k - 200), math.pi / 2)


def run(localizer: SourceLocalizer, steps: range, seed: int, image=lambda b: b, source=SOURCE) -> None:
    rng = np.random.default_rng([31, seed])
    for k in steps:
        x, y, yaw = corner(k)
        bearing = image(heard(x, y, yaw, source) + rng.normal(0, STD))
        localizer.update((k + 1) * 100_000_000, x, y, yaw, wrap_angle(bearing), math.nan)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("wrong", [False, True])
def test_a_turn_settles_the_side(method, wrong):
    localizer = SourceLocalizer(config(method=method, particles=1000), 0)
    image = (lambda b: mirror_bearing(b, 0.0)) if wrong else (lambda b: b)
    run(localizer, range(190), 1, image)
    assert len(localizer.sides) == 2 and 0.01 < localizer.mirror_probability < 0.99
    run(localizer, range(190, 300), 2, image)
    assert len(localizer.sides) == 1
    fix = localizer.sides[0].fix
    assert fix is not None and math.dist(fix.mean, SOURCE) < 1.0


def test_a_moving_source_is_followed_and_its_side_settled():
    """It walks along x at 0.5 m/s while the vehicle turns two corners."""
    localizer, rng = SourceLocalizer(config(source_speed_std=0.5), 0), np.random.default_rng(33)
    for k in range(500):
        x, y, yaw = corner(k) if k < 350 else (30.0 - 0.15 * (k - 350), 22.5, math.pi)
        at = (-10.0 + 0.05 * k, 40.0)
        localizer.update((k + 1) * 100_000_000, x, y, yaw, wrap_angle(heard(x, y, yaw, at) + rng.normal(0, STD)), 0.0)
    assert len(localizer.sides) == 1
    assert math.dist(localizer.sides[0].fix.mean, at) < 3.0


@pytest.mark.parametrize("method", METHODS)
def test_a_straight_run_leaves_both_sides(method):
    localizer = SourceLocalizer(config(method=method, particles=1000), 0)
    run(localizer, range(200), 3)
    fixes = [side.fix for side in localizer.sides]
    assert len(fixes) == 2 and None not in fixes
    assert math.dist(fixes[0].mean, SOURCE) < 1.5
    assert math.dist(fixes[1].mean, (SOURCE[0], -SOURCE[1])) < 1.5


@pytest.mark.parametrize("drift", [-0.003, 0.003])
def test_a_drifting_heading_is_no_evidence_of_a_side(drift):
    """Precise bearings from a straight run that dead reckoning bends fit one side better, be it the wrong one."""
    std, rng, yaw_error, told = math.radians(0.1), np.random.default_rng(34), 0.0, complex(*corner(0)[:2])
    localizer, states = SourceLocalizer(config(bearing_std=std, process_noise=0.2), 0), []
    for k in range(320):
        x, y, yaw = corner(k)
        bearing = heard(x, y, yaw) + rng.normal(0, std)
        localizer.update((k + 1) * 100_000_000, told.real, told.imag, yaw + yaw_error, wrap_angle(bearing), math.nan)
        states.append((len(localizer.sides), localizer.mirror_probability))
        yaw_error = drift * 0.1 * (k + 1)
        told += (complex(*corner(k + 1)[:2]) - complex(x, y)) * cmath.exp(1j * yaw_error)
    sides, wrong = states[199]
    assert sides == 2 and not 1e-3 < wrong < 1 - 1e-3  # the evidence is there, and is not believed
    assert len(localizer.sides) == 1 and math.dist(localizer.sides[0].fix.mean, SOURCE) < 2.0


def test_correlated_errors_stay_honest():
    """AR(1) errors: with the correlation time the NEES is near 1, without it far above."""
    rho, runs = math.exp(-0.1 / 1.0), 40
    nees = {}
    for correlation_time in (0.0, 1.0):
        values = []
        for seed in range(runs):
            rng, error = np.random.default_rng([32, seed]), 0.0
            localizer = SourceLocalizer(config(bearing_correlation_time=correlation_time, mirror=False), 0)
            for k in range(400):
                x, y, yaw = corner(k)
                error = rho * error + math.sqrt(1 - rho**2 if k else 1.0) * rng.normal(0, STD)
                localizer.update((k + 1) * 100_000_000, x, y, yaw, wrap_angle(heard(x, y, yaw) + error), math.nan)
            fix = localizer.sides[0].fix
            off = fix.mean - SOURCE
            values.append(off @ np.linalg.solve(fix.cov, off) / 2)
        nees[correlation_time] = np.mean(values)
    assert 0.5 < nees[1.0] < 1.6 and nees[0.0] > 5


IMPULSES = AlphaStable(1.8, 1.0, 10.0, -3.0)  # table 1 of Lee, Yang, Huh 2013


def nees_once_round(noise: str, method: dict[str, object], seed: int) -> float:
    """120 bearings of 2 degrees, one in five an impulse of 20 degrees and more, on a circle about the source."""
    rng = np.random.default_rng([34, seed])
    errors = ImpulsiveNoise(STD, 0.2, IMPULSES).draw(rng, 120)
    errors[0] = rng.normal(0, STD)
    localizer = SourceLocalizer(config(mirror=False, bearing_noise=noise, range_max=100.0, **method), 0)
    for k, turn in enumerate(np.linspace(0, 2 * math.pi, 120)):
        x, y = 40 * math.cos(turn), 40 * math.sin(turn)
        localizer.update((k + 1) * 10**9, x, y, 0.0, wrap_angle(heard(x, y, 0.0) + errors[k]), math.nan)
    fix = localizer.sides[0].fix
    off = fix.mean - SOURCE
    return float(off @ np.linalg.solve(fix.cov, off)) / 2


@pytest.mark.parametrize("noise", ["mixture", "student_t"])
@pytest.mark.parametrize("method", [{}, {"source_speed_std": 0.05}])
def test_impulses_do_not_kill_the_right_range(noise, method):
    """NEES / 2 of 25 runs within four times the spread that it has when it is honest."""
    assert np.mean([nees_once_round(noise, method, seed) for seed in range(25)]) < 1 + 4 / math.sqrt(25)


def test_independent_share():
    rho = math.exp(-0.1 / 2.0)
    assert independent_share(0.1, 2.0) == pytest.approx((1 - rho) / (1 + rho))
    assert independent_share(0.1, 0.0) == 1.0 and independent_share(100.0, 1.0) == pytest.approx(1.0)


def test_outliers_are_gated_and_a_moved_source_is_found_again():
    localizer = SourceLocalizer(config(mirror=False), 0)
    run(localizer, range(200), 4)
    before = localizer.sides[0].fix.mean
    localizer.update(201 * 100_000_000, 30.0, 0.0, 0.0, heard(30.0, 0.0, 0.0) + 1.5, math.nan)
    assert localizer.unused == 1
    np.testing.assert_array_equal(localizer.sides[0].fix.mean, before)
    run(localizer, range(202, 400), 5, source=(60.0, 40.0))
    assert localizer.restarts == 1
    assert math.dist(localizer.sides[0].fix.mean, (60.0, 40.0)) < 3.0


def test_same_seed_same_answer():
    fixes = []
    for _ in range(2):
        localizer = SourceLocalizer(config(method="particle_filter", seed=5), 0)
        run(localizer, range(150), 6)
        fixes.append(localizer.sides[0].fix.mean)
    np.testing.assert_array_equal(*fixes)


def test_sentences():
    localizer = SourceLocalizer(config(bearing_std=0.0), 0)
    with pytest.raises(ValueError, match="variance must be positive while bearing_std is 0, got -1"):
        localizer.update(1, 0, 0, 0, 0.5, -1.0)
    localizer.update(5, 0, 0, 0, 0.5, 0.01)
    with pytest.raises(ValueError, match="bearing at 5 ns must come after the one at 5 ns"):
        localizer.update(5, 0, 0, 0, 0.5, 0.01)
    for values, sentence in (
        ({"source_ids": ()}, "source_ids must name at least one source"),
        ({"source_ids": ("a", "a")}, "source_ids must differ, got 'a' twice"),
        ({"source_ids": ("1a",)}, "source_ids must be letters"),
        ({"range_min": 5.0, "range_max": 4.0}, "range_min must be below range_max"),
        ({"lines": 7}, "lines must be even, got 7"),
        (
            {"source_speed_std": 0.5, "method": "triangulation"},
            "source_speed_std needs method ekf, got 0.5 with tri",
        ),
    ):
        with pytest.raises(ValueError, match=sentence):
            config(**values)


TOWED = Path(__file__).parents[4] / "shared" / "data" / "towed_array"
ANIMALS = {
    "B": ((18, 23, 28, 33), ((1850, 3300), (380, -3730))),
    "C": ((25, 29, 32, 38), ((3250, 2400), (2000, -3400))),
}


def column(name: str, *keys: str) -> np.ndarray:
    with (TOWED / name).open() as file:
        return np.array([[float(row[key]) for key in keys] for row in csv.DictReader(file)])


@pytest.mark.skipif(not TOWED.is_dir(), reason=f"the towed-array recording is not at {TOWED}")
@pytest.mark.parametrize("animal", ANIMALS)
@pytest.mark.parametrize("method", METHODS)
def test_towed_array(animal, method):
    tracks, published = ANIMALS[animal]
    sensors = column(
        "GPSandPosition_table.csv", "Sensor1_pos_x_m", "Sensor1_pos_y_m", "Sensor2_pos_x_m", "Sensor2_pos_y_m"
    )
    heard_at = column("tdoa_tracks.csv", "track", "time_s", "tdoa_s")
    heard_at = heard_at[np.isin(heard_at[:, 0], tracks)]
    _, first = np.unique(heard_at[:, 1], return_index=True)
    wanted = config(
        method=method,
        bearing_noise="gaussian",  # no call is a direction at random
        bearing_std=math.radians(1.5),
        bearing_correlation_time=10.0,
        range_min=100.0,
        range_max=10_000.0,
    )
    localizer = SourceLocalizer(wanted, 0)
    for _, time, tdoa in heard_at[first]:
        front, aft = sensors[round(2 * time), :2], sensors[round(2 * time), 2:]
        x, y = (front + aft) / 2
        yaw = math.atan2(*(front - aft)[::-1])
        bearing = math.acos(max(-1.0, min(1.0, -1500 * tdoa / 25.59)))
        localizer.update(round(time * 1e9) + 1, x, y, yaw, bearing, math.nan)
    assert len(localizer.sides) == 2 and 0.3 < localizer.mirror_probability < 0.7
    for side, point in zip(localizer.sides, published, strict=True):
        assert side.fix is not None and math.dist(side.fix.mean, point) < 250.0
