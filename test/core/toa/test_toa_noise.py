"""The buoy tracker under alpha-stable impulses: five buoys around a target that circles, 1 ms, 60 pings."""

import numpy as np
import pytest

from uw_acoustic_loc.config import changed, configured
from uw_acoustic_loc.core.impulsive import AlphaStable, ImpulsiveNoise
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.toa.paths import make_net
from uw_acoustic_loc.core.toa.tracker import ToaTracker
from uw_acoustic_loc.core.types import Array, Arrivals

RUNS, PINGS, SETTLED, STD = 25, 60, 10, 1e-3
ANGLES = 2 * np.pi / 5 * np.arange(5)
BUOYS = np.stack([100 * np.cos(ANGLES), 100 * np.sin(ANGLES), np.zeros(5)], axis=1)
NET = make_net(range(5), BUOYS, 0.0)
GAUSSIAN = configured(
    ToaConfig,
    cold_start=False,
    start_epochs=1,
    initial_position=(60.0, 0.0, -15.0),
    initial_position_std=(2.0, 2.0, 2.0),
    initial_velocity=(0.0, 1.5, 0.0),
)


def mixture(fraction: float, scale: float) -> ToaConfig:
    return changed(
        GAUSSIAN, noise="mixture", impulse_fraction=fraction, impulse_scale=scale, impulse_location=-0.3 * scale
    )


def course(k: int) -> Array:
    turn = 1.5 / 60.0 * k
    return np.array([60 * np.cos(turn), 60 * np.sin(turn), -15.0])


def ping(k: int, rng: np.random.Generator, noise: ImpulsiveNoise, position: Array) -> Arrivals:
    time = np.linalg.norm(position - BUOYS, axis=1) / 1500.0 + noise.draw(rng, 5)
    return Arrivals((k + 1) * 10**9, np.arange(5), np.ones(5, int), time, np.full(5, STD), np.zeros(5))


def errors(config: ToaConfig, fraction: float, scale: float) -> tuple[float, float]:
    """RMSE in m and NEES over 3 of the settled pings."""
    noise = ImpulsiveNoise(STD, fraction, AlphaStable(1.8, 1.0, scale, -0.3 * scale))
    squares, nees = [], []
    for run in range(RUNS):
        rng, tracker = np.random.default_rng([90, run]), ToaTracker(config, NET)
        for k in range(PINGS):
            estimate = tracker.update(ping(k, rng, noise, course(k)))
            if estimate and k >= SETTLED:
                off = estimate.mean[:3] - course(k)
                squares.append(off @ off)
                nees.append(off @ np.linalg.solve(estimate.cov[:3, :3], off) / 3)
    return float(np.sqrt(np.mean(squares))), float(np.mean(nees))


def test_without_impulses_the_mixture_is_the_gaussian_filter() -> None:
    assert errors(mixture(0.0, 3.0), 0.0, 3.0) == pytest.approx(errors(GAUSSIAN, 0.0, 3.0), rel=1e-9)


def test_the_mixture_is_better_and_more_honest_than_a_gate_where_impulses_are_narrow() -> None:
    """Of impulses three times as wide as the noise a gate lets most pass."""
    (gated, overconfident), (weighted, honest) = errors(GAUSSIAN, 0.3, 3.0), errors(mixture(0.3, 3.0), 0.3, 3.0)
    assert weighted < 0.9 * gated
    assert overconfident > 1.3
    assert honest == pytest.approx(1.0, abs=0.2)  # runs of 60 correlated pings spread by 0.4: 2.5 sigma of 25


def test_a_target_that_jumps_is_noticed() -> None:
    rng, tracker = np.random.default_rng(91), ToaTracker(mixture(0.2, 10.0), NET)
    noise = ImpulsiveNoise(STD, 0.0, AlphaStable(1.8))
    for k in range(60):
        position = course(k) + (np.array([-80.0, 30.0, 0.0]) if k >= 30 else 0.0)
        estimate = tracker.update(ping(k, rng, noise, position))
    assert tracker.counts["lost"] == 1
    assert estimate is not None
    assert np.linalg.norm(estimate.mean[:2] - position[:2]) < 10.0
