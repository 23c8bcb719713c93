import numpy as np
import pytest

from uw_acoustic_loc.config import build, configured
from uw_acoustic_loc.core.toa.config import ToaConfig, Water
from uw_acoustic_loc.core.toa.model import STATES, arrival_times, by_emission, predict, process_noise

STATE = np.array([500.0, 800.0, -60.0, 1.2, 1.0, -0.2, 1498.0])
IMAGES = np.array([[0.0, 0, 0], [2000, 0, -400], [0, 2000, 5], [480, 830, -100]])


def test_jacobian_is_the_finite_difference_of_the_times() -> None:
    bias, lag = np.array([0.1, -0.2, 0.0, 3.0]), np.array([-1.9, -0.2, 0.0, 3.0])
    _, jacobian = arrival_times(STATE, IMAGES, bias, lag)
    for k in range(STATES):
        h = 1e-3
        step = h * np.eye(STATES)[k]
        difference = (
            arrival_times(STATE + step, IMAGES, bias, lag)[0] - arrival_times(STATE - step, IMAGES, bias, lag)[0]
        ) / (2 * h)
        assert jacobian[:, k] == pytest.approx(difference, rel=1e-6, abs=1e-9)
    late, early = (arrival_times(STATE, IMAGES, bias + e, lag + e)[0] for e in (1e-4, -1e-4))
    assert by_emission(STATE, jacobian) == pytest.approx((late - early) / 2e-4, rel=1e-8)


def test_times_grow_with_distance_and_shrink_with_sound_speed() -> None:
    times, jacobian = arrival_times(STATE, IMAGES)
    assert times == pytest.approx(np.linalg.norm(STATE[:3] - IMAGES, axis=1) / 1498.0, rel=1e-14)
    assert jacobian[0, 0] > 0 > jacobian[1, 0]  # eastwards: away from the western buoy, towards the eastern one
    assert np.all(jacobian[:, 6] < 0)


def test_two_predictions_are_one_over_both_intervals() -> None:
    config = configured(ToaConfig, acceleration_noise=0.3, vertical_acceleration_noise=0.1)
    cov = np.diag([4.0, 5.0, 6.0, 0.1, 0.2, 0.3, 1.0])
    once = predict(STATE, cov, 5.0, config)
    twice = predict(*predict(STATE, cov, 2.0, config), 3.0, config)
    assert twice[0] == pytest.approx(once[0], rel=1e-12)
    assert twice[1] == pytest.approx(once[1], rel=1e-12, abs=1e-12)
    assert process_noise(1.0, config.process)[5, 5] == pytest.approx(0.01)


def test_the_water_bounds_what_is_unknown_of_the_depth() -> None:
    config = configured(ToaConfig, max_depth=40.0, bottom_depth=60.0)
    mean, cov = predict(STATE, np.diag([4.0, 5.0, 30.0**2, 0.1, 0.2, 0.3, 1.0]), 1.0, config)
    assert cov[2, 2] == pytest.approx(20.0**2)
    assert np.linalg.eigvalsh(cov).min() > 0
    assert STATE[2] < mean[2] < -20
    narrow = predict(STATE, np.diag([4.0, 5.0, 19.0**2, 0.1, 0.2, 0.3, 1.0]), 1.0, config)
    assert narrow[0][2] == pytest.approx(STATE[2] + STATE[5])


def test_a_step_back_widens_the_covariance_too() -> None:
    cov = np.diag([4.0, 5.0, 6.0, 0.1, 0.2, 0.3, 1.0])
    mean, back = predict(STATE, cov, -5.0, ToaConfig())
    assert mean[:3] == pytest.approx(STATE[:3] - 5 * STATE[3:6])
    still = configured(ToaConfig, acceleration_noise=0.0, vertical_acceleration_noise=0.0, sound_speed_walk=0.0)
    assert np.linalg.eigvalsh(back - predict(STATE, cov, -5.0, still)[1]).min() > 0


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"receiver_ids": [1, 2], "receiver_positions": [0.0, 0.0, 0.0]}, "3 numbers for each of the 2 receiver_ids"),
        ({"receiver_ids": [1, 1], "receiver_positions": [0.0] * 6}, r"must differ from each other, got \[1, 1\]"),
        ({"initial_position": []}, "initial_position must have 3 elements, got 0"),
        ({"emission": "maybe"}, "emission must be one of known, unknown, got 'maybe'"),
        ({"bottom_depth": -1.0}, "bottom_depth must be at least 0 m, got -1.0"),
    ],
)
def test_config_says_what_is_wrong(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        build(ToaConfig, values, "toa_tracker")


def test_the_sound_speed_may_come_from_temperature_and_salinity() -> None:
    assert Water(sound_speed=0.0, temperature=25.0, depth=1000.0).start_sound_speed == pytest.approx(1550.744)
    assert Water(sound_speed=1480.0).start_sound_speed == 1480.0
    with pytest.raises(ValueError, match="sound_speed must be 0 or at least 1350 m/s, got 343"):
        Water(sound_speed=343.0)
