"""Many bags at once: each has its output, a bad one is named and stops no other."""

from pathlib import Path

import numpy as np
import pytest

from uw_acoustic_loc.bag.fingerprint import fingerprints
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import encode
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.types import Point

SECOND = 1_000_000_000
TOPIC = "/mooring/buoy1/offset"


def write_bag(path: Path, seed: int) -> Path:
    rng = np.random.default_rng(seed)
    with BagWriter(path) as writer:
        writer.add_topic(TOPIC, "geometry_msgs/msg/PointStamped")
        for k in range(1, 40):
            point = Point(k * SECOND, np.array([rng.normal(), 0.0, 0.0]))
            writer.write(TOPIC, point.t_ns, encode(point))
    return path


@pytest.fixture
def graph(tmp_path: Path) -> str:
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: mooring_tracker, params: params.yaml}]")
    (tmp_path / "params.yaml").write_text("mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}")
    return str(tmp_path / "graph.yaml")


def test_all_good_bags_are_processed_and_the_bad_one_is_named(
    tmp_path: Path, graph: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bags = [write_bag(tmp_path / f"dive{k}", k) for k in (1, 2)]
    (tmp_path / "broken.mcap").write_bytes(b"no bag at all")
    given = [*map(str, bags), str(tmp_path / "broken.mcap")]
    assert main(["process", *given, "--graph", graph, "-o", str(tmp_path / "out"), "--jobs", "2"]) == 1
    said = capsys.readouterr().err
    (line,) = [line for line in said.splitlines() if "failed" in line]
    assert "broken.mcap: failed with exit code 1: uwloc: bag" in line
    assert "2 of 3 bags in" in said
    for bag in bags:
        assert main(["process", str(bag), "--graph", graph, "-o", str(tmp_path / f"{bag.name}_alone")]) == 0
        alone = fingerprints(Bag(tmp_path / f"{bag.name}_alone"))
        assert fingerprints(Bag(tmp_path / "out" / bag.name)) == alone
        assert alone["/mooring/buoy1/odometry"].count == 39


def test_two_bags_of_one_name_are_refused(tmp_path: Path, graph: str, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a").mkdir()
    bags = [str(write_bag(tmp_path / "dive", 1)), str(write_bag(tmp_path / "a" / "dive", 2))]
    assert main(["process", *bags, "--graph", graph, "-o", str(tmp_path / "out")]) == 1
    assert "another bag is named dive too" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_jobs_must_be_a_positive_number(tmp_path: Path, graph: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["process", "bag", "--graph", graph, "-o", str(tmp_path / "out"), "--jobs", "0"])
    assert stopped.value.code == 2
    assert "--jobs" in capsys.readouterr().err
