"""`uwloc check`: what passes, what fails, and with which sentence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from test.known_run import START_NS, everything, t_ns, write_bag
from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.types import Detections, Point
from uw_acoustic_loc.evaluation.check import Check, checked, load_expected


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("known") / "bag", everything())


def checks(bag: Path, tmp_path: Path, content: object) -> list[Check]:
    (tmp_path / "expected.yaml").write_text(yaml.safe_dump(content))
    return list(checked(bag, load_expected(tmp_path / "expected.yaml")))


def violations(bag: Path, tmp_path: Path, content: object) -> list[str]:
    return [one.sentence for one in checks(bag, tmp_path, content) if not one.passed]


ODOMETRY = "/auv1/odometry"  # 601 messages at 10 Hz


def test_what_is_as_expected_passes(bag: Path, tmp_path: Path) -> None:
    topic = {
        "name": ODOMETRY,
        "type": "nav_msgs/msg/Odometry",
        "count": [601, 601],
        "rate": [9.9, 10.1],
        "longest_gap": 0.11,
        "stamps_back": False,
        "values": [
            {"field": "pose.covariance[0]", "range": [0.25, 0.25]},
            {"field": "pose.pose.orientation.x", "range": [0, 0]},
        ],
    }
    scores = [{"name": "bearing.a.rmse_deg", "range": [0.3, 0.9]}, {"name": "slam.sources.b.final_m", "range": [0, 1]}]
    found = checks(bag, tmp_path, {"topics": [topic], "scores": scores})
    assert [one.sentence for one in found if not one.passed] == []
    assert len(found) == 10, "seven of the topic, two scores, damage"


@pytest.mark.parametrize(
    ("wanted", "sentence"),
    [
        ({"type": "nav_msgs/msg/Path"}, f"{ODOMETRY} type must be nav_msgs/msg/Path, got nav_msgs/msg/Odometry"),
        ({"count": [1, 600]}, f"{ODOMETRY} count must be from 1 to 600, got 601"),
        ({"rate": [10.1, 20]}, f"{ODOMETRY} rate in Hz must be from 10.1 to 20, got 10"),
        ({"longest_gap": 0.05}, f"{ODOMETRY} longest interval in s must be from 0 to 0.05, got 0.1"),
        (
            {"values": [{"field": "pose.covariance", "range": [0, 0.1]}]},
            f"{ODOMETRY} pose.covariance must be from 0 to 0.1, got from 0 to 0.25",
        ),
        (
            {"values": [{"field": "pose.speed", "range": [0, 1]}]},
            f"{ODOMETRY} pose.speed must be from 0 to 1, got there is no field pose.speed: "
            "geometry_msgs__msg__PoseWithCovariance has no speed",
        ),
        (
            {"values": [{"field": "header.frame_id", "range": [0, 1]}]},
            f"{ODOMETRY} header.frame_id must be from 0 to 1, got field header.frame_id holds no numbers",
        ),
        (
            {"values": [{"field": "pose.covariance[36]", "range": [0, 1]}]},
            f"{ODOMETRY} pose.covariance[36] must be from 0 to 1, got there is no field pose.covariance[36]: "
            "covariance has no element 36",
        ),
        (
            {"values": [{"field": "rows.x", "range": [0, 1]}]},
            f"{ODOMETRY} rows.x must be from 0 to 1, got rows.x is a column of sensor_msgs/msg/PointCloud2 only",
        ),
    ],
)
def test_each_violation_is_one_sentence(bag: Path, tmp_path: Path, wanted: dict, sentence: str) -> None:
    assert violations(bag, tmp_path, {"topics": [{"name": ODOMETRY, **wanted}]}) == [sentence]


def test_the_hash_is_that_of_uwloc_hash(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["hash", str(bag), "--json"]) == 0
    digest = json.loads(capsys.readouterr().out)["topics"][ODOMETRY]["sha256"]
    topic = {"name": ODOMETRY, "sha256": digest}
    assert violations(bag, tmp_path, {"topics": [topic]}) == []
    other = "0" * 63 + "f"
    sentence = f"{ODOMETRY} sha256 must be {other}, got {digest}"
    assert violations(bag, tmp_path, {"topics": [topic | {"sha256": other}]}) == [sentence]


def test_topics_and_scores_that_are_not_there(bag: Path, tmp_path: Path) -> None:
    content = {"topics": [{"name": "/no"}], "scores": [{"name": "bearing.z.rmse_deg", "range": [0, 1]}]}
    assert violations(bag, tmp_path, content) == [
        "/no must be in the bag, got nothing of that name",
        "score bearing.z.rmse_deg must be from 0 to 1, got nothing of that name",
    ]


def test_nan_is_in_no_range_and_columns_of_rows_are_checked(tmp_path: Path) -> None:
    one = np.ones(2)
    rows = Detections(START_NS, np.array([1, 2], np.uint16), one, one, one, one, np.array([3.0, np.nan]))
    path = write_bag(tmp_path / "bag", [(START_NS, "/sonar/detections", rows)])
    fields = [{"field": "rows.snr", "range": [-1e9, 1e9]}, {"field": "rows.receiver", "range": [1, 2]}]
    content = {"topics": [{"name": "/sonar/detections", "values": fields}]}
    assert [s.split(" must")[0] for s in violations(path, tmp_path, content)] == ["/sonar/detections rows.snr"]


def test_stamps_that_go_back(tmp_path: Path) -> None:
    events = [(t_ns(k), "/p", Point(t_ns(k % 3), np.zeros(3))) for k in range(6)]
    path = write_bag(tmp_path / "bag", events)
    content = {"topics": [{"name": "/p", "stamps_back": False}]}
    assert violations(path, tmp_path, content) == ["/p stamps that go back must be 0, got 1"]


def test_damage_is_a_violation_unless_it_is_expected(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", everything())
    file = path / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:-40])
    content = {"topics": [{"name": ODOMETRY, "count": [601, 601]}]}
    (sentence,) = violations(path, tmp_path, content)
    assert sentence.startswith("damage must be none, got bag")
    assert violations(path, tmp_path, content | {"damage": True}) == []


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "must have topics or scores, it has none"),
        ("topics: [{nam: /x}]", "unknown key 'nam', did you mean 'name'?"),
        ("topics: [{name: /x, count: [1]}]", "count must have 2 elements, got 1"),
        ("topics: [{name: /x, count: [2, 1]}]", "count must be [lowest, highest], got [2, 1]"),
        ("topics: [{name: /x, values: [{field: y}]}]", "key 'range' is missing"),
        (
            "topics: [{name: /x, sha256: abc}]",
            "sha256 must be 64 hexadecimal digits as uwloc hash prints them, got 'abc'",
        ),
        ("topics: [{name: /diagnostics, sha256: %s}]" % ("a" * 64), "sha256 of /diagnostics cannot be expected"),
        ("scores: [{name: x, range: []}]", "range must be [lowest, highest], got []"),
        ("[1]", "must be a mapping of keys to values"),
        ("{", "is not valid YAML"),
    ],
)
def test_a_wrong_expectation_is_one_sentence(
    text: str, sentence: str, bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "expected.yaml").write_text(text)
    assert main(["check", str(bag), str(tmp_path / "expected.yaml")]) == 1
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1


def test_the_program_prints_a_table_and_violations(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "e.yaml").write_text(f"topics: [{{name: {ODOMETRY}, count: [601, 601], rate: [1, 2]}}]")
    assert main(["check", str(bag), str(tmp_path / "e.yaml")]) == 1
    said = capsys.readouterr()
    assert said.err == f"uwloc: {bag}: {ODOMETRY} rate in Hz must be from 1 to 2, got 10\n"
    assert said.out.count("pass") == 2
    assert said.out.count("FAIL") == 1
    assert main(["check", str(bag), str(tmp_path / "e.yaml"), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["passed"], [one["passed"] for one in found["checks"]]) == (False, [True, False, True])
