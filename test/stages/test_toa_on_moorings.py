"""Buoys that sway on their moorings: offsets -> mooring_tracker -> toa_tracker, against the truth."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.config import build, changed, configured
from uw_acoustic_loc.core.mooring.model import MooringConfig
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.types import Odometry
from uw_acoustic_loc.sim.buoys import BuoySource
from uw_acoustic_loc.sim.scenario import Mooring, Scenario, load_scenario
from uw_acoustic_loc.stages.mooring_tracker import MooringTrackerStage
from uw_acoustic_loc.stages.runner import Runner
from uw_acoustic_loc.stages.toa_tracker import ToaTrackerStage

HARBOUR = load_scenario(Path(__file__).parents[2] / "config/harbour/scenario.yaml")
IDS = ("m1", "m2", "m3", "m4")
SOFT = {"stiffness": 0.05, "force": 0.25, "process_std": 0.1}  # 5 m on average, with a period of 28 s
TRACKER = configured(ToaConfig, bottom_depth=40.0, acceleration_noise=0.18, vertical_acceleration_noise=0.01)
CORRECTED = changed(TRACKER, mooring_ids=IDS, mooring_receivers=(1, 2, 3, 4))


def scenario(seed: int) -> Scenario:
    assert HARBOUR.buoys
    moorings = tuple(
        Mooring(name, receiver=k + 1, impulse_fraction=0.1, start=9.0 * (k % 2), **SOFT) for k, name in enumerate(IDS)
    )
    buoys = dataclasses.replace(HARBOUR.buoys, toa_std=3e-4)
    return dataclasses.replace(HARBOUR, seed=seed, buoys=buoys, moorings=moorings)


def track(story: Scenario, config: ToaConfig) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n,) in m and NEES (n,) over 3 of the settled positions."""
    moorings = MooringTrackerStage(MooringConfig(IDS, initial_std=5.0, impulse_fraction=0.1, **SOFT))
    offsets = {i.topic: i.handle for i in moorings.inputs}
    runner = Runner(lambda: ToaTrackerStage(config), 0.5, lambda _: None)
    truth, found = {}, []
    for _, topic, value in BuoySource(story).events():
        passed = [(topic, value)] if topic.startswith("buoys/") else list(offsets.get(topic, lambda _: ())(value))
        found += [e for message in passed if message[0] in topics(config) for e in runner.push(*message)]
        if topic == "/truth/target/odometry":
            truth[value.t_ns] = value.position
    found += runner.flush()
    estimates = [v for topic, v in found if isinstance(v, Odometry)][10:]
    off = np.array([v.position - truth[v.t_ns] for v in estimates])
    nees = [d @ np.linalg.solve(v.pose_cov[:3, :3], d) / 3 for d, v in zip(off, estimates, strict=True)]
    return np.linalg.norm(off, axis=1), np.array(nees)


def topics(config: ToaConfig) -> set[str]:
    return {i.topic for i in ToaTrackerStage(config).inputs}


def test_the_moorings_offsets_make_the_track_right_and_honest() -> None:
    corrected = [track(scenario(seed), CORRECTED) for seed in (41, 42, 43)]
    left = [track(scenario(seed), TRACKER) for seed in (41, 42, 43)]
    assert np.mean([d.mean() for d, _ in corrected]) < 0.6 * np.mean([d.mean() for d, _ in left])
    assert 0.6 < np.mean([nees.mean() for _, nees in corrected]) < 1.4
    assert np.mean([nees.mean() for _, nees in left]) > 3.0


def test_an_offset_without_a_variance_is_refused() -> None:
    stage = ToaTrackerStage(CORRECTED)
    assert "mooring/m2/odometry" in topics(CORRECTED)
    handle = next(i.handle for i in stage.inputs if i.topic == "mooring/m2/odometry")
    with pytest.raises(ValueError, match=r"receiver 2 must be finite with a variance, got 1\.0, -1\.0"):
        list(handle(Odometry(1, np.array([1.0, 0, 0]), np.array([0.0, 0, 0, 1]), np.zeros(3), np.zeros(3))))


def test_every_mooring_has_its_receiver() -> None:
    with pytest.raises(ValueError, match=r"as many as mooring_receivers, got \['m1'\] for \[\]"):
        build(ToaConfig, {"mooring_ids": ["m1"]}, "toa_tracker")
