"""Shin et al.'s simulation and sea trial: where a source is, from bearings and known motion, by each method."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...evaluation.tables import Sheet
from ..outcome import Outcome
from . import trials

if TYPE_CHECKING:
    from ...evaluation.plot import Picture

TITLE = "Position of a source from bearings and known motion"
RUNS = 500
NAMES = {
    "triangulation": "triangulation of two lines (eq. 1-2)",
    "ekf": "EKF in x and y from (50, 50) m (eq. 3-12)",
    "particle_filter": "particle filter, uniform likelihood",
    "bayes_grid": "exact Bayesian answer on a grid",
    "ekf_repeated_reference": "EKF in x and y, the first bearing taken again at each sample (eq. 6, 8)",
    "ekf_drawn_start": "EKF in x and y, start drawn from the particle filter's prior",
    "ekf_log_polar": "our EKF (log-polar) from (50, 50) m",
    "ekf_bank": "our EKF bank, from the first bearing",
    "least_squares": "our triangulation, least squares of all lines",
    "particle_filter_gaussian": "particle filter, Gaussian likelihood",
}
_SHOWN = (5, 10, 15, 20)


def measure(runs: int, seed: int, progress: Callable[[float], None]) -> Outcome:
    """Numbers and tables; `progress` gets the share that is done."""
    numbers: dict[str, dict[str, Any]] = {}
    for key, course in trials.COURSES.items():
        numbers[key] = {}
        for name, points in trials.answers(key, course, runs, seed):
            numbers[key][name] = _errors(np.abs(points - course.source))
            progress((len(numbers) - 1 + len(numbers[key]) / len(NAMES)) / len(trials.COURSES))
    sheets = {key: _sheet(trials.COURSES[key].title, numbers[key]) for key in numbers}
    return Outcome(numbers, sheets, _TEXT.format(runs=runs, seed=seed))


def pictures(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """Figures by file name; they show the numbers and single runs with the same seed."""
    from .figures import draw  # noqa: PLC0415  matplotlib is slow to import

    return draw(numbers, seed)


def _errors(distances: Any) -> dict[str, list[float]]:
    """Over runs (runs, SAMPLES)."""
    rmse, median = np.sqrt(np.square(distances).mean(axis=0)), np.median(distances, axis=0)
    return {"rmse_m": rmse.tolist(), "median_m": median.tolist()}


def _sheet(title: str, found: Mapping[str, Mapping[str, list[float]]]) -> Sheet:
    columns = ("", *(f"{kind} at {k}, m" for kind in ("RMSE", "median") for k in _SHOWN))
    rows = tuple(
        (label, *(f"{found[name][key][k]:.1f}" for key in ("rmse_m", "median_m") for k in _SHOWN))
        for name, label in NAMES.items()
    )
    return Sheet(title, columns, rows)


_TEXT = """\
A source at (10, 53) m moves 1 m to the left per sample past a vehicle at (0, 0), 21 samples, numbered from 0; bearing
errors are uniform within 10 degrees (Shin et al. 2013, IV.1). The second geometry is that of their sea trial: 21
positions 1.5 m apart, seen from 70 to 110 degrees, hence 41.2 m abeam; the recorded bearings are not published, so the
errors are the simulation's. `{runs}` runs, seed `{seed}`, the same bearings for every method.

Particle filter (2000 particles), grid and bank know that the source lies 1 to 140 m away along the first bearing: the
first two uniform in area, the bank uniform in log range. The paper's EKF begins at (50, 50) m, to which we give a
spread of 50 m per axis; the paper gives none. Two lines have no answer at sample 0; the prior's mean stands for it. The
RMSE of two lines is that of a ratio whose denominator passes zero: it has no limit, only the median means something.

Particle filter and grid give the point of least relative error: while the range is open, the mean would lie where the
prior has its area, towards 140 m. The guess (50, 50) is 70 m away from the source, in nearly the right direction; the
row with starts drawn from the particle filter's prior shows what that is worth.
"""
