"""Bearing-only SLAM in the setting of Choi, Lee, Choi 2016: their table 1 and figures 7 to 10, and how honest it is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...evaluation.tables import Sheet
from ..outcome import Outcome
from . import trials
from .trials import End, NoiseCase

if TYPE_CHECKING:
    from ...evaluation.plot import Picture

TITLE = "Vehicle and pingers from bearings, IMU and Doppler log"
RUNS = 100
PUBLISHED = {"s1": 0.59, "s2": 0.28, "s3": 0.54}  # m, Choi et al., table 1: one run at sea


def measure(runs: int, seed: int, progress: Callable[[float], None]) -> Outcome:
    """Numbers and tables; `progress` gets the share that is done."""
    fewer = -(-runs // 4)
    shares = _Shares(progress, runs + 2 * fewer)
    white = trials.ends(trials.WHITE, runs, seed, shares.next(runs))
    ignored = trials.ends(trials.IGNORED, fewer, seed, shares.next(fewer))
    handled = trials.ends(trials.HANDLED, fewer, seed, shares.next(fewer))
    tables = {
        "table1": _pinger_sheet(white),
        "vehicle": _vehicle_sheet(white),
        "correlated": _correlated_sheet({trials.WHITE: white, trials.IGNORED: ignored, trials.HANDLED: handled}),
    }
    return Outcome(_numbers(white), tables, _TEXT.format(runs=runs, fewer=fewer, seed=seed))


def pictures(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """Figures by file name; they show the first run of the same seed."""
    from .figures import draw  # noqa: PLC0415  matplotlib is slow to import

    return draw(numbers, seed)


class _Shares:
    """Splits the progress among parts of known length."""

    def __init__(self, progress: Callable[[float], None], total: int) -> None:
        self._progress, self._total, self._done = progress, total, 0

    def next(self, runs: int) -> Callable[[float], None]:
        begin, self._done = self._done, self._done + runs
        return lambda share: self._progress((begin + share * runs) / self._total)


def _numbers(found: Sequence[End]) -> dict[str, Any]:
    sources = {}
    for name in trials.PLACES:
        distances = [e.distance[name] for e in found]
        median, p90 = np.percentile(distances, (50, 90)).tolist()
        sources[name] = {"median_m": median, "p90_m": p90, **_honesty(found, (name,))}
    vehicle = {
        "rmse_median_m": float(np.median([e.rmse for e in found])),
        "dead_reckoning_final_median_m": float(np.median([e.drift for e in found])),
        **_honesty(found, ("vehicle",)),
    }
    return {"runs": len(found), "sources": sources, "vehicle": vehicle}


def _honesty(found: Sequence[End], names: Iterable[str]) -> dict[str, float]:
    """NEES per dimension: its mean, and that of the worst run; empty when nothing was found."""
    nees = [e.nees[name] for name in names for e in found if name in e.nees]
    return {"nees_mean": float(np.mean(nees)), "nees_max": max(nees)} if nees else {}


def _pinger_sheet(found: Sequence[End]) -> Sheet:
    columns = (
        "pinger", "true m", "estimated, mean m", "published error m", "median error m", "90 % m", "NEES/dim",
        "worst run", "found %",
    )  # fmt: skip
    numbers = _numbers(found)["sources"]
    return Sheet("Pingers at the end of the run", columns, tuple(_pinger_row(n, found, numbers[n]) for n in numbers))


def _pinger_row(name: str, found: Sequence[End], numbers: Mapping[str, float]) -> tuple[str, ...]:
    places = np.array([e.place[name] for e in found if name in e.place])
    where = "({:.2f}, {:.2f})"
    mean = where.format(*places.mean(axis=0)) if len(places) else "-"
    errors, share = _spread([e.distance[name] for e in found]), f"{100 * len(places) / len(found):.0f}"
    return name, where.format(*trials.PLACES[name]), mean, f"{PUBLISHED[name]:.2f}", *errors, *_shown(numbers), share


def _vehicle_sheet(found: Sequence[End]) -> Sheet:
    columns = ("", "median m", "90 % m", "NEES/dim at the end", "worst run")
    rows = (
        ("SLAM, RMSE of the run", *_spread([e.rmse for e in found]), *_shown(_honesty(found, ("vehicle",)))),
        ("dead reckoning, error at the end", *_spread([e.drift for e in found]), "", ""),
    )
    return Sheet("Vehicle", columns, rows)


def _correlated_sheet(found: Mapping[NoiseCase, Sequence[End]]) -> Sheet:
    columns = (
        "errors", "assumed by the filter", "runs", "pingers, median m", "90 % m", "NEES/dim of the pingers",
        "worst run", "vehicle, RMSE m", "NEES/dim of the vehicle",
    )  # fmt: skip
    return Sheet("Correlated bearings", columns, tuple(_correlated_row(*item) for item in found.items()))


def _correlated_row(case: NoiseCase, found: Sequence[End]) -> tuple[str, ...]:
    distances = [d for e in found for d in e.distance.values()]
    return (
        f"{case.correlation:g} at 10 Hz" if case.correlation else "white",
        f"{case.assumed:.2f} s" if case.assumed else "white",
        str(len(found)), *_spread(distances), *_shown(_honesty(found, trials.PLACES)),
        f"{np.median([e.rmse for e in found]):.2f}", _shown(_honesty(found, ("vehicle",)))[0],
    )  # fmt: skip


def _shown(honesty: Mapping[str, float]) -> tuple[str, str]:
    mean, worst = (f"{honesty[key]:.2f}" if key in honesty else "-" for key in ("nees_mean", "nees_max"))
    return mean, worst


def _spread(values: Sequence[float]) -> tuple[str, str]:
    median, p90 = np.percentile(values, (50, 90))
    return f"{median:.2f}", f"{p90:.2f}"


_TEXT = """\
The setting of Choi, Lee, Choi 2016, section 4: IMU at 100 Hz (0.1 m/s², 0.01 rad/s), Doppler log at 5 Hz (0.005 m/s),
bearings at 10 Hz of three pingers, from the upper left to the lower right and back in 195 s. Bearing errors are white,
5 degrees (their filter assumed 15). Each run draws constant biases: 0.002 rad/s of the gyro, 0.005 m/s of each axis
of the log. The row of their third pinger repeats the first; ours lies at (8, 16). `{runs}` runs, seed `{seed}`.

NEES is the squared error normalised by the filter's own covariance, per dimension: 1 on average when it is honest. The
table of correlated bearings has `{fewer}` runs per row of correlated errors, as a bearing filter's output has them:
ignored, and with their correlation time assumed.
"""
