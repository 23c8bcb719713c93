"""A step of a 2-D particle filter with 2000 particles: ours, particles, filterpy's tools, Stone Soup.

A source 60 m away drifts in bearing, and a TDOA is measured at every step. Everyone predicts, weighs with the exact
near-field TDOA, estimates the bearing and resamples when fewer than half (ours: a quarter) count. Ours also places
searchers, finds the strongest lobe, and draws fewer particles, down to 300, once the bearing is settled (Fox 2003);
Stone Soup keeps more books.
"""

from __future__ import annotations

import datetime
import importlib.util
import math
import os
import sys
from collections.abc import Callable

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from timing import Row, in_turn, report

from uw_acoustic_loc.core.bearing.filters import ParticleFilter, PeakLikelihood
from uw_acoustic_loc.core.geometry import tdoa_of_points

COUNT, STEPS, RANGE = 2000, 400, 60.0
SPACING, SPEED = 0.6, 1500.0
MAX_LAG, STD, DRIFT = SPACING / SPEED, 2e-6, 0.01  # s, s, rad per step
SETTLING = 20
Step = Callable[[float], float]  # a TDOA in, a bearing out


def course(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Bearings, reflected at 60 and 120 degrees, and measured TDOAs."""
    theta = np.cumsum(DRIFT * rng.standard_normal(STEPS)) + math.pi / 2
    third = math.pi / 3
    theta = third + np.abs((theta - third + third) % (2 * third) - third)
    points = RANGE * np.stack([np.cos(theta), np.sin(theta)])
    return theta, tdoa_of_points(points, SPACING, SPEED) + STD * rng.standard_normal(STEPS)


def first_cloud(rng: np.random.Generator) -> np.ndarray:
    """(2, COUNT) around the truth, for the peers."""
    theta = math.pi / 2 + 0.02 * rng.standard_normal(COUNT)
    return RANGE * (1 + 0.05 * rng.standard_normal(COUNT)) * np.stack([np.cos(theta), np.sin(theta)])


def log_likelihood(points: np.ndarray, tdoa: float) -> np.ndarray:
    off = (tdoa_of_points(points, SPACING, SPEED) - tdoa) / STD
    return -0.5 * off * off


def ours() -> Step:
    state = ParticleFilter(SPACING, SPEED, (10.0, 100.0), COUNT, np.random.default_rng(1))

    def step(tdoa: float) -> float:
        state.predict(0.0, (0.0, 0.0), DRIFT)
        state.update(PeakLikelihood(np.array([tdoa]), np.ones(1), STD, MAX_LAG))
        return state.estimate()[0]

    return step


def with_filterpy() -> Step:
    """As in the book that comes with it: numpy arrays and its systematic_resample."""
    from filterpy.monte_carlo import systematic_resample  # noqa: PLC0415

    rng = np.random.default_rng(2)
    cloud, weights = first_cloud(rng), np.full(COUNT, 1.0 / COUNT)

    def step(tdoa: float) -> float:
        nonlocal cloud, weights
        cloud = cloud + RANGE * DRIFT * rng.standard_normal(cloud.shape)
        weights = weights * np.exp(log_likelihood(cloud, tdoa)) + 1e-300
        weights /= weights.sum()
        theta = float(np.average(np.arctan2(cloud[1], cloud[0]), weights=weights))
        if 1.0 / np.sum(np.square(weights)) < COUNT / 2:
            index = systematic_resample(weights)
            cloud, weights = cloud[:, index], np.full(COUNT, 1.0 / COUNT)
        return theta

    return step


def with_particles() -> Step:
    """A state-space model of its distributions, as its manual has it, under a bootstrap filter."""
    import particles  # noqa: PLC0415
    from particles import distributions as dists  # noqa: PLC0415
    from particles import state_space_models as ssms  # noqa: PLC0415

    class Drift(ssms.StateSpaceModel):
        def PX0(self) -> object:  # noqa: N802
            return dists.IndepProd(dists.Normal(scale=0.02 * RANGE), dists.Normal(loc=RANGE, scale=0.05 * RANGE))

        def PX(self, t: int, xp: np.ndarray) -> object:  # noqa: N802
            scale = RANGE * DRIFT
            return dists.IndepProd(dists.Normal(loc=xp[:, 0], scale=scale), dists.Normal(loc=xp[:, 1], scale=scale))

        def PY(self, t: int, xp: np.ndarray, x: np.ndarray) -> object:  # noqa: N802
            return dists.Normal(loc=tdoa_of_points(x.T, SPACING, SPEED), scale=STD)

    data: list[float] = []
    model = ssms.Bootstrap(ssm=Drift(), data=data)
    smc = particles.SMC(fk=model, N=COUNT, resampling="systematic", ESSrmin=0.5, collect="off")

    def step(tdoa: float) -> float:
        data.append(tdoa)
        next(smc)
        return float(np.average(np.arctan2(smc.X[:, 1], smc.X[:, 0]), weights=smc.W))

    return step


def with_stonesoup() -> Step:
    from stonesoup.models.base import GaussianModel  # noqa: PLC0415
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement  # noqa: PLC0415
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk  # noqa: PLC0415
    from stonesoup.predictor.particle import ParticlePredictor  # noqa: PLC0415
    from stonesoup.resampler.particle import ESSResampler, SystematicResampler  # noqa: PLC0415
    from stonesoup.types.detection import Detection  # noqa: PLC0415
    from stonesoup.types.hypothesis import SingleHypothesis  # noqa: PLC0415
    from stonesoup.types.state import ParticleState, State, StateVector, StateVectors  # noqa: PLC0415
    from stonesoup.updater.particle import ParticleUpdater  # noqa: PLC0415

    class Tdoa(NonLinearGaussianMeasurement, GaussianModel):
        @property
        def ndim_meas(self) -> int:
            return 1

        def function(self, state: State, noise: object = False, **kwargs: object) -> object:
            values = tdoa_of_points(np.asarray(state.state_vector, dtype=float), SPACING, SPEED)
            return StateVectors(values[None, :])

    rng = np.random.default_rng(4)
    now = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
    second = datetime.timedelta(seconds=1)
    walk = RandomWalk((RANGE * DRIFT) ** 2)
    predictor = ParticlePredictor(CombinedLinearGaussianTransitionModel([walk, walk]))
    measured = Tdoa(ndim_state=2, mapping=(0, 1), noise_covar=np.array([[STD**2]]))
    updater = ParticleUpdater(measured, resampler=ESSResampler(threshold=COUNT / 2, resampler=SystematicResampler()))
    state = ParticleState(StateVectors(first_cloud(rng)), weight=np.full(COUNT, 1.0 / COUNT), timestamp=now)

    def step(tdoa: float) -> float:
        nonlocal state, now
        now += second
        prediction = predictor.predict(state, timestamp=now)
        detection = Detection(StateVector([[tdoa]]), timestamp=now, measurement_model=measured)
        state = updater.update(SingleHypothesis(prediction, detection))
        x, y = np.asarray(state.state_vector, dtype=float)
        return float(np.average(np.arctan2(y, x), weights=np.asarray(state.weight, dtype=float)))

    return step


def accuracy(step: Step, theta: np.ndarray, tdoas: np.ndarray) -> str:
    errors = np.array([step(float(tdoa)) for tdoa in tdoas]) - theta
    return f"RMSE {math.degrees(math.sqrt(np.mean(errors[SETTLING:] ** 2))):.3f} deg"


def endless(step: Step, tdoas: np.ndarray) -> Callable[[], float]:
    """To and fro through the course, so that it never jumps."""
    loop, k = np.concatenate([tdoas[::-1], tdoas]), 0

    def call() -> float:
        nonlocal k
        k = (k + 1) % loop.size
        return step(float(loop[k]))

    return call


def main() -> int:
    theta, tdoas = course(np.random.default_rng(5))
    peers: dict[str, tuple[str, Callable[[], Step], float]] = {
        "ours": ("uw_acoustic_loc", ours, 0.0),
        "particles": ("particles", with_particles, 4.0),
        "numpy + filterpy's systematic_resample": ("filterpy", with_filterpy, 10.0),
        "Stone Soup": ("stonesoup", with_stonesoup, 15.0),
    }
    here = {name: peer for name, peer in peers.items() if importlib.util.find_spec(peer[0])}
    steps = {name: make() for name, (_, make, _) in here.items()}
    errors = {name: accuracy(step, theta, tdoas) for name, step in steps.items()}
    rng = np.random.default_rng(6)
    calls: dict[str, Callable[[], object]] = {"drawing 2 x 2000 normals": lambda: rng.standard_normal((2, COUNT))}
    calls |= {name: endless(step, tdoas) for name, step in steps.items()}
    medians = in_turn(calls, 8.0)
    rows = [Row("drawing 2 x 2000 normals", medians["drawing 2 x 2000 normals"], ours_within=2.5)]
    rows += [Row(name, medians.get(name), errors.get(name, ""), goal) for name, (_, _, goal) in peers.items()]
    return report("Step of a 2-D particle filter, 2000 particles", "ours", rows)


if __name__ == "__main__":
    sys.exit(main())
