"""Multistatic fixes from range sums and bearings: ours for many targets at once, scipy.optimize target by target.

Everyone minimises the same sum of squares, range sums and bearings over their standard deviations, with Gaussian noise,
from the same closed-form start, which ours has to work out and the peers get for nothing. The peers find the Jacobian
by differences, as they do when none is given, or have it in closed form. Errors are over the Cramer-Rao bound, of all
targets for ours, of some for the peers.
"""

from __future__ import annotations

import itertools
import os
import sys
import time
from collections.abc import Callable
from functools import partial

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from scipy.optimize import least_squares, leastsq
from timing import Row, in_turn, report

from uw_acoustic_loc.core.multistatic.bound import cramer_rao, position_error
from uw_acoustic_loc.core.multistatic.estimator import Noise, SonarNet, gaussian_likelihood, locate
from uw_acoustic_loc.core.multistatic.start import closed_form

RANGE_STD, BEARING_STD = 40.0, 0.02
DISTANCE, PEERS = 2000.0, 200  # m; targets that the peers are judged by
TRIALS = {3: 10, 30: 1, 200: 1}  # receivers: how often the grid is taken at once
GOALS = {3: (200.0, 1500.0), 30: (0.0, 0.0), 200: (6.0, 40.0)}  # receivers: leastsq, trf
Solve = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # start, ranges, bearings -> position


def polygon(count: int) -> SonarNet:
    angle = 2 * np.pi * np.arange(count) / count
    return SonarNet(np.zeros(2), DISTANCE * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def grid() -> np.ndarray:
    """(4900, 2) every 144 m within 5 km, as in the paper."""
    axis = 144.0 * (np.arange(70) - 34.5)
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


def residuals(p: np.ndarray, net: SonarNet, ranges: np.ndarray, bearings: np.ndarray) -> np.ndarray:
    dx, dy = p[0] - net.receivers[:, 0], p[1] - net.receivers[:, 1]
    total = np.sqrt(dx * dx + dy * dy) + np.sqrt(p[0] * p[0] + p[1] * p[1])
    turn = np.arctan2(dy, dx) - bearings
    turn -= 2 * np.pi * np.rint(turn / (2 * np.pi))
    return np.concatenate([(total - ranges) / RANGE_STD, turn / BEARING_STD])


def jacobian(p: np.ndarray, net: SonarNet, _ranges: np.ndarray, _bearings: np.ndarray) -> np.ndarray:
    d = p - net.receivers
    distance = np.sqrt((d * d).sum(axis=1))[:, None]
    by_range = (d / distance + p / np.sqrt(p @ p)) / RANGE_STD
    by_bearing = np.stack([-d[:, 1], d[:, 0]], axis=1) / (distance**2 * BEARING_STD)
    return np.concatenate([by_range, by_bearing])


def peers(net: SonarNet) -> dict[str, Solve]:
    def levenberg(start: np.ndarray, ranges: np.ndarray, bearings: np.ndarray, **options: object) -> np.ndarray:
        return leastsq(residuals, start, args=(net, ranges, bearings), **options)[0]

    def trust_region(start: np.ndarray, ranges: np.ndarray, bearings: np.ndarray, **options: object) -> np.ndarray:
        return least_squares(residuals, start, args=(net, ranges, bearings), method="trf", **options).x

    return {
        "leastsq": levenberg,
        "leastsq, own Jacobian": partial(levenberg, Dfun=jacobian),
        "least_squares trf": trust_region,
        "least_squares trf, own Jacobian": partial(trust_region, jac=jacobian),
    }


def over_bound(found: np.ndarray, targets: np.ndarray, bound: np.ndarray) -> str:
    """RMSE of errors in units of the bound at each target."""
    error = np.hypot(*(found - targets).T) / bound
    return f"RMSE {np.sqrt(np.mean(error**2)):.3f} of the bound"


def contest(count: int, seconds: float) -> int:
    net, noise = polygon(count), Noise(np.full(count, RANGE_STD), np.full(count, BEARING_STD), rayleigh=False)
    rng, targets = np.random.default_rng(count), np.tile(grid(), (TRIALS[count], 1))
    ranges, bearings = (m + e for m, e in zip(net.measure(targets), noise.draw(rng, (len(targets),)), strict=True))
    bound = position_error(cramer_rao(net, targets, noise))
    few = rng.choice(len(targets), PEERS, replace=False)
    starts = dict(
        zip(few.tolist(), closed_form(gaussian_likelihood(net, ranges[:, few], bearings[:, few], noise)).T, strict=True)
    )

    def solved(solve: Solve, k: int) -> np.ndarray:
        return solve(starts[k], ranges[:, k], bearings[:, k])

    def in_turn_of(solve: Solve) -> Callable[[], object]:
        turns = itertools.cycle(starts)
        return lambda: solved(solve, next(turns))

    solvers = peers(net)
    calls: dict[str, Callable[[], object]] = {"ours": lambda: locate(net, ranges, bearings, noise)}
    calls |= {name: in_turn_of(solve) for name, solve in solvers.items()}
    medians = in_turn(calls, seconds)
    found = locate(net, ranges, bearings, noise).positions
    goals = dict(zip(("leastsq", "least_squares trf"), GOALS[count], strict=True))
    rows = [Row("ours", medians["ours"] / len(targets), over_bound(found, targets, bound))]
    for name, solve in solvers.items():
        accuracy = over_bound(np.array([solved(solve, k) for k in starts]), targets[few], bound[few])
        rows.append(Row(name, medians[name], accuracy, goals.get(name, 0.0)))
    return report(f"Multistatic fix, per target, {count} receivers", "ours", rows)


def whole_grid() -> None:
    """The papers' setting: 70 x 70 targets, 100 trials, 3 receivers, late echoes."""
    net, noise, targets = polygon(3), Noise(np.full(3, RANGE_STD), np.full(3, BEARING_STD)), grid()
    drawn = noise.draw(np.random.default_rng(1), (len(targets), 100))
    ranges, bearings = (m[..., None] + e for m, e in zip(net.measure(targets), drawn, strict=True))
    print("## 70 x 70 targets x 100 trials, 3 receivers\n\n| method | s | mean RMSE m |\n|---|---|---|")
    for method in ("ls", "ml_range", "ml_range_bearing", "ml_exact"):
        begin = time.perf_counter()
        fixes = locate(net, ranges, bearings, noise, method)
        duration = time.perf_counter() - begin
        rmse = np.sqrt(np.square(fixes.positions - targets[:, None]).sum(axis=-1).mean(axis=1)).mean()
        print(f"| {method} | {duration:.2f} | {rmse:.1f} |")
    print()


def main() -> int:
    missed = [contest(count, 5.0) for count in GOALS]
    whole_grid()
    return max(missed)


if __name__ == "__main__":
    sys.exit(main())
