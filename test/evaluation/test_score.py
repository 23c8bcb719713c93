"""Scores of a run with drawn errors: every number within its sampling band; sections only where there are topics."""

from __future__ import annotations

import io
import json
import re

import numpy as np
import pytest
from scipy.stats import chi2

from test import known_run as run
from uw_acoustic_loc.evaluation.recording import load
from uw_acoustic_loc.evaluation.score import score, table


@pytest.fixture(scope="module")
def scored(tmp_path_factory):
    return score(load(run.write_bag(tmp_path_factory.mktemp("score") / "bag", run.everything())))


def rms_band(std: float, n: int) -> tuple[float, float]:
    """99.9 % of the RMS of n normal errors."""
    low, high = chi2.ppf([0.0005, 0.9995], n) / n
    return std * np.sqrt(low), std * np.sqrt(high)


def nees_band(n: int, dims: int) -> tuple[float, float]:
    low, high = chi2.ppf([0.0005, 0.9995], n * dims) / (n * dims)
    return low, high


def within(value: float, band: tuple[float, float]) -> bool:
    return band[0] < value < band[1]


def test_keys_are_the_agreed_ones(scored):
    assert set(scored) == {"bearing", "localizer", "slam", "toa", "multistatic", "mooring", "latency"}
    bearing = {"n", "rmse_deg", "median_deg", "p95_deg", "gross_fraction", "nes_mean"}
    assert {name: set(part) for name, part in scored["bearing"].items()} == {"a": bearing, "b": bearing}
    assert set(scored["localizer"]["a"]) == {"n", "rmse_m", "final_m", "nees_mean"}
    assert set(scored["slam"]["vehicle"]) == {"rmse_m", "final_m", "dead_reckoning_final_m", "nees_mean"}
    assert set(scored["slam"]["sources"]["b"]) == {"final_m"}
    toa = "n mean_m rmse_m p95_m max_m horizontal_rmse_m vertical_rmse_m sound_speed_rmse nees_mean"
    assert set(scored["toa"]) == set(toa.split())
    assert set(scored["multistatic"]) == {"n", "rmse_m", "median_m", "nees_mean", "tracks"}
    assert set(scored["mooring"]["m1"]) == {"mean_m", "std_m", "raw_std_m"}
    assert json.loads(json.dumps(scored, allow_nan=False)) == scored


def test_bearing(scored):
    for numbers in scored["bearing"].values():
        assert numbers["n"] == 296
        assert within(numbers["rmse_deg"], rms_band(np.degrees(run.BEARING_STD), 296))
        assert within(numbers["nes_mean"], nees_band(296, 1))
        assert numbers["gross_fraction"] == 0.0
        assert numbers["median_deg"] < numbers["rmse_deg"] < numbers["p95_deg"]


def test_localizer_in_a_turned_odom(scored):
    horizontal = np.sqrt(run.COV[0, 0] + run.COV[1, 1])
    for numbers in scored["localizer"].values():
        assert numbers["n"] == 301
        # nearly all of the error is along one axis: the band of one degree of freedom is the wider one
        assert within(numbers["rmse_m"], rms_band(horizontal, 301))
        assert within(numbers["nees_mean"], nees_band(301, 2))


def test_slam_and_dead_reckoning(scored):
    vehicle = scored["slam"]["vehicle"]
    assert within(vehicle["nees_mean"], nees_band(301, 2))
    assert within(vehicle["rmse_m"], rms_band(np.sqrt(0.26), 301))
    assert vehicle["dead_reckoning_final_m"] == pytest.approx(6.0, abs=1e-6)  # 0.1 m/s for 60 s
    assert scored["slam"]["sources"]["a"]["final_m"] == pytest.approx(0.5, abs=1e-6)  # 0.3, 0.4; depth does not count


def test_toa(scored):
    toa = scored["toa"]
    assert toa["n"] == 61
    assert within(toa["nees_mean"], nees_band(61, 3))
    assert within(toa["vertical_rmse_m"], rms_band(2.0, 61))
    assert toa["rmse_m"] ** 2 == pytest.approx(toa["horizontal_rmse_m"] ** 2 + toa["vertical_rmse_m"] ** 2)
    assert toa["mean_m"] <= toa["rmse_m"] <= toa["p95_m"] <= toa["max_m"]
    assert within(toa["sound_speed_rmse"], rms_band(run.SPEED_STD, 61))  # the truth moves by 1 m/s from ping to ping


def test_multistatic_where_the_ping_met_the_target(scored):
    part = scored["multistatic"]
    assert (part["n"], part["tracks"]) == (100, 2)
    assert within(part["nees_mean"], nees_band(100, 2))
    eigenvalues = np.linalg.eigvalsh(run.FIX_COV)
    draws = np.random.default_rng(0).normal(size=(4000, 100, 2)) ** 2 @ eigenvalues
    assert within(part["rmse_m"], tuple(np.quantile(np.sqrt(draws.mean(axis=1)), [0.0005, 0.9995])))


def test_mooring(scored):
    part = scored["mooring"]["m1"]
    n = 1001
    assert abs(part["mean_m"] - 0.02) < 3.3 * run.MOORING_STD / np.sqrt(n)
    assert within(part["std_m"], rms_band(run.MOORING_STD, n))
    assert within(part["raw_std_m"], rms_band(run.OFFSET_STD, n))


def test_latency(scored):
    latency = scored["latency"]
    assert latency["/auv1/sources/a/bearing"] == pytest.approx({"p50_ms": 40.0, "p99_ms": 40.0})
    assert latency["/target/odometry"] == pytest.approx({"p50_ms": 400.0, "p99_ms": 400.0})
    assert not [topic for topic in latency if topic.startswith("/truth") or topic == "/auv1/odometry"]


def test_without_truth_only_latency_is_left(recorded):
    rng = np.random.default_rng(2)
    found = score(recorded([*run.bearings(rng), *run.localizer(rng), *run.slam(rng)]))
    assert set(found) == {"latency"}


def test_a_section_needs_its_own_topics(recorded):
    rng = np.random.default_rng(3)
    found = score(recorded([*run.truth(), *run.bearings(rng)]))
    assert set(found) == {"bearing", "latency"}


def test_an_empty_bag_has_no_score(recorded):
    assert score(recorded([])) == {}


def test_unknown_covariance_leaves_nees_out(recorded):
    def unknown(event):
        t_ns, topic, value = event
        if "slam/odometry" not in topic:
            return event
        cov = np.zeros((6, 6))
        cov[0, 0] = -1.0
        return t_ns, topic, type(value)(**{**vars(value), "pose_cov": cov})

    events = [*run.truth(), *run.dead_reckoning(), *run.slam(np.random.default_rng(4))]
    vehicle = score(recorded(map(unknown, events)))["slam"]["vehicle"]
    assert set(vehicle) == {"rmse_m", "final_m", "dead_reckoning_final_m"}


def test_the_second_vehicle_is_told_apart(recorded):
    rng = np.random.default_rng(5)
    events = [
        e for space in ("/auv1", "/auv2") for e in (*run.truth(space), *run.bearings(rng, space), *run.slam(rng, space))
    ]
    found = score(recorded(events))
    assert set(found["bearing"]) == {"a", "b", "auv2/a", "auv2/b"}
    assert set(found["slam"]) == {"vehicle", "auv2/vehicle", "sources"}
    assert set(found["slam"]["sources"]) == {"a", "b", "auv2/a", "auv2/b"}


def test_every_number_is_in_the_table(scored):
    from rich.console import Console

    console = Console(width=80, file=io.StringIO())
    console.print(table(scored))
    shown = console.file.getvalue()
    for number in (scored["slam"]["vehicle"]["dead_reckoning_final_m"], scored["toa"]["p95_m"]):
        assert f"{number:.3f}" in shown
    assert "…" not in shown
    numbers = re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.°])", shown)
    assert len(numbers) >= sum(1 for _ in _leaves(scored))


def _leaves(part):
    for value in part.values():
        if isinstance(value, dict):
            yield from _leaves(value)
        else:
            yield value
