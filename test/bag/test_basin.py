"""The basin scenario offline: acoustic frames with echoes, bearings, SLAM."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.simulate import simulate
from uw_acoustic_loc.cli.errors import Errors, source_errors, vehicle_errors
from uw_acoustic_loc.cli.recording import load
from uw_acoustic_loc.graph import load_graph
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.sim.scenario import load_scenario


def refusing(node: str, refusal: object) -> None:
    raise AssertionError(f"{node}: {refusal}")


def estimated(folder: Path, seed: int, duration: float) -> tuple[dict[str, Errors], Errors, Errors]:
    """Errors of the pingers, the SLAM track and the dead reckoning."""
    basin = resource("config/basin")
    scenario = dataclasses.replace(load_scenario(basin / "scenario.yaml"), seed=seed, duration=duration)
    simulate(scenario, folder / "measured", lambda _: None)
    run = OfflineRun(Bag(folder / "measured"), load_graph(basin / "graph.yaml"), refusing)
    run.run(folder / "estimated", keep_inputs=True, progress=lambda _: None)
    recording = load(folder / "estimated")
    pingers = {series.id: source_errors(recording, series) for series in recording.all("slam_source")}
    track, reckoned = (vehicle_errors(recording, next(iter(recording.all(role)))) for role in ("slam", "odometry"))
    assert all(pingers.values()) and track and reckoned
    return pingers, track, reckoned


def rms(errors: Errors) -> float:
    return float(np.sqrt(np.mean(np.square(errors.distance))))


def test_pingers_are_found_soon(tmp_path):
    """Roughly, after a quarter of the way: echoes that wander slowly still look like a turn of the vehicle then."""
    pingers, track, _ = estimated(tmp_path, 21, 50.0)
    assert set(pingers) == {"a", "b", "c"}
    assert all(errors.distance[-1] < 4.0 for errors in pingers.values())
    assert rms(track) < 1.5


@pytest.mark.slow
def test_every_pinger_is_found_from_its_sound(tmp_path):
    """NEES per dimension of 3 pingers and 2 runs: two-dimensional errors, 12 degrees of freedom, and echoes that do not
    change with the seed; 2.5 is the 99.9 % limit of chi-square(12) / 12 and a quarter of a unit for the echoes.
    """
    nees, square, drift = [], 0.0, 0.0
    for seed in (31, 32):
        pingers, track, reckoned = estimated(tmp_path / str(seed), seed, 200.0)
        assert set(pingers) == {"a", "b", "c"}
        for errors in pingers.values():
            assert errors.distance[-1] < 0.6
            nees.append(errors.nees[-1])
        square, drift = square + rms(track) ** 2, drift + rms(reckoned) ** 2
    assert square < drift / 4
    assert np.mean(nees) < 2.5
