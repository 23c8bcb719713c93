import dataclasses

import numpy as np
import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.core.multistatic.fusion import MultistaticConfig
from uw_acoustic_loc.core.types import Detections, NodePositions
from uw_acoustic_loc.stages.multistatic_fusion import MultistaticFusionStage


def nodes(ids=(0, 1, 2, 3), role=(1, 0, 0, 0), x=(0.0, 2000.0, -1000.0, -1000.0), y=(0.0, 0.0, 1732.0, -1732.0)):
    return NodePositions(1, np.array(ids), np.array(role), np.array(x), np.array(y), np.full(len(ids), -10.0))


def ping(t_ns=10**9, **changed):
    """Echoes of a target at (2600, 1400) at receivers 1 to 3, the bias included."""
    columns = {
        "receiver": [1, 2, 3],
        "range": [4552.7, 6645.1, 7804.0],
        "range_std": [40.0] * 3,
        "bearing": [1.1659, -0.0919, 0.7160],
        "bearing_std": [0.02] * 3,
        "snr": [15.0] * 3,
    }
    return Detections(t_ns, **{name: np.array(changed.get(name, column)) for name, column in columns.items()})


EMPTY = {name: [] for name in ("receiver", "range", "range_std", "bearing", "bearing_std", "snr")}


def started(config=MultistaticConfig()):  # noqa: B008  frozen
    stage = MultistaticFusionStage(config)
    positions, detections = (i.handle for i in stage.inputs)
    list(positions(nodes()))
    return stage, detections


def test_unusable_rows_are_counted_by_name_and_the_rest_is_used():
    stage, handle = started()
    (_, clean), _ = handle(ping())
    np.testing.assert_allclose(clean.position, [2600, 1400, -10], atol=2)
    bad = ping(
        t_ns=2 * 10**9,
        receiver=[1, 2, 3, 9, 1, 2, 3, 1, 1],
        range=[4552.7, 6645.1, 7804.0, 5000.0, np.nan, -3.0, 5000.0, 5000.0, 5000.0],
        range_std=[40.0] * 6 + [np.inf, 40.0, 40.0],
        bearing=[1.1659, -0.0919, 0.7160, 0.0, 0.0, 0.0, 0.0, np.nan, 0.0],
        bearing_std=[0.02] * 8 + [0.0],
        snr=[15.0] * 9,
    )
    (_, fix), _ = handle(bad)
    np.testing.assert_array_equal(fix.position, clean.position)
    status = stage.status()
    rejected = {name: count for name, count in status.values.items() if name.startswith("rejected")}
    assert rejected == {
        "rejected_unknown_receiver": 1, "rejected_range": 2, "rejected_range_std": 1,
        "rejected_bearing": 1, "rejected_bearing_std": 1,
    }  # fmt: skip
    assert status.level == Status.WARN
    assert "1 by unknown_receiver, 2 by range, 1 by range_std" in status.message
    list(handle(ping(t_ns=3 * 10**9)))
    assert stage.status().level == Status.OK
    assert stage.status().values["detections"] == 9


def test_a_ping_without_rows_is_a_missed_ping():
    _, handle = started()
    for k in range(1, 4):
        list(handle(ping(k * 10**9)))
    ((topic, tracks),) = handle(ping(4 * 10**9, **EMPTY))
    assert topic == "sonar/tracks"
    assert tracks.id.tolist() == [1]
    ((_, tracks),) = handle(ping(60 * 10**9, **EMPTY))
    assert tracks.id.size == tracks.x.size == tracks.position_std.size == 0
    assert tracks.id.dtype == np.uint16


def test_the_net_may_come_from_the_parameters():
    config = MultistaticConfig(
        transmitter_position=(0.0, 0.0, -10.0), receiver_ids=(1, 2, 3),
        receiver_positions=(2000.0, 0.0, -10.0, -1000.0, 1732.0, -10.0, -1000.0, -1732.0, -10.0),
    )  # fmt: skip
    ((topic, handle),) = ((i.topic, i.handle) for i in MultistaticFusionStage(config).inputs)
    assert topic == "sonar/detections"
    _, by_topic = started()
    np.testing.assert_array_equal(next(iter(handle(ping())))[1].position, next(iter(by_topic(ping())))[1].position)
    with pytest.raises(ValueError, match="3 numbers for each of the 1 receiver_ids, got 2"):
        build(MultistaticConfig, {"receiver_ids": [1], "receiver_positions": [0.0, 1.0]}, "node")


def test_tracks_outlive_a_receiver_that_dies_and_one_that_is_added():
    stage, handle = started()
    for k in range(1, 5):
        list(handle(ping(k * 10**9)))
    two = {"receiver": [1, 2], "range": [4552.7, 6645.1], "bearing": [1.1659, -0.0919], "snr": [15.0] * 2}
    two |= {"range_std": [40.0] * 2, "bearing_std": [0.02] * 2}
    (_, fix), (_, tracks) = handle(ping(5 * 10**9, **two))
    assert tracks.id.tolist() == [1]
    positions = next(i.handle for i in stage.inputs if i.topic == "sonar/positions")
    list(
        positions(
            nodes(ids=(0, 1, 2, 3, 4), role=(1, 0, 0, 0, 0), x=(0, 2e3, -1e3, -1e3, 4e3), y=(0, 0, 1732, -1732, 3e3))
        )
    )
    four = {"receiver": [1, 2, 3, 4], "range": [4552.7, 6645.1, 7804.0, 5155.8], "range_std": [40.0] * 4}
    four |= {"bearing": [1.1659, -0.0919, 0.7160, -2.2926], "bearing_std": [0.02] * 4, "snr": [15.0] * 4}
    (_, better), (_, tracks) = handle(ping(6 * 10**9, **four))
    assert tracks.id.tolist() == [1]
    assert np.trace(better.cov[:2, :2]) < np.trace(fix.cov[:2, :2])
    np.testing.assert_allclose(better.position[:2], [2600, 1400], atol=5)


def test_a_track_lives_on_the_detections_of_one_receiver():
    _, handle = started()
    for k in range(1, 5):
        list(handle(ping(k * 10**9)))
    one = {"receiver": [2], "range": [6645.1], "range_std": [40.0], "bearing": [-0.0919], "bearing_std": [0.02]}
    for k in range(5, 100):
        ((topic, tracks),) = handle(ping(k * 10**9, **one, snr=[15.0]))  # no fix: two receivers make one
        assert topic == "sonar/tracks"
    assert tracks.id.tolist() == [1]
    assert np.hypot(tracks.x[0] - 2600, tracks.y[0] - 1400) < tracks.position_std[0]


def test_changeable_parameters_change():
    config = MultistaticConfig()
    stage, handle = started(config)
    for k in range(1, 5):
        list(handle(ping(k * 10**9)))
    stage.change(dataclasses.replace(config, coast_time=0.5, gate=5.0))
    ((_, tracks),) = handle(ping(6 * 10**9, **EMPTY))
    assert tracks.id.size == 0


def test_error_sentences():
    stage = MultistaticFusionStage(MultistaticConfig())
    positions, detections = (i.handle for i in stage.inputs)
    with pytest.raises(ValueError, match="detections came before sonar/positions"):
        list(detections(ping()))
    with pytest.raises(ValueError, match="must have one transmitter, got 0"):
        list(positions(nodes(role=(0, 0, 0, 0))))
    with pytest.raises(ValueError, match=r"receivers with different ids, got \[1, 1, 3\]"):
        list(positions(nodes(ids=(0, 1, 1, 3))))
    with pytest.raises(ValueError, match="sonar/positions must be finite"):
        list(positions(nodes(x=(0.0, np.nan, 1.0, 2.0))))
    list(positions(nodes()))
    list(detections(ping()))
    with pytest.raises(ValueError, match="t_ns must be after the ping before"):
        list(detections(ping()))
