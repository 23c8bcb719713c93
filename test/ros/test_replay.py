"""A bag through live nodes gives what it gives offline, message for message."""

import dataclasses
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from test.ros.conftest import uwloc
from uw_acoustic_loc.bag.fingerprint import fingerprints
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.remap import RemappedBag
from uw_acoustic_loc.bag.rosbags_messages import deserialize
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.ros.orchestrator import pacing
from uw_acoustic_loc.ros.orchestrator.pacing import PlayerPacing, Stuck
from uw_acoustic_loc.ros.orchestrator.replay import replay_deliveries
from uw_acoustic_loc.ros.report import NodeReport, Sent, Taken

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
    return harbour(tmp_path_factory.mktemp("harbour"), 10.0)


def harbour(folder: Path, duration: float) -> Path:
    """A bag of the harbour's first seconds."""
    scenario = yaml.safe_load((HARBOUR / "scenario.yaml").read_text()) | {"duration": duration}
    (folder / "scenario.yaml").write_text(yaml.safe_dump(scenario))
    done = uwloc("simulate", folder / "scenario.yaml", "-o", folder / "bag")
    assert done.returncode == 0, done.stderr
    return folder / "bag"


def check_runs(bag: Path, out: Path, rates: Sequence[int], limit_s: float = 120.0) -> None:
    """Two offline runs, and replays at these rates, all have the same hashes."""
    graph = HARBOUR / "graph.yaml"
    runs = {f"process {k}": ("process", bag, "--graph", graph, "-o", out / f"process {k}") for k in (1, 2)}
    for rate in rates:
        name = f"rate {rate}"
        runs[name] = ("replay", bag, "--graph", graph, "--rate", rate, "-o", out / name)
    for arguments in runs.values():
        done = uwloc(*arguments, limit_s=limit_s)
        assert done.returncode == 0, done.stderr
        if "replay" in arguments:
            assert "/auv1/imu/data: " in done.stderr and "LOST" not in done.stderr
    found = {name: fingerprints(Bag(out / name)) for name in runs}
    assert len(found["process 1"]) >= 12
    for name, hashes in found.items():
        assert hashes == found["process 1"], name


def test_live_and_offline_give_the_same(domain: int, measured: Path, tmp_path: Path) -> None:
    check_runs(measured, tmp_path, rates=[0, 20])


@pytest.mark.slow
def test_no_speed_changes_a_result(domain: int, tmp_path: Path) -> None:
    check_runs(harbour(tmp_path, 20.0), tmp_path, rates=[0, 1, 20], limit_s=180.0)


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


def test_topics_of_another_name_feed_the_graph(domain: int, measured: Path, tmp_path: Path) -> None:
    theirs, ours = "/their/offsets", "/mooring/buoy1/offset"
    with BagWriter(tmp_path / "theirs") as writer:
        for record in Bag(measured).records([ours]):
            writer.add_topic(theirs, record.msgtype)
            writer.write(theirs, record.t_ns, record.data)
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: mooring_tracker, params: params.yaml}]")
    (tmp_path / "params.yaml").write_text("mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}")
    given = ("--graph", tmp_path / "graph.yaml", "--remap", f"{theirs}:={ours}")
    live = uwloc("replay", tmp_path / "theirs", *given, "--rate", 0, "-o", tmp_path / "live")
    offline = uwloc("process", tmp_path / "theirs", *given, "-o", tmp_path / "offline", "--keep-inputs")
    assert (live.returncode, offline.returncode) == (0, 0), live.stderr + offline.stderr
    assert f"{ours}: 21 out, 21 in /mooring_tracker" in live.stderr
    expected, got = fingerprints(Bag(tmp_path / "offline")), fingerprints(Bag(tmp_path / "live"))
    assert got["/mooring/buoy1/odometry"] == expected["/mooring/buoy1/odometry"]
    assert expected[ours].count == 21, "kept by its new name"


def test_deliveries_are_counted_in_bags_and_reports(tmp_path: Path) -> None:
    for name, topics in (("in", ["/a", "/a"]), ("out", ["/b"])):
        with BagWriter(tmp_path / name) as writer:
            for k, topic in enumerate(topics, 1):
                writer.add_topic(topic, "std_msgs/msg/Empty")
                writer.write(topic, k, b"\0\1\0\0\0")
    reports = {
        "/one": NodeReport(taken={"/a": Taken(1)}, sent={"/b": Sent(2)}),
        "/two": NodeReport(taken={"/b": Taken(2)}),
        "/recorder": NodeReport(taken={"/b": Taken(2)}),
    }
    deliveries = replay_deliveries(reports, RemappedBag(Bag(tmp_path / "in"), {}), Bag(tmp_path / "out"))
    assert [entry.sentence for entry in deliveries if not entry.complete] == [
        "/a: 2 out, 1 in /one",
        "/b: 2 out, 1 in the new bag",
    ]
    assert [entry.sentence for entry in deliveries if entry.complete] == ["/b: 2 out, 2 in /two"]


class Silent:
    """Stands for the services of a player that hangs."""

    def waiting_for(self) -> list[str]:
        return []

    def ask(self, names: list[str], finish: bool, timeout_s: float) -> dict[str, Any]:
        del names, finish, timeout_s
        return {}


def test_a_player_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pacing, "_ASK_S", 0.0)
    watch = PlayerPacing(Silent(), "/player")  # type: ignore[arg-type]
    watch.begin()
    assert watch.advance() == 0.0
    monkeypatch.setattr(pacing, "_DEAD_S", 0.0)
    with pytest.raises(Stuck, match="/player has not answered for 0 s"):
        watch.advance()


def test_a_bag_without_the_needed_topics_is_refused(domain: int, tmp_path: Path) -> None:
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: multistatic_fusion}]")
    done = uwloc("replay", LASKER, "--graph", tmp_path / "graph.yaml", "-o", tmp_path / "out")
    assert done.returncode == 1
    assert "has none of the topics that the graph needs: /sonar/detections, /sonar/positions" in done.stderr
    assert not (tmp_path / "out").exists()
