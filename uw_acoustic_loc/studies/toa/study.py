"""The buoy tracker in the setting of Choi 2025: figures of merit beside the paper's and the posterior bound."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...evaluation.tables import Sheet
from ..outcome import Outcome
from . import profile as toa_profile
from . import trials
from .result import SETTLED, Result

if TYPE_CHECKING:
    from ...evaluation.plot import Picture

TITLE = "Track of a target and the sound speed from times of arrival at buoys"
RUNS = 200
GATES = {"no gate": 1e6, "gate of 2 sigma": 2.0}  # of the filter as published
Results = Mapping[str, Result]  # by variant


def measure(runs: int, seed: int, progress: Callable[[float], None]) -> Outcome:
    """Numbers and tables; `progress` gets the share that is done."""
    results: dict[str, Result] = {}
    for name, variant in trials.VARIANTS.items():
        results[name] = trials.trial(variant, runs, seed, partial(_part, progress, len(results)))
    numbers = {name: result.numbers for name, result in results.items()}
    return Outcome(numbers, dict(_sheets(results, runs, seed)), _TEXT.format(runs=runs, seed=seed))


def pictures(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """Figures by file name; they show fifty runs with the same seed."""
    from .figures import draw  # noqa: PLC0415  matplotlib is slow to import

    return draw(seed)


def _part(progress: Callable[[float], None], done: int, share: float) -> None:
    progress((done + share) / len(trials.VARIANTS))


def _sheets(results: Results, runs: int, seed: int) -> Iterator[tuple[str, Sheet]]:
    yield "papers", _paper_sheet(results)
    rows = tuple(_row(trials.VARIANTS[name].label, result) for name, result in results.items())
    yield "variants", Sheet("Variants", _COLUMNS, rows)
    yield "published", _published_sheet(results, runs, seed)
    yield "profile", toa_profile.sheet()


def _row(label: str, result: Result) -> tuple[str, ...]:
    n, (horizontal, vertical) = result.numbers, result.split
    ratio = n["rmse_after_10_m"] / n["pcrb_after_10_m"]
    errors = (n["mean_m"], n["rmse_m"], n["rmse_after_10_m"], horizontal, vertical, n["pcrb_after_10_m"], ratio)
    return (
        label, *(f"{value:.2f}" for value in errors), f"{n['p95_max_m']:.1f}", f"{n['sound_speed_rmse']:.2f}",
        f"{n['nees_mean']:.2f} ± {result.nees_band:.2f}", f"{n['lost_runs']}",
    )  # fmt: skip


def _published_sheet(results: Results, runs: int, seed: int) -> Sheet:
    """The paper's filter on the same arrivals as the tracker."""
    rows = []
    for name, outliers in (("nominal", 0.0), ("outliers", 0.1)):
        label = trials.VARIANTS[name].label
        for gate, sigma in GATES.items():
            rows.append(_row(f"{label}: as published, {gate}", trials.published(outliers, sigma, runs, seed)))
        rows.append(_row(f"{label}: this tracker", results[name]))
    return Sheet("The filter as published, on the same arrivals", _COLUMNS, tuple(rows))


def _paper_sheet(results: Results) -> Sheet:
    """What the paper says in numbers, and the same here."""
    nominal = results["nominal"]
    means, below = nominal.distance.mean(axis=1), nominal.distance[:, SETTLED:] < 5.0
    low, high = np.percentile(means, [5, 95])
    direct = results["direct_only"]
    rows = (
        ("position error, mean of 50 steps (sec. 4.3)", "1.2 to 3.5 m",
         f"{means.mean():.1f} m; of single runs, 90 % from {low:.1f} to {high:.1f} m"),
        ("the same from direct arrivals alone", "-",
         f"{direct.numbers['mean_m']:.1f} m; depth {direct.split[1]:.1f} m RMSE after 10 steps"),
        ("position error below 5 m", "always", f"{100 * below.mean():.0f} % of the steps after the tenth"),
        ("sound speed error (sec. 4.3)", "1.5 m/s (1 sigma)", f"{nominal.numbers['sound_speed_rmse']:.2f} m/s"),
        ("time for 50 frames (sec. 4.3)", "below 1 s", "about 0.02 s (benchmarks/bench_toa.py)"),
    )  # fmt: skip
    return Sheet("Beside the paper", ("", "published", "here"), rows)


_COLUMNS = (
    "", "mean m", "RMSE m", "after 10 m", "horiz. m", "vert. m", "bound m", "/ bound", "95 % max m", "c m/s", "NEES/7",
    "lost",
)  # fmt: skip

_TEXT = """\
Four buoys at the corners of a square of 2 km; a target that starts at (500, 800) m, 60 m deep, with 1.2, 1.0 and
0.2 m/s (upwards), constant velocity plus 0.02 m/s² of random disturbance; 50 pings, one a second; 3 ms per arrival;
a sound speed of 1500 m/s that walks by 0.3 m/s per step within ± 2 m/s; direct arrivals and those over a flat seabed,
which the paper does not give, at 200 m. The prior is drawn from its own standard deviations: 10 m, 0.3 m/s (0.1
vertical) and 2 m/s; "50 m" stands for 50 m, 1 m/s and 2 m/s. Late outliers are late by an exponential time of mean
0.1 s. Unknown emissions lie up to 0.5 s after the stamp. `{runs}` runs, seed `{seed}`, the node's own tracker.

"after 10" is the RMSE after the tenth step, and so is its bound, the posterior Cramer-Rao bound (Tichavsky et al. 1998)
averaged over the true tracks, for arrivals that are all good. "95 % max" is the 95th percentile of each run's largest
error after the fifth step. A run is lost when an error after step 20 exceeds 30 m. The band of the NEES is that of its
mean over runs, 95 %.
"""
