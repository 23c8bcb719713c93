"""A step of a bearing-only EKF: one run beside filterpy and Stone Soup, 1000 runs at once beside simdkalman.

A vehicle weaves past a still source and hears a bearing per step. Everyone starts at the same guess, with the same
spread and the same noise, and ends with a position and a covariance. The peers have their state in x and y, as it is
usually written; ours is in log-polar coordinates. Inputs are converted to each one's own types before the clock starts.
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

from uw_acoustic_loc.core.localizer.bearing_ekf import single_start
from uw_acoustic_loc.core.localizer.log_polar import LogPolar, corrected, seen_from
from uw_acoustic_loc.core.localizer.triangulation import Drift, Ray

STEPS, RUNS, FEW, STD = 200, 1000, 20, math.radians(2.0)
SOURCE, GUESS, SPREAD = 10 + 53j, 20 + 60j, 15.0  # m
Q = 1e-6  # m^2 per step
ALONG = np.linspace(0.0, 60.0, STEPS)
VEHICLE = ALONG + 8j * np.sin(ALONG / 15)
SHIFTS = -np.diff(VEHICLE, prepend=0)
HEARD = np.angle(SOURCE - VEHICLE)[:, None] + STD * np.random.default_rng(7).standard_normal((STEPS, RUNS))
Step = Callable[[int], complex | np.ndarray]  # a step's number in, relative positions out


def ours(run: int = 0) -> Step:
    """The node's class, with one member."""
    ekf = single_start(np.zeros(2), np.array([GUESS.real, GUESS.imag]), SPREAD**2 * np.eye(2))
    ekf._process_noise = math.sqrt(Q)
    still = Drift()
    rays = [Ray(v.real, v.imag, b, STD) for v, b in zip(VEHICLE.tolist(), HEARD[:, run].tolist(), strict=True)]

    def step(k: int) -> complex:
        ekf.predict(1.0, still)
        ekf.update(rays[k])
        return ekf._members[0].state.line

    return step


def ours_bare(run: int = 0) -> Step:
    """Its kernel, which is what many runs at once use."""
    state = LogPolar(GUESS, 2 * (SPREAD / abs(GUESS)) ** 2, 0j)
    shifts, toward = SHIFTS.tolist(), np.exp(1j * HEARD[:, run]).tolist()

    def step(k: int) -> complex:
        nonlocal state
        line, g, q = seen_from(state, shifts[k])
        g += 2 * Q / (line.real * line.real + line.imag * line.imag)
        state = corrected(LogPolar(line, g, q), toward[k], STD**2).state
        return complex(state.line)

    return step


def ours_batched() -> Step:
    state = LogPolar(np.full(RUNS, GUESS), np.full(RUNS, 2 * (SPREAD / abs(GUESS)) ** 2), np.zeros(RUNS, complex))
    toward = np.exp(1j * HEARD)

    def step(k: int) -> np.ndarray:
        nonlocal state
        line, g, q = seen_from(state, SHIFTS[k])
        g = g + 2 * Q / (line.real * line.real + line.imag * line.imag)
        state = corrected(LogPolar(line, g, q), toward[k], STD**2).state
        return np.asarray(state.line)

    return step


def jacobian(x: np.ndarray) -> np.ndarray:
    r2 = x[0] ** 2 + x[1] ** 2
    return np.array([[-x[1] / r2, x[0] / r2]])


def wrapped(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a - b + math.pi) % (2 * math.pi) - math.pi


def with_filterpy(run: int = 0) -> Step:
    from filterpy.kalman import ExtendedKalmanFilter  # noqa: PLC0415

    ekf = ExtendedKalmanFilter(dim_x=2, dim_z=1)
    ekf.x, ekf.P = np.array([GUESS.real, GUESS.imag]), SPREAD**2 * np.eye(2)
    motion, heard = np.stack([SHIFTS.real, SHIFTS.imag], axis=1), HEARD[:, run : run + 1]
    ekf.F, ekf.Q, ekf.R, ekf.B = np.eye(2), Q * np.eye(2), np.array([[STD**2]]), np.eye(2)

    def seen(x: np.ndarray) -> np.ndarray:
        return np.array([math.atan2(x[1], x[0])])

    def step(k: int) -> complex:
        ekf.predict(u=motion[k])
        ekf.update(heard[k], jacobian, seen, residual=wrapped)
        return complex(ekf.x[0], ekf.x[1])

    return step


def with_filterpy_loop() -> Step:
    """A thousand of them, one after the other: it has no other way."""
    steps = [with_filterpy(run) for run in range(RUNS)]
    return lambda k: np.array([step(k) for step in steps])


def with_simdkalman() -> Step:
    """Its predict and update of many series, a Jacobian and a linearised measurement for each."""
    from simdkalman.primitives import predict, update  # noqa: PLC0415

    mean = np.tile([[GUESS.real], [GUESS.imag]], (RUNS, 1, 1))
    cov = np.tile(SPREAD**2 * np.eye(2), (RUNS, 1, 1))
    F, drift, R = np.eye(2)[None], Q * np.eye(2)[None], np.array([[[STD**2]]])

    def step(k: int) -> np.ndarray:
        nonlocal mean, cov
        mean, cov = predict(mean, cov, F, drift)
        mean = mean + np.array([[SHIFTS[k].real], [SHIFTS[k].imag]])
        x, y = mean[:, 0, 0], mean[:, 1, 0]
        r2 = x * x + y * y
        H = np.stack([-y / r2, x / r2], axis=1)[:, None, :]
        error = wrapped(HEARD[k], np.arctan2(y, x))  # H x = 0, so it stands for the measurement
        mean, cov = update(mean, cov, H, R, error[:, None, None])
        return mean[:, 0, 0] + 1j * mean[:, 1, 0]

    return step


def with_stonesoup(run: int = 0) -> Step:
    from stonesoup.models.measurement.nonlinear import Cartesian2DToBearing  # noqa: PLC0415
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk  # noqa: PLC0415
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor  # noqa: PLC0415
    from stonesoup.types.angle import Bearing  # noqa: PLC0415
    from stonesoup.types.detection import Detection  # noqa: PLC0415
    from stonesoup.types.hypothesis import SingleHypothesis  # noqa: PLC0415
    from stonesoup.types.state import GaussianState  # noqa: PLC0415
    from stonesoup.updater.kalman import ExtendedKalmanUpdater  # noqa: PLC0415

    now = datetime.datetime(2020, 1, 1, tzinfo=datetime.UTC)
    second = datetime.timedelta(seconds=1)
    predictor = ExtendedKalmanPredictor(CombinedLinearGaussianTransitionModel([RandomWalk(Q), RandomWalk(Q)]))
    updater = ExtendedKalmanUpdater(None)
    state = GaussianState([[GUESS.real], [GUESS.imag]], SPREAD**2 * np.eye(2), timestamp=now)

    def step(k: int) -> complex:
        nonlocal state, now
        now += second
        where = np.array([[VEHICLE[k].real], [VEHICLE[k].imag]])
        model = Cartesian2DToBearing(2, (0, 1), np.array([[STD**2]]), translation_offset=where)
        heard = Detection(np.array([[Bearing(HEARD[k, run])]]), timestamp=now, measurement_model=model)
        state = updater.update(SingleHypothesis(predictor.predict(state, timestamp=now), heard))
        return complex(*np.asarray(state.state_vector, dtype=float)[:, 0]) - VEHICLE[k]

    return step


def accuracy(steps: list[Step]) -> str:
    """Over the runs of one batch, or of several single ones."""
    for k in range(STEPS):
        last = [step(k) for step in steps]
    off = np.abs(np.ravel(last) - (SOURCE - VEHICLE[-1]))
    return f"RMSE {math.sqrt(np.mean(off**2)):.2f} m at the end of {off.size} runs"


def endless(step: Step) -> Callable[[], object]:
    """The course again and again."""
    k = -1

    def call() -> object:
        nonlocal k
        k += 1
        return step(k % STEPS)

    return call


def measured(title: str, peers: dict[str, tuple[str, list[Callable[[], Step]], float]], seconds: float) -> int:
    here = {name: peer for name, peer in peers.items() if importlib.util.find_spec(peer[0])}
    errors = {name: accuracy([make() for make in makers]) for name, (_, makers, _) in here.items()}
    medians = in_turn({name: endless(makers[0]()) for name, (_, makers, _) in here.items()}, seconds)
    rows = [Row(name, medians.get(name), errors.get(name, ""), goal) for name, (_, _, goal) in peers.items()]
    return report(title, "ours", rows)


def several(make: Callable[[int], Step]) -> list[Callable[[], Step]]:
    return [partial(make, run) for run in range(FEW)]


def main() -> int:
    one = {
        "ours": ("uw_acoustic_loc", several(ours), 0.0),
        "ours, the kernel alone": ("uw_acoustic_loc", several(ours_bare), 0.0),
        "filterpy": ("filterpy", several(with_filterpy), 6.0),
        "Stone Soup": ("stonesoup", several(with_stonesoup), 100.0),
    }
    many = {
        "ours": ("uw_acoustic_loc", [ours_batched], 0.0),
        "simdkalman": ("simdkalman", [with_simdkalman], 5.0),
        "filterpy, one by one": ("filterpy", [with_filterpy_loop], 200.0),
    }
    missed = measured("Step of a bearing-only EKF, one run", one, 4.0)
    return measured("The same, 1000 runs at once", many, 8.0) or missed


if __name__ == "__main__":
    sys.exit(main())
