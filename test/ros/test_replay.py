"""A bag through live nodes gives what it gives offline, message for message."""

import dataclasses
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from test.ros.conftest import uwloc
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.types import deserialize
from uw_acoustic_loc.resources import resource

REPO = Path(__file__).parents[2]
HARBOUR = resource("config/harbour")
LASKER = REPO / "bags" / "lasker_ac109"
PUBLISHED = {"b": [(1850, 3300), (380, -3730)], "c": [(3250, 2400), (2000, -3400)]}  # m, and their mirror images


def messages(bag: Path) -> dict[str, list[Any]]:
    """Decoded messages per topic."""
    found = defaultdict(list)
    for record in Bag(bag).records():
        if record.topic != "/diagnostics":
            found[record.topic].append(dataclasses.asdict(deserialize(record.data, record.msgtype)))
    return dict(found)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The harbour's first ten seconds."""
    folder = tmp_path_factory.mktemp("harbour")
    scenario = yaml.safe_load((HARBOUR / "scenario.yaml").read_text()) | {"duration": 10.0}
    (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario))
    done = uwloc("simulate", folder / "scenario.yaml", "-o", folder / "bag")
    assert done.returncode == 0, done.stderr
    return folder / "bag"


def test_live_and_offline_give_the_same(domain: int, measured: Path, tmp_path: Path) -> None:
    graph = HARBOUR / "graph.yaml"
    offline = uwloc("process", measured, "--graph", graph, "-o", tmp_path / "offline")
    assert offline.returncode == 0, offline.stderr
    live = uwloc("replay", measured, "--graph", graph, "--rate", "0", "-o", tmp_path / "live")
    assert live.returncode == 0, live.stderr
    expected, got = messages(tmp_path / "offline"), messages(tmp_path / "live")
    assert {t: len(m) for t, m in got.items()} == {t: len(m) for t, m in expected.items()}
    assert len(got) >= 12
    for topic, values in expected.items():
        np.testing.assert_equal(got[topic], values, err_msg=topic)


def test_both_whales_are_found_or_their_mirror_images(domain: int, tmp_path: Path) -> None:
    graph = resource("config/lasker_ac109/graph.yaml")
    done = uwloc("replay", LASKER, "--graph", graph, "-o", tmp_path / "out", "--rate", "0")
    assert done.returncode == 0, done.stderr
    found = messages(tmp_path / "out")
    for animal, fixes in PUBLISHED.items():
        places = [
            found[f"/auv1/sources/{animal}/{topic}"][-1]["pose"]["pose"]["position"]
            for topic in ("position", "mirror_position")
        ]
        ends = [np.array([place["x"], place["y"]]) for place in places]
        # one hypothesis on each side of the track, each within 250 m of the published fix of its side
        for fix in fixes:
            assert min(np.hypot(*(end - fix)) for end in ends) < 250.0


def test_a_bag_without_the_needed_topics_is_refused(domain: int, tmp_path: Path) -> None:
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: multistatic_fusion}]")
    done = uwloc("replay", LASKER, "--graph", tmp_path / "graph.yaml", "-o", tmp_path / "out")
    assert done.returncode == 1
    assert "has none of the topics that the graph needs: /sonar/detections, /sonar/positions" in done.stderr
    assert not (tmp_path / "out").exists()
