import numpy as np
import pytest

from uw_acoustic_loc.core.toa.update import absorb


def case(seed: int, arrivals: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(7, 7))
    H, variances = rng.normal(size=(arrivals, 7)), rng.uniform(0.1, 2.0, arrivals)
    cov = root @ root.T
    innovations = np.linalg.cholesky(H @ cov @ H.T + np.diag(variances)) @ rng.normal(size=arrivals)
    return cov, innovations, H, variances


def one_by_one(
    cov: np.ndarray, innovations: np.ndarray, H: np.ndarray, variances: np.ndarray, gate: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Scalar updates, the most expected first."""
    P, change, used = cov.copy(), np.zeros(7), 0
    for i in np.argsort(innovations**2 / (((H @ cov) * H).sum(axis=1) + variances)):
        S = H[i] @ P @ H[i] + variances[i]
        innovation = innovations[i] - H[i] @ change
        if innovation**2 <= gate**2 * S:
            K = P @ H[i] / S
            change, P, used = change + K * innovation, P - np.outer(K, K) * S, used + 1
    return change, P, used


@pytest.mark.parametrize("arrivals", [0, 1, 4, 8])
@pytest.mark.parametrize("outliers", [0, 1, 3])
def test_it_is_one_arrival_after_the_other(arrivals: int, outliers: int) -> None:
    for seed in range(20):
        cov, innovations, H, variances = case(seed, arrivals)
        innovations[:outliers] += 100.0
        found = absorb(cov, innovations, H, np.diag(variances), 3.5)
        change, P, used = one_by_one(cov, innovations, H, variances, 3.5)
        assert found.used == used <= max(arrivals - outliers, 0)
        assert found.change == pytest.approx(change, abs=1e-9)
        assert found.cov == pytest.approx(P, abs=1e-9)
        assert np.array_equal(found.cov, found.cov.T)


def test_normalised_innovations_have_as_many_degrees_of_freedom_as_arrivals() -> None:
    cases = (case(seed, 8) for seed in range(500))
    nis = [absorb(cov, y, H, np.diag(variances), gate_sigma=50.0).nis for cov, y, H, variances in cases]
    assert np.mean(nis) == pytest.approx(8.0, abs=3 * np.sqrt(16 / 500))
