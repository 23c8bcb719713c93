"""Extended Kalman filter of times of arrival (Choi 2025): one run, and 1000 runs at once; a whole track of 50 pings.

Four buoys, eight labelled arrivals a ping (direct and over the seabed), seven states. Everyone predicts and updates
with the same model, its Jacobian analytic and vectorised over the arrivals. Ours also gates each arrival; Stone Soup
keeps more books per step.
"""

from __future__ import annotations

import datetime
import importlib.util
import os
import sys
from collections.abc import Callable

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from timing import Row, in_turn, report

from uw_acoustic_loc.core.toa.model import arrival_times, motion, predict, process_noise
from uw_acoustic_loc.core.toa.tracker import ToaTracker
from uw_acoustic_loc.core.toa.update import absorb
from uw_acoustic_loc.studies.toa import trials
from uw_acoustic_loc.studies.toa.batch import ToaBatch

RUNS, TRIALS, STD, DT = 1000, 20, trials.STD, trials.DT
VARIANT = trials.VARIANTS["nominal"]
CONFIG, NET = VARIANT.config, VARIANT.net
IMAGES = NET.images[list(VARIANT.paths)].reshape(-1, 3)
PRIOR = np.diag(np.square(VARIANT.prior))
TRUTH = trials.truths(TRIALS, 1)
Step = Callable[[np.ndarray], np.ndarray]  # times of arrival (8,) in, the state (7,) out


def measured() -> np.ndarray:
    """(TRIALS, pings, 8) s."""
    rng = np.random.default_rng(2)
    exact = np.linalg.norm(TRUTH[:, :, None, :3] - IMAGES, axis=3) / TRUTH[..., 6:]
    return np.asarray(exact + STD * rng.standard_normal(exact.shape))


def times_of(x: np.ndarray) -> np.ndarray:
    path = x[:3] - IMAGES
    return np.asarray(np.sqrt((path * path).sum(axis=1)) / x[6])


def jacobian_of(x: np.ndarray) -> np.ndarray:
    path = x[:3] - IMAGES
    length = np.sqrt((path * path).sum(axis=1))
    H = np.zeros((len(IMAGES), 7))
    H[:, :3] = path / (length * x[6])[:, None]
    H[:, 6] = -length / x[6] ** 2
    return H


def ours(start: np.ndarray) -> Step:
    """The functions that the tracker calls."""
    mean, cov, R = start, PRIOR, STD**2 * np.eye(len(IMAGES))

    def step(times: np.ndarray) -> np.ndarray:
        nonlocal mean, cov
        mean, cov = predict(mean, cov, DT, CONFIG)
        expected, H = arrival_times(mean, IMAGES)
        found = absorb(cov, times - expected, H, R, CONFIG.arrivals.gate_sigma)
        mean, cov = mean + found.change, found.cov
        return mean

    return step


def with_filterpy(start: np.ndarray) -> Step:
    from filterpy.kalman import ExtendedKalmanFilter  # noqa: PLC0415

    kalman = ExtendedKalmanFilter(7, len(IMAGES))
    kalman.x, kalman.P = start.copy(), PRIOR.copy()
    kalman.F, kalman.Q, kalman.R = motion(DT), process_noise(DT, CONFIG.process), STD**2 * np.eye(len(IMAGES))

    def step(times: np.ndarray) -> np.ndarray:
        kalman.predict()
        kalman.update(times, jacobian_of, times_of)
        return np.asarray(kalman.x)

    return step


def with_stonesoup(start: np.ndarray) -> Step:
    from stonesoup.models.base import GaussianModel  # noqa: PLC0415
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement  # noqa: PLC0415
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel  # noqa: PLC0415
    from stonesoup.predictor.kalman import KalmanPredictor  # noqa: PLC0415
    from stonesoup.types.detection import Detection  # noqa: PLC0415
    from stonesoup.types.hypothesis import SingleHypothesis  # noqa: PLC0415
    from stonesoup.types.state import GaussianState, State, StateVector  # noqa: PLC0415
    from stonesoup.updater.kalman import ExtendedKalmanUpdater  # noqa: PLC0415

    class Toa(NonLinearGaussianMeasurement, GaussianModel):
        @property
        def ndim_meas(self) -> int:
            return len(IMAGES)

        def function(self, state: State, noise: object = False, **kwargs: object) -> object:
            return StateVector(times_of(np.asarray(state.state_vector, dtype=float)[:, 0]))

        def jacobian(self, state: State, **kwargs: object) -> np.ndarray:
            return jacobian_of(np.asarray(state.state_vector, dtype=float)[:, 0])

    now, second = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC), datetime.timedelta(seconds=DT)
    model = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=motion(DT), covariance_matrix=process_noise(DT, CONFIG.process)
    )
    sensor = Toa(ndim_state=7, mapping=(0, 1, 2, 6), noise_covar=STD**2 * np.eye(len(IMAGES)))
    predictor, updater = KalmanPredictor(model), ExtendedKalmanUpdater(sensor)
    state = GaussianState(StateVector(start), PRIOR, timestamp=now)

    def step(times: np.ndarray) -> np.ndarray:
        nonlocal state, now
        now += second
        detection = Detection(StateVector(times), timestamp=now, measurement_model=sensor)
        prediction = predictor.predict(state, timestamp=now)
        state = updater.update(SingleHypothesis(prediction, detection))
        return np.asarray(state.state_vector, dtype=float)[:, 0]

    return step


PEERS: dict[str, tuple[str, Callable[[np.ndarray], Step], float, float]] = {
    "ours": ("uw_acoustic_loc", ours, 0.0, 0.0),
    "filterpy": ("filterpy", with_filterpy, 1.8, 40.0),
    "Stone Soup": ("stonesoup", with_stonesoup, 8.0, 200.0),
}
HERE = {name: peer for name, peer in PEERS.items() if importlib.util.find_spec(peer[0])}


def starts() -> np.ndarray:
    """(TRIALS, 7) a step before the first ping."""
    first = TRUTH[:, 0] + np.random.default_rng(3).normal(0.0, VARIANT.prior, (TRIALS, 7))
    first[:, :3] -= DT * first[:, 3:6]
    return first


def accuracy(make: Callable[[np.ndarray], Step], heard: np.ndarray) -> str:
    errors = []
    for truth, start, pings in zip(TRUTH, starts(), heard, strict=True):
        step = make(start)
        found = np.array([step(times) for times in pings])
        errors.append((found - truth)[10:, :3])
    return f"RMSE {np.sqrt(np.mean(np.square(errors).sum(axis=2))):.3f} m"


def standing(make: Callable[[np.ndarray], Step]) -> Callable[[], object]:
    """The same ping over and over, of a target at rest."""
    start = np.array([*trials.START[:3], 0.0, 0.0, 0.0, trials.SOUND_SPEED])
    step, times = make(start), times_of(start)
    return lambda: step(times)


def many() -> Callable[[], object]:
    start = np.array([*trials.START[:3], 0.0, 0.0, 0.0, trials.SOUND_SPEED])
    times = times_of(start)[:, None] + np.zeros(RUNS)
    batch = ToaBatch(np.repeat(start[:, None], RUNS, 1), np.repeat(PRIOR[..., None], RUNS, 2), CONFIG)

    def step() -> None:
        batch.predict(DT)
        batch.update(IMAGES, times, STD)

    return step


def track() -> Callable[[], object]:
    """The node's tracker from nothing: cold start, checks of the rows, association, gate."""
    heard = trials.arrivals(trials.VARIANTS["cold_start"], TRUTH[0], np.random.default_rng(4))

    def run() -> None:
        tracker = ToaTracker(CONFIG, NET)
        for ping in heard:
            tracker.update(ping)

    return run


def main() -> int:
    heard = measured()
    errors = {name: accuracy(make, heard) for name, (_, make, _, _) in HERE.items()}
    calls = {name: standing(make) for name, (_, make, _, _) in HERE.items()}
    medians = in_turn({**calls, "many": many(), "track": track()}, 8.0)
    one = [Row(name, medians.get(name), errors.get(name, ""), goal) for name, (_, _, goal, _) in PEERS.items()]
    each = {name: RUNS * medians[name] for name in HERE}
    at_once = [Row("ours, at once", medians["many"])]
    at_once += [Row(f"{name}, one by one", each.get(name), "", goal) for name, (_, _, _, goal) in PEERS.items()]
    missed = report("Step of a time-of-arrival EKF, 8 arrivals", "ours", one)
    missed |= report(f"The same for {RUNS} runs", "ours, at once", at_once)
    good = medians["track"] < _GOAL
    print(f"50 pings through the node's tracker from a cold start: {1e3 * medians['track']:.1f} ms, goal < 50 ms")
    return missed | int(not good)


_GOAL = 0.05  # s for 50 pings

if __name__ == "__main__":
    sys.exit(main())
