import numpy as np
import pytest

from uw_acoustic_loc.config import changed, configured
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.toa.model import arrival_times, predict
from uw_acoustic_loc.core.toa.paths import make_net
from uw_acoustic_loc.studies.toa.batch import ToaBatch

BUOYS = np.array([[0.0, 0, 0], [2000, 0, 0], [0, 2000, 0], [2000, 2000, 0]])
IMAGES = make_net([1, 2, 3, 4], BUOYS, 200.0).images[[1, 2]].reshape(-1, 3)
CONFIG = configured(ToaConfig, acceleration_noise=0.02, vertical_acceleration_noise=0.02, gate_sigma=50.0)
RUNS, STD = 5, 0.003


def starts() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    mean = np.array([500.0, 800, -60, 1.2, 1.0, 0.2, 1500])[:, None] + rng.normal(size=(7, RUNS))
    cov = np.diag([100.0, 100, 100, 0.1, 0.1, 0.01, 4])
    return mean, np.repeat(cov[..., None], RUNS, axis=2)


def test_every_run_is_the_textbooks_filter() -> None:
    """Joint gain and update of eq. 8-10 for all arrivals of a ping."""
    rng, (mean, cov) = np.random.default_rng(4), starts()
    batch = ToaBatch(mean, cov, CONFIG)
    x, P = list(mean.T), list(np.moveaxis(cov, 2, 0))
    for k in range(20):
        if k:
            batch.predict(1.5)
        times = rng.normal(arrival_times(mean[:, 0], IMAGES)[0][:, None], STD, (8, RUNS))
        batch.update(IMAGES, times, STD)
        for run in range(RUNS):
            if k:
                x[run], P[run] = predict(x[run], P[run], 1.5, CONFIG)
            expected, H = arrival_times(x[run], IMAGES)
            K = np.linalg.solve(H @ P[run] @ H.T + STD**2 * np.eye(8), H @ P[run]).T
            x[run] = x[run] + K @ (times[:, run] - expected)
            P[run] = P[run] - K @ H @ P[run]
    assert pytest.approx(np.array(x), abs=1e-8) == batch.mean.T
    assert np.moveaxis(batch.cov, 2, 0) == pytest.approx(np.array(P), abs=1e-9)


def test_covariances_stay_symmetric() -> None:
    rng, (mean, cov) = np.random.default_rng(5), starts()
    batch = ToaBatch(mean, cov, CONFIG)
    times = arrival_times(mean[:, 0], IMAGES)[0][:, None]
    for _ in range(200):
        batch.predict(1.0)
        batch.update(IMAGES, times + rng.normal(0, STD, (8, RUNS)), STD)
    assert np.abs(batch.cov - batch.cov.swapaxes(0, 1)).max() < 1e-10
    assert np.linalg.eigvalsh(np.moveaxis(batch.cov, 2, 0)).min() > 0


def test_missing_and_gated_arrivals_change_nothing() -> None:
    mean, cov = starts()
    batch = ToaBatch(mean, cov, changed(CONFIG, gate_sigma=3.0))
    times = arrival_times(mean[:, 0], IMAGES)[0][:, None] + np.zeros(RUNS)
    times[:] = np.nan
    times[0] = 9.0
    batch.update(IMAGES, times, STD)
    assert np.array_equal(batch.mean, mean)
    assert np.array_equal(batch.cov, cov)


def test_shapes_that_do_not_belong_together_are_refused() -> None:
    mean, cov = starts()
    with pytest.raises(ValueError, match=r"must be \(7, M\) and \(7, 7, M\), got \(7, 5\) and \(7, 7\)"):
        ToaBatch(mean, cov[..., 0], CONFIG)
