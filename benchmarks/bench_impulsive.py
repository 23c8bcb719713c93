"""A 1-D particle filter, 100 particles and 20 steps, over many runs: ours, particles, filterpy's tools, Stone Soup.

The scalar form of Lee et al. 2013: an overdamped mooring with a time constant of 5 s, process noise 0.05 m per step,
measured with Gaussian noise of 0.5 m or, with probability 0.3, with noise ten times wider. Everyone starts from the
same distribution, predicts, weighs with that mixture, estimates and resamples when fewer than half (ours: a third)
count. Ours also carries a velocity and gives a covariance. Times are per run of 20 steps.
"""

from __future__ import annotations

import datetime
import importlib.util
import math
import os
import sys
from collections.abc import Callable
from functools import partial

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from timing import Row, in_turn, report

from uw_acoustic_loc.core.mooring.model import MooringConfig, step_of
from uw_acoustic_loc.core.mooring.particles import ParticleMooring

COUNT, STEPS, RUNS = 100, 20, 500  # RUNS of ours and of the normals in one call
PEER_RUNS = 200  # for the errors

START_STD, STD, FRACTION, WIDE = 2.0, 0.5, 0.3, 10.0
Run = Callable[[np.ndarray], np.ndarray]  # measurements (STEPS, runs) in, estimates of the same shape out


def course(runs: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """True and measured positions, (STEPS, runs)."""
    state, truth = START_STD * rng.standard_normal(runs), np.empty((STEPS, runs))
    for k in range(STEPS):
        state = F * state + G + WALK * rng.standard_normal(runs)
        truth[k] = state
    return truth, truth + CONFIG.expected_noise.draw(rng, truth.shape)


CONFIG = MooringConfig(
    mass=0.0,
    damping=5.0,
    initial_std=START_STD,
    measurement_std=STD,
    impulse_fraction=FRACTION,
    impulse_alpha=2.0,  # Gaussian of variance 2 scale^2, which the peers have too
    impulse_beta=0.0,
    impulse_scale=WIDE / math.sqrt(2),
    impulse_location=0.0,
    particles=COUNT,
)
STEP = step_of(CONFIG, CONFIG.process_period)
F, G, WALK = float(STEP.F[0, 0]), float(STEP.drive[0]), CONFIG.process_std  # x' = F x + G + noise


def likelihood(error: np.ndarray) -> np.ndarray:
    z2 = np.square(error / STD)
    return (1 - FRACTION) * np.exp(-0.5 * z2) + FRACTION / WIDE * np.exp(-0.5 / WIDE**2 * z2)


def ours(measured: np.ndarray) -> np.ndarray:
    state = ParticleMooring(CONFIG, np.random.default_rng(1), measured.shape[1])
    found = []
    for z in measured:
        state.predict(STEP)
        found.append(state.update(z).mean[0])
    return np.array(found)


def one_by_one(run: Callable[[np.ndarray], list[float]], measured: np.ndarray) -> np.ndarray:
    return np.array([run(z) for z in measured.T]).T


def with_filterpy(measured: np.ndarray) -> list[float]:
    """As in the book that comes with it: numpy arrays and its systematic_resample."""
    from filterpy.monte_carlo import systematic_resample  # noqa: PLC0415

    rng = RNG
    cloud, weights, found = START_STD * rng.standard_normal(COUNT), np.full(COUNT, 1 / COUNT), []
    for z in measured:
        cloud = F * cloud + G + WALK * rng.standard_normal(COUNT)
        weights = weights * likelihood(z - cloud) + 1e-300
        weights /= weights.sum()
        found.append(float(np.average(cloud, weights=weights)))
        if 1.0 / np.sum(np.square(weights)) < COUNT / 2:
            index = systematic_resample(weights)
            cloud, weights = cloud[index], np.full(COUNT, 1 / COUNT)
    return found


def with_particles(measured: np.ndarray, by_hand: bool = False) -> list[float]:
    """A state-space model as its manual has it, under a bootstrap filter; version 0.3 has no mixtures of its own.

    The measurement's density is made of its Normals, as the Mixture of its later versions is, or is written out.
    """
    import particles  # noqa: PLC0415
    from particles import distributions as dists  # noqa: PLC0415
    from particles import state_space_models as ssms  # noqa: PLC0415

    class Mixture(dists.ProbDist):
        def __init__(self, loc: np.ndarray) -> None:
            self.loc = loc

        def logpdf(self, x: float) -> np.ndarray:
            if by_hand:
                return np.log(likelihood(x - self.loc))
            narrow, wide = dists.Normal(loc=self.loc, scale=STD), dists.Normal(loc=self.loc, scale=WIDE * STD)
            return np.logaddexp(math.log(1 - FRACTION) + narrow.logpdf(x), math.log(FRACTION) + wide.logpdf(x))

    class Walk(ssms.StateSpaceModel):
        def PX0(self) -> object:  # noqa: N802
            return dists.Normal(loc=G, scale=math.hypot(F * START_STD, WALK))

        def PX(self, t: int, xp: np.ndarray) -> object:  # noqa: N802
            return dists.Normal(loc=F * xp + G, scale=WALK)

        def PY(self, t: int, xp: np.ndarray, x: np.ndarray) -> object:  # noqa: N802
            return Mixture(x)

    model = ssms.Bootstrap(ssm=Walk(), data=measured)
    smc = particles.SMC(fk=model, N=COUNT, resampling="systematic", ESSrmin=0.5, collect="off")
    found = []
    for _ in measured:
        next(smc)
        found.append(float(np.average(smc.X, weights=smc.W)))
    return found


def with_stonesoup(measured: np.ndarray) -> list[float]:
    """Its particle predictor and updater; the mixture is a measurement model of our own."""
    from stonesoup.models.base import GaussianModel  # noqa: PLC0415
    from stonesoup.models.measurement.linear import LinearGaussian  # noqa: PLC0415
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel  # noqa: PLC0415
    from stonesoup.predictor.particle import ParticlePredictor  # noqa: PLC0415
    from stonesoup.resampler.particle import ESSResampler, SystematicResampler  # noqa: PLC0415
    from stonesoup.types.detection import Detection  # noqa: PLC0415
    from stonesoup.types.hypothesis import SingleHypothesis  # noqa: PLC0415
    from stonesoup.types.state import ParticleState, State, StateVector, StateVectors  # noqa: PLC0415
    from stonesoup.updater.particle import ParticleUpdater  # noqa: PLC0415

    class Scalar(LinearGaussianTimeInvariantTransitionModel):
        def function(self, state: State, noise: object = False, **kwargs: object) -> StateVectors:
            return super().function(state, noise=noise, **kwargs) + G

    class Mixture(LinearGaussian, GaussianModel):
        def logpdf(self, state1: State, state2: State, **kwargs: object) -> np.ndarray:
            error = np.asarray(state1.state_vector - self.function(state2), dtype=float)
            return np.log(likelihood(error)).ravel()

    now, step = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC), datetime.timedelta(seconds=1)
    model = Mixture(ndim_state=1, mapping=(0,), noise_covar=np.array([[STD**2]]))
    predictor = ParticlePredictor(Scalar(transition_matrix=np.array([[F]]), covariance_matrix=np.array([[WALK**2]])))
    updater = ParticleUpdater(model, resampler=ESSResampler(threshold=COUNT / 2, resampler=SystematicResampler()))
    cloud = StateVectors(START_STD * RNG.standard_normal((1, COUNT)))
    state, found = ParticleState(cloud, weight=np.full(COUNT, 1 / COUNT), timestamp=now), []
    for z in measured:
        now += step
        prediction = predictor.predict(state, timestamp=now)
        detection = Detection(StateVector([[z]]), timestamp=now, measurement_model=model)
        state = updater.update(SingleHypothesis(prediction, detection))
        weights = np.asarray(state.weight, dtype=float)
        found.append(float(np.average(np.asarray(state.state_vector, dtype=float)[0], weights=weights)))
    return found


def accuracy(run: Run, truth: np.ndarray, measured: np.ndarray) -> str:
    return f"RMSE {math.sqrt(np.mean(np.square(run(measured) - truth))):.4f}"


def main() -> int:
    truth, measured = course(RUNS, np.random.default_rng(5))
    peers: dict[str, tuple[str, Run, float]] = {
        "ours, 500 runs at once": ("uw_acoustic_loc", ours, 0.0),
        "ours, one run at a time": ("uw_acoustic_loc", partial(one_by_one, lambda z: ours(z[:, None])[:, 0]), 0.0),
        "particles": ("particles", partial(one_by_one, with_particles), 40.0),
        "particles, density by hand": ("particles", partial(one_by_one, partial(with_particles, by_hand=True)), 0.0),
        "numpy + filterpy's systematic_resample": ("filterpy", partial(one_by_one, with_filterpy), 0.0),
        "Stone Soup": ("stonesoup", partial(one_by_one, with_stonesoup), 100.0),
    }
    here = {name: peer for name, peer in peers.items() if importlib.util.find_spec(peer[0])}
    errors = {name: accuracy(run, truth[:, :PEER_RUNS], measured[:, :PEER_RUNS]) for name, (_, run, _) in here.items()}
    batch, normals = "ours, 500 runs at once", "drawing 100 x 20 normals, 500 times at once"
    rng, block = np.random.default_rng(6), np.empty((RUNS, COUNT))
    calls: dict[str, Callable[[], object]] = {
        normals: lambda: [rng.standard_normal(out=block) for _ in range(STEPS)],
        batch: lambda: ours(measured),
    }
    calls |= {name: partial(run, measured[:, :1]) for name, (_, run, _) in here.items() if name != batch}
    medians = in_turn(calls, 10.0)
    for name in (normals, batch):
        medians[name] /= RUNS
    rows = [Row(normals, medians[normals], ours_within=3.3)]
    rows += [Row(name, medians.get(name), errors.get(name, ""), goal) for name, (_, _, goal) in peers.items()]
    return report("A 1-D particle filter, 100 particles x 20 steps, time per run", batch, rows)


RNG = np.random.default_rng(2)  # of the peers

if __name__ == "__main__":
    sys.exit(main())
