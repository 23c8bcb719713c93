"""`uwloc info`: the content of bags, what is odd about them, and which estimators can use them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from test.bag.foreign import VARIANTS, write_mcap
from test.known_run import START_NS, dead_reckoning, everything, t_ns, write_bag
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import BagMake, serialize
from uw_acoustic_loc.bag.survey import survey
from uw_acoustic_loc.bag.usable import uses
from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.types import Bearing, BodyVelocity, Imu, Odometry, Point
from uw_acoustic_loc.wire.codec import codec


def described(capsys: pytest.CaptureFixture[str], path: Path) -> dict:
    code = main(["info", str(path), "--json"])
    out = capsys.readouterr()
    assert code == (1 if out.err else 0)
    return json.loads(out.out)


def points(path: Path, times: list[float], stamps: list[float]) -> Path:
    events = [(t_ns(log), "/p", Point(t_ns(stamp), np.zeros(3))) for log, stamp in zip(times, stamps, strict=True)]
    return write_bag(path, events)


def test_counts_rates_and_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = described(capsys, points(tmp_path / "bag", [k / 4 for k in range(41)], [k / 4 for k in range(41)]))
    assert (found["messages"], found["start_ns"], found["end_ns"]) == (41, START_NS, START_NS + 10_000_000_000)
    assert found["duration_s"] == pytest.approx(10.0)
    topic = found["topics"]["/p"]
    assert (topic["type"], topic["count"]) == ("geometry_msgs/msg/PointStamped", 41)
    assert topic["rate_hz"] == pytest.approx(4.0)
    assert (topic["gaps"], topic["stamps_back"], topic["clock_back"], topic["unset_stamps"]) == (0, 0, 0, 0)
    assert (found["damage"], found["not_read"]) == ([], {})
    assert [use["remap"] for use in found["estimators"]] == [["/p:=/mooring/<id>/offset"]]


def test_gaps_and_stamps_that_go_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = [*(0.1 * k for k in range(20)), *(10 + 0.1 * k for k in range(20)), *(12.5 + 0.1 * k for k in range(20))]
    stamps = [*times[:30], *(time - 5.5 for time in times[30:])]
    topic = described(capsys, points(tmp_path / "bag", times, stamps))["topics"]["/p"]
    assert (topic["gaps"], topic["stamps_back"]) == (2, 1)
    assert topic["longest_gap_s"] == pytest.approx(10 - 1.9)
    assert topic["largest_step_back_s"] == pytest.approx(5.4)


def test_a_recorders_clock_that_was_set_back_is_seen_although_messages_are_sorted(tmp_path: Path) -> None:
    form = codec(Point)
    data = serialize(form.encode(BagMake(), Point(1, np.zeros(3))), form.msgtype)
    given = [("/a", START_NS + k % 50 * 1_000_000_000, data) for k in range(100)]
    topic = survey(Bag(write_mcap(tmp_path / "x.mcap", given))).topics["/a"]
    assert (topic.clock_back, topic.largest_step_back_s) == (1, pytest.approx(49.0))


def test_a_message_without_a_stamp_is_counted(tmp_path: Path) -> None:
    form = codec(Point)
    data = serialize(form.encode(BagMake(), Point(0, np.zeros(3))), form.msgtype)
    assert survey(Bag(write_mcap(tmp_path / "x.mcap", [("/a", 5, data)] * 3))).topics["/a"].unset_stamps == 3


def test_headers_of_unknown_types_are_found_by_the_bags_own_definition(tmp_path: Path) -> None:
    form = codec(Point)
    data = [serialize(form.encode(BagMake(), Point(9 - k, np.zeros(3))), form.msgtype) for k in range(3)]
    given = [("/a", k, one) for k, one in enumerate(data)]
    for text, back in (("# about\nstd_msgs/Header header\nfloat64 x", 2), ("float64 x", 0)):
        path = write_mcap(tmp_path / f"{back}.mcap", given, msgtype="other_msgs/msg/X", text=text)
        assert survey(Bag(path)).topics["/a"].stamps_back == back


def test_damage_is_told_and_the_exit_code_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = points(tmp_path / "bag", [k / 4 for k in range(41)], [k / 4 for k in range(41)])
    file = path / "bag_0.mcap"
    file.write_bytes(file.read_bytes()[:-100])
    found = described(capsys, path)
    assert found["messages"] == 41
    assert len(found["damage"]) == 1
    assert str(file) in found["damage"][0]


@pytest.mark.parametrize("name", ["no summary", "split", "sqlite3, zstd file"])
def test_foreign_bags_are_described(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = VARIANTS[name](tmp_path)
    assert {topic: one["count"] for topic, one in described(capsys, path)["topics"].items()} == {"/a": 342, "/b": 58}
    assert main(["info", str(path)]) == 0
    assert "/b" in capsys.readouterr().out


def test_stored_metadata_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("{duration: 2.0, seed: 5, moorings: [{id: m}]}")
    assert main(["simulate", str(scenario), "-o", str(tmp_path / "bag")]) == 0
    capsys.readouterr()
    assert described(capsys, tmp_path / "bag")["metadata"]["uw_acoustic_loc"]["seed"] == "5"


def ready(path: Path) -> dict[tuple[str, str], bool]:
    return {(use.estimator, use.namespace): use.ready for use in uses(survey(Bag(path)))}


def test_estimators_that_find_their_inputs(tmp_path: Path) -> None:
    assert ready(write_bag(tmp_path / "bag", everything())) == {
        ("bearing", "/auv1"): False,
        ("bearing_localizer", "/auv1"): True,
        ("bearing_slam", "/auv1"): False,
        ("multistatic_fusion", "/"): False,
        ("mooring_tracker", "/"): True,
    }


def test_what_one_estimator_makes_another_can_use(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    vehicle = "vehicle: {waypoints: [{x: 0, y: 0}, {x: 9, y: 0}]}, hydrophones: {}"
    pinger = "{id: a, x: 5.0, y: 5.0, z: -5.0, band_low: 18000.0, band_high: 24000.0}"
    scenario.write_text(f"{{duration: 1.0, {vehicle}, pingers: [{pinger}]}}")
    assert main(["simulate", str(scenario), "-o", str(tmp_path / "bag")]) == 0
    found = {use.estimator: use for use in uses(survey(Bag(tmp_path / "bag")))}
    assert found["bearing_localizer"].after == {"sources/<id>/bearing": "bearing"}
    assert found["bearing_slam"].ready


def test_other_names_are_offered_as_a_remapping(tmp_path: Path) -> None:
    events = [(log, topic.replace("/odometry", "/nav/dead_reckoned"), value) for log, topic, value in dead_reckoning()]
    bearing = Bearing(START_NS, 0.5, 0.01, np.zeros(3))
    (use,) = (
        use
        for use in uses(
            survey(Bag(write_bag(tmp_path / "bag", [*events, (START_NS, "/auv1/sources/a/bearing", bearing)])))
        )
        if use.estimator == "bearing_localizer"
    )
    assert (use.missing, use.remap) == (["odometry"], ["/auv1/nav/dead_reckoned:=/auv1/odometry"])


def test_a_topic_of_the_right_name_but_another_frame_or_type_is_no_input(tmp_path: Path) -> None:
    still = np.zeros(3)
    events = [
        (START_NS, "/imu/data", Imu(START_NS, still, still, frame_id="imu_link")),
        (START_NS, "/dvl/twist", Odometry(START_NS, still, np.array([0.0, 0.0, 0.0, 1.0]), still, still)),
        (START_NS, "/dvl/other", BodyVelocity(START_NS, still)),
    ]
    (slam,) = (use for use in uses(survey(Bag(write_bag(tmp_path / "bag", events)))) if use.estimator == "bearing_slam")
    assert slam.unusable == {
        "/imu/data": "header.frame_id must be 'base_link', got 'imu_link'",
        "/dvl/twist": "type must be geometry_msgs/msg/TwistWithCovarianceStamped, got nav_msgs/msg/Odometry",
    }
    assert "/dvl/other:=/dvl/twist" in slam.remap
