import numpy as np
import pytest

from uw_acoustic_loc.core.toa.paths import Epoch, ReceiverNet, associate, associate_by_order, make_net, screen
from uw_acoustic_loc.core.types import Array, Arrivals

POSITIONS = np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, -5.0]])
TARGET = np.array([300.0, 100.0, -60.0])
D, B, S = Arrivals.DIRECT, Arrivals.BOTTOM, Arrivals.SURFACE


def net(bottom_depth: float = 200.0) -> ReceiverNet:
    return make_net([7, 9], POSITIONS, bottom_depth)


def rows(receiver: list[int], path: list[int], time: list[float], std: list[float] | None = None) -> Arrivals:
    stds = np.array(std or [1e-3] * len(time), np.float32)
    return Arrivals(
        1, np.array(receiver, np.uint16), np.array(path, np.uint8), np.array(time), stds, np.zeros(len(time))
    )


def flown(image: Array) -> float:
    return float(np.linalg.norm(TARGET - image) / 1500.0)


def test_a_path_by_the_image_is_as_long_as_the_reflected_one() -> None:
    for path, mirror_z in ((B, -200.0), (S, 0.0)):
        image = net().images[path, 1]
        share = (mirror_z - TARGET[2]) / (image[2] - TARGET[2])
        bounce = TARGET + share * (image - TARGET)  # where the straight line meets the mirror
        assert bounce[2] == pytest.approx(mirror_z)
        legs = np.linalg.norm(TARGET - bounce) + np.linalg.norm(bounce - POSITIONS[1])
        assert np.linalg.norm(TARGET - image) == pytest.approx(legs, rel=1e-12)


def test_paths_that_do_not_exist_have_no_image() -> None:
    assert np.isnan(net(0.0).images[B]).all()
    assert np.isnan(net().images[S, 0]).all()  # of a buoy at the surface
    assert np.isnan(net().images[Arrivals.UNKNOWN]).all()


def test_bad_rows_are_counted_by_reason_and_the_others_kept() -> None:
    arrivals = rows(
        [7, 7, 9, 8, 9, 7, 9, 7],
        [D, B, D, D, B, S, 9, D],
        [0.2, np.nan, -0.1, 0.3, 0.4, 0.5, 0.6, 0.7],
        [1e-3, 1e-3, 1e-3, 1e-3, 0.0, 1e-3, 1e-3, np.nan],
    )
    epoch, refused = screen(arrivals, net())
    assert epoch.time.tolist() == [0.2]
    assert refused == {
        "not_finite": 1,
        "negative_time": 1,
        "unknown_receiver": 1,
        "no_information": 2,  # neither the rows nor the caller say how well these times are known
        "path_not_modelled": 2,
    }
    given, refused = screen(arrivals, net(), std=0.02)
    assert given.std == pytest.approx([1e-3, 0.02, 0.02])
    assert refused["std_not_given"] == 2


def test_without_a_prediction_the_earliest_is_direct() -> None:
    epoch, _ = screen(rows([9, 7, 7, 9, 9], [0, 0, 0, B, 0], [0.9, 0.8, 0.2, 0.5, 0.4]), net())
    found = associate_by_order(epoch)
    assert sorted(zip(found.receiver.tolist(), found.path.tolist(), found.time.tolist(), strict=True)) == [
        (0, D, 0.2),
        (0, B, 0.8),
        (1, D, 0.4),
        (1, B, 0.5),
        (1, S, 0.9),
    ]


def predictor(images: Array, _: object) -> tuple[Array, Array]:
    times = np.array([flown(image) for image in images])
    return times, np.full((len(times), len(times)), 1e-4)  # 10 ms, the same for every path


def test_joint_assignment_finds_shifted_paths_and_leaves_the_rest() -> None:
    direct, bottom = flown(net().images[D, 0]), flown(net().images[B, 0])
    shift = 0.02  # common to both paths, as a wrong position is
    times = [direct + shift, bottom + shift, bottom + 0.4, direct - 0.1]
    epoch, _ = screen(rows([7] * 4, [0] * 4, times), net())
    found, *_ = associate(epoch, predictor, 3.0)
    assert dict(zip(found.path.tolist(), found.time.tolist(), strict=True)) == {D: times[0], B: times[1]}


def test_of_a_label_given_twice_the_expected_one_is_taken() -> None:
    direct = flown(net().images[D, 0])
    epoch, _ = screen(rows([7, 7], [D, D], [direct + 0.02, direct]), net())
    found, *_ = associate(epoch, predictor, 3.0)
    assert (found.path.tolist(), found.time.tolist()) == ([D], [direct])


def test_a_missing_direct_arrival_does_not_rename_the_bottom_one() -> None:
    epoch, _ = screen(rows([7], [0], [flown(net().images[B, 0])]), net())
    assert associate(epoch, predictor, 3.0)[0].path.tolist() == [B]
    assert associate_by_order(epoch).path.tolist() == [D]


@pytest.mark.parametrize(
    ("ids", "positions", "sentence"),
    [
        ([1, 1], POSITIONS, r"distinct ids and be at least one, got \[1, 1\]"),
        ([], np.zeros((0, 3)), r"at least one, got \[\]"),
        ([1, 2], POSITIONS * np.nan, r"positions must be \(2, 3\) finite numbers"),
    ],
)
def test_a_net_that_cannot_be_is_refused(ids: list[int], positions: Array, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make_net(ids, positions, 0.0)


def test_epoch_rows_keeps_columns_together() -> None:
    epoch = Epoch(1, net(), np.array([0, 1]), np.array([D, B]), np.array([0.1, 0.2]), np.array([1.0, 2.0]), np.zeros(2))
    kept = epoch.rows(np.array([1]))
    assert (kept.receiver.tolist(), kept.path.tolist(), kept.time.tolist(), kept.std.tolist()) == ([1], [B], [0.2], [2])


def test_probabilities_of_paths_are_how_often_they_are_right() -> None:
    """Two arrivals 1.5 standard deviations apart, in either order: in each class the share of the direct ones."""
    rng, net = np.random.default_rng(5), make_net([9], np.array([[0.0, 0.0, 0.0]]), 50.0)
    expected, spread = np.array([0.1, 0.1015]), np.full(2, 1e-3)
    told, true = [], []
    for _ in range(2000):
        direct = int(rng.integers(2))
        time = rng.normal(expected, spread)[[direct, 1 - direct]]
        epoch = Epoch(1, net, np.zeros(2, int), np.zeros(2, int), time, spread, np.zeros(2))
        _, found, _ = associate(epoch, lambda *_: (expected.copy(), np.zeros((2, 2))), 8.0)  # no path is missed
        assert found.receiver.tolist() == [9, 9]
        assert found.direct + found.bottom == pytest.approx(np.ones(2), abs=1e-6)
        told.append(found.direct[0])
        true.append(direct == 0)
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 0.6), (0.6, 0.9), (0.9, 1.0)):
        here = (np.array(told) >= low) & (np.array(told) <= high)
        assert np.mean(np.array(true)[here]) == pytest.approx(
            np.mean(np.array(told)[here]), abs=4 * np.sqrt(0.25 / here.sum())
        )
