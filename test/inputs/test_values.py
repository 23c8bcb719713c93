"""What a value says of itself: covariances element by element, numbers in place of a measurement, units."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from uw_acoustic_loc.bag.rosbags_messages import STORE, BagMake, decode, deserialize, encode, serialize
from uw_acoustic_loc.core.geometry import quat_from_yaw
from uw_acoustic_loc.core.types import NO_INFORMATION, Bearing, BodyVelocity, Imu, Odometry, unknown
from uw_acoustic_loc.stages.inputs.plausibility import Plausibility
from uw_acoustic_loc.wire.codec import codec

SECOND = 1_000_000_000
LEVEL = np.array([0.0, 0.0, 9.81])


def odometry(cov: np.ndarray) -> Odometry:
    zero = np.zeros(3)
    return Odometry(SECOND, zero, quat_from_yaw(0.3), zero, zero, cov, np.eye(6))


def read_back(cov: np.ndarray) -> np.ndarray:
    """By both ways of reading a message, which must agree."""
    data = encode(odometry(cov))
    read = decode(Odometry, data, 0).pose_cov
    msg = deserialize(data, "nav_msgs/msg/Odometry")
    np.testing.assert_array_equal(codec(Odometry).decode(msg, 0).pose_cov, read)
    return read


def test_a_known_covariance_stays_as_it_is() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(size=(6, 6))
    np.testing.assert_array_equal(read_back(a @ a.T), a @ a.T)


def test_minus_one_first_makes_all_of_it_unknown() -> None:
    cov = np.diag([-1.0, 0.04, 0.04, 0.1, 0.1, 0.01])
    np.testing.assert_array_equal(read_back(cov), unknown(6))


def test_zero_stays_zero_and_is_noted_once() -> None:
    looked = Plausibility("odometry")
    for _ in range(3):
        looked.check(odometry(read_back(np.zeros((6, 6)))))
    assert looked.notes == {
        "pose.covariance": "pose.covariance is all zero: taken as unknown, the parameters' noise is used"
    }


@pytest.mark.parametrize("bad", [math.nan, -3.0])
def test_one_unknown_variance_is_unknown_by_itself(bad: float) -> None:
    cov = np.full((6, 6), 0.01) + np.eye(6)
    cov[3, 3] = bad
    read = read_back(cov)
    assert read[3, 3] == -1.0 and not read[3, [0, 1, 2, 4, 5]].any() and not read[[0, 1, 2, 4, 5], 3].any()
    rest = np.ix_([0, 1, 2, 4, 5], [0, 1, 2, 4, 5])
    np.testing.assert_array_equal(read[rest], cov[rest])


@pytest.mark.parametrize("huge", [1e13, 1.7e308, math.inf])
def test_a_huge_variance_says_nothing_and_stays_a_number(huge: float) -> None:
    cov = np.eye(6)
    cov[0, 0], cov[0, 1], cov[1, 0] = huge, 0.5, 0.5
    read = read_back(cov)
    assert read[0, 0] == NO_INFORMATION and read[0, 1] == 0.0 and read[1, 1] == 1.0


def test_nan_off_the_diagonal_leaves_the_variances() -> None:
    cov = np.eye(6)
    cov[0, 5] = math.nan
    np.testing.assert_array_equal(read_back(cov), np.eye(6))


@pytest.mark.parametrize("variance", [-1.0, 0.0, math.nan])
def test_a_bearing_without_a_variance_is_one_of_unknown_variance(variance: float) -> None:
    read = decode(Bearing, encode(Bearing(SECOND, 0.5, variance, np.zeros(3))), 0)
    assert read.variance == -1.0 and read.bearing == pytest.approx(0.5)


@pytest.mark.parametrize("value", [Imu(SECOND, LEVEL, LEVEL), BodyVelocity(SECOND, LEVEL), odometry(unknown(6))])
def test_nanoseconds_of_a_second_or_more_are_malformed(value: object) -> None:
    form = codec(type(value))
    msg = form.encode(BagMake(), value)
    time = STORE.types["builtin_interfaces/msg/Time"]
    object.__setattr__(msg.header, "stamp", time(sec=5, nanosec=4_000_000_000))
    with pytest.raises(ValueError, match=r"nanosec must be below 1000000000, got 4000000000"):
        form.decode(msg, 0)
    with pytest.raises(ValueError, match=r"nanosec must be below"):
        decode(type(value), serialize(msg, form.msgtype), 0)


def test_a_velocity_in_place_of_a_measurement_is_refused_by_name() -> None:
    looked = Plausibility("dvl/twist")
    with pytest.raises(ValueError, match=r"-32.768 m/s: no bottom lock, as PD0 \(Teledyne RDI\) and Nortek"):
        looked.check(BodyVelocity(SECOND, np.array([-32.768, -32.768, -32.768])))
    with pytest.raises(ValueError, match=r"-32.768 m/s: no bottom lock"):  # as float32 has it
        looked.check(BodyVelocity(SECOND, np.array([0.1, float(np.float32(-32.768)), 0.0])))
    with pytest.raises(ValueError, match=r"at most 30 m/s, got \[1200.0, 3.0, 0.0\]; is it in mm/s or cm/s"):
        looked.check(BodyVelocity(SECOND, np.array([1200.0, 3.0, 0.0])))
    looked.check(BodyVelocity(SECOND, np.array([1.2, 0.0, 0.0])))


def test_an_imu_that_does_not_measure_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="this driver does not measure it"):
        Plausibility("imu/data").check(Imu(SECOND, np.zeros(3), LEVEL, unknown(3), np.eye(3)))


# --- units and conventions -------------------------------------------------------------------------------------------


def imu_faults(rates: np.ndarray, force: np.ndarray, hertz: float = 50.0, seconds: float = 3.0) -> list[str]:
    looked, rng = Plausibility("imu/data"), np.random.default_rng(3)
    for k in range(int(seconds * hertz)):
        noisy = Imu(SECOND + round(k / hertz * 1e9), rates + rng.normal(0, 0.02, 3), force + rng.normal(0, 0.2, 3))
        looked.check(noisy)
    return looked.faults


TURN = np.array([0.02, -0.01, 0.3])


def test_a_healthy_imu_is_not_doubted() -> None:
    assert imu_faults(TURN, LEVEL) == []
    assert imu_faults(TURN, np.array([4.0, 1.0, 8.9])) == []  # pitched by 24 degrees


@pytest.mark.parametrize(
    ("rates", "force", "words"),
    [
        (TURN, LEVEL / 9.81, "so it is in g"),
        (TURN, np.array([0.2, 0.1, 0.0]), "as if gravity were removed"),
        (TURN, -LEVEL, "z points down: set inputs.imu/data.convention to ned"),
        (TURN, np.array([9.7, 0.3, 0.4]), "set inputs.imu/data.rotation"),
        (np.rad2deg(TURN), LEVEL, "so it is in deg/s"),
    ],
)
def test_units_and_axes_are_told_from_the_data_within_seconds(rates: np.ndarray, force: np.ndarray, words: str) -> None:
    faults = imu_faults(rates, force)
    assert any(words in fault for fault in faults), faults


@pytest.mark.parametrize(("factor", "words"), [(1.0, ""), (-1.0, "axes point down"), (57.3, "deg/s")])
def test_an_odometry_whose_twist_contradicts_its_pose_is_named(factor: float, words: str) -> None:
    looked = Plausibility("odometry")
    for k in range(80):
        t = 0.05 * k
        turning = replace(
            odometry(np.eye(6)),
            t_ns=SECOND + round(t * 1e9),
            quat_xyzw=quat_from_yaw(0.2 * t),
            angular=np.array([0.0, 0.0, 0.2 * factor]),
        )
        looked.check(turning)
    assert bool(looked.faults) == bool(words)
    assert words in "".join(looked.faults)
