import numpy as np
import pytest

from uw_acoustic_loc.config import configured
from uw_acoustic_loc.core.toa.bound import PingNoise, ping_bound, track_bound
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.toa.model import arrival_times, by_emission, motion, predict
from uw_acoustic_loc.core.toa.paths import make_net

BUOYS = np.array([[0.0, 0, 0], [2000, 0, 0], [0, 2000, 0], [2000, 2000, 0]])
IMAGES = make_net([1, 2, 3, 4], BUOYS, 200.0).images[[1, 2]].reshape(-1, 3)
TARGETS = np.array([[500.0, 800, -60], [1000, 1000, -10]])


@pytest.mark.parametrize("emission", [0.0, 0.5])
def test_bound_is_the_inverse_information_of_the_trackers_own_model(emission: float) -> None:
    found = ping_bound(TARGETS, IMAGES, 1500.0, PingNoise(0.003, 2.0, emission))
    for target, variances in zip(TARGETS, found, strict=True):
        H = arrival_times(np.array([*target, 0, 0, 0, 1500.0]), IMAGES)[1][:, [0, 1, 2, 6]]
        H = np.column_stack([H, np.ones(len(H))])
        R = 0.003**2 * np.eye(len(H)) + 4 * np.outer(H[:, 3], H[:, 3]) + emission**2 * np.outer(H[:, 4], H[:, 4])
        assert variances == pytest.approx(np.diag(np.linalg.inv(H[:, :3].T @ np.linalg.solve(R, H[:, :3]))), rel=1e-4)


def test_at_the_depth_of_all_receivers_only_the_depth_is_open() -> None:
    surface = np.array([[500.0, 800, 0]])
    variances = ping_bound(surface, IMAGES[:4], 1500.0, PingNoise(0.003, 2.0, 0.0))[0]
    assert variances[2] == np.inf
    assert np.all(np.sqrt(variances[:2]) < 10)


def test_one_receiver_leaves_at_least_two_axes_open() -> None:
    variances = ping_bound(TARGETS, IMAGES[:1], 1500.0, PingNoise(0.003, 2.0, 0.0))
    assert np.all(np.isinf(variances).sum(axis=1) >= 2)


@pytest.mark.parametrize("emission", [0.0, 1.0])
def test_bound_of_a_track_is_the_covariance_of_the_filter_along_it(emission: float) -> None:
    config = configured(ToaConfig, acceleration_noise=0.05, vertical_acceleration_noise=0.02)
    prior, F = np.diag([100.0, 100, 100, 1, 1, 0.1, 4]), motion(2.0)
    track = [np.array([500.0, 800, -60, 1.2, 1.0, 0.2, 1500])]
    for _ in range(9):
        track.append(F @ track[-1])
    found = track_bound(np.array([track, track]), IMAGES, prior, PingNoise(0.003, 0.0, emission), config, 2.0)
    P = prior
    for k, state in enumerate(track):
        if k:
            P = predict(state, P, 2.0, config)[1]
        H = arrival_times(state, IMAGES)[1]
        late = by_emission(state, H)
        S = H @ P @ H.T + emission**2 * np.outer(late, late) + 0.003**2 * np.eye(8)
        P = P - P @ H.T @ np.linalg.solve(S, H @ P)
        assert found[k] == pytest.approx(P, rel=1e-5, abs=1e-8)
