"""LS and the ML methods of a multistatic sonar net over a grid of targets, against the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ...core.multistatic.estimator import METHODS
from ...evaluation.tables import Sheet
from ..outcome import Outcome
from . import trials
from .trials import BIASED, PRINTED, MethodErrors, Setting

if TYPE_CHECKING:
    from ...evaluation.plot import Picture

TITLE = "Targets of a multistatic sonar net"
RUNS = 100
SECTIONS = {"noise": trials.NOISES, "receivers": trials.BY_COUNT, "distance": trials.BY_DISTANCE}
Found = Mapping[Setting, MethodErrors]


def measure(runs: int, seed: int, progress: Callable[[float], None]) -> Outcome:
    """Numbers and tables; `progress` gets the share that is done."""
    settings = list(dict.fromkeys(setting for section in SECTIONS.values() for setting in section))
    found: dict[Setting, MethodErrors] = {}
    for setting in settings:
        methods = (*METHODS, BIASED, PRINTED) if setting in trials.BY_COUNT else METHODS
        found[setting] = trials.errors(setting, trials.grid(), runs, seed, methods)
        progress(0.9 * sum(s.receivers for s in found) / sum(s.receivers for s in settings))
    placed = _placements(runs, seed, lambda share: progress(0.9 + 0.1 * share))
    numbers = {name: [_row(setting, found[setting]) for setting in part] for name, part in SECTIONS.items()}
    return Outcome(numbers, dict(_sheets(found, placed)), _TEXT.format(runs=runs, seed=seed))


def pictures(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """Figures by file name; maps, cuts and the far net are run again with the same seed."""
    from .figures import draw  # noqa: PLC0415  matplotlib is slow to import

    return draw(numbers, seed)


def _placements(runs: int, seed: int, progress: Callable[[float], None]) -> dict[Setting, MethodErrors]:
    """ml_range_bearing alone, for every number of receivers and every distance, at every fifth row and column."""
    found, targets = {}, trials.square(trials.grid_axis()[2::5])
    for k, setting in enumerate(trials.PLACEMENTS):
        found[setting] = trials.errors(setting, targets, runs, seed, ("ml_range_bearing",))
        progress((k + 1) / len(trials.PLACEMENTS))
    return found


def _row(setting: Setting, found: MethodErrors) -> dict[str, float]:
    """A row of the JSON; m and rad."""
    return {
        "receivers": setting.receivers,
        "distance_m": setting.distance,
        "range_std": setting.range_std,
        "bearing_std": setting.bearing_std,
        "crlb": float(found.bound.mean()),
        **{method: found.mean[method] for method in METHODS},
        "worst_cell_ratio": found.worst,
    }


def _sheets(found: Found, placed: Found) -> Iterator[tuple[str, Sheet]]:
    yield "noise", _error_sheet("Table 2: mean RMSE in m by noise", trials.NOISES, found)
    yield "receivers", _error_sheet("Figure 5 (a): mean RMSE in m by number of receivers", trials.BY_COUNT, found)
    yield "distance", _error_sheet("Figure 4: mean RMSE in m by distance", trials.BY_DISTANCE, found)
    yield "bias", _bias_sheet(found)
    yield "placement", _placement_sheet(placed)
    yield "paper", _paper_sheet(found)


def _error_sheet(title: str, settings: Sequence[Setting], found: Found) -> Sheet:
    columns = (
        "receivers", "distance km", "range std m", "bearing std rad", "bound", *METHODS, "ML / bound", "worst cell",
    )  # fmt: skip
    return Sheet(title, columns, tuple(_error_row(setting, found[setting]) for setting in settings))


def _error_row(setting: Setting, e: MethodErrors) -> tuple[str, ...]:
    bound = float(e.bound.mean())
    means = (f"{x:.1f}" for x in (bound, *(e.mean[method] for method in METHODS)))
    return (
        *_named(setting), f"{setting.range_std:g}", f"{setting.bearing_std:g}", *means,
        f"{e.mean['ml_range_bearing'] / bound:.3f}", f"{e.worst:.2f}",
    )  # fmt: skip


def _named(setting: Setting) -> tuple[str, str]:
    return str(setting.receivers), f"{setting.distance / 1e3:g}"


def _bias_sheet(found: Found) -> Sheet:
    """What the mean of the Rayleigh error does when it is left in."""
    rows = tuple(
        (*_named(s), *(f"{x:.1f}" for x in (e.bound.mean(), *(e.mean[name] for name in _BIAS))))
        for s, e in ((s, found[s]) for s in trials.BY_COUNT)
    )
    columns = ("receivers", "distance km", "bound", *_BIAS.values())
    return Sheet("Why more receivers did not help: mean RMSE in m", columns, rows)


_BIAS = {
    "ls": "ls",
    BIASED: "ML, bias left in",
    PRINTED: "ML, sqrt(N - 1) sigma removed",
    "ml_range_bearing": "ML, bias removed",
}


def _placement_sheet(placed: Found) -> Sheet:
    columns = ("receivers", *(f"{distance / 1e3:g} km" for distance in trials.DISTANCES))
    rows = tuple(
        (str(count), *(_reached(placed[Setting(receivers=count, distance=d)]) for d in trials.DISTANCES))
        for count in trials.COUNTS
    )
    title = "Placement: mean RMSE of ml_range_bearing in m (bound), by receivers and their distance, 40 m and 0.02 rad"
    return Sheet(title, columns, rows)


def _reached(e: MethodErrors) -> str:
    return f"{e.mean['ml_range_bearing']:.1f} ({e.bound.mean():.1f})"


def _paper_sheet(found: Found) -> Sheet:
    """What the paper says, in words where its numbers are not to be had, and the same here."""
    rows = (
        ("table 2", "ML_proposed best in all 9 cells, numbers not legible", _best(found, trials.NOISES)),
        ("table 2", "with bearing noise, ML_proposed comes near ML_dist", _approach(found)),
        ("figure 4", "from 1 to 5 km LS rises, ML_dist and ML_proposed fall", _ends(found, trials.BY_DISTANCE[:5])),
        ("figure 5 (a)", "LS falls all along; ML stands still or gets worse from 7 receivers on, LS is best from 9 on",
         _ends(found, trials.BY_COUNT)),
        ("figure 5 (c)", "at 6 km LS with 200 receivers is worse than ML_proposed with 5", "see the figure"),
    )  # fmt: skip
    return Sheet("Beside the paper", ("", "published", "here"), rows)


def _best(found: Found, settings: Sequence[Setting]) -> str:
    """Where ml_range_bearing is ahead of both others."""
    ahead = sum(
        found[s].mean["ml_range_bearing"] < min(found[s].mean["ls"], found[s].mean["ml_range"]) for s in settings
    )
    return f"best of the three in {ahead} of {len(settings)}"


def _approach(found: Found) -> str:
    """ml_range over ml_range_bearing, as the bearing's noise grows."""
    means = [(s.bearing_std, found[s].mean) for s in trials.NOISES if s.range_std == trials.RANGE_STDS[1]]
    shares = ", ".join(f"{mean['ml_range'] / mean['ml_range_bearing']:.2f} at {std:g} rad" for std, mean in means)
    return f"ml_range / ml_range_bearing {shares}"


def _ends(found: Found, settings: Sequence[Setting]) -> str:
    first, last = found[settings[0]].mean, found[settings[-1]].mean
    return ", ".join(
        f"{name} {first[name]:.0f} to {last[name]:.0f} m" for name in ("ls", "ml_range", "ml_range_bearing")
    )


_TEXT = """\
One transmitter in the middle, receivers on a regular polygon around it, a target at every point of a grid of 144 m
within 5 km (70 x 70), `{runs}` trials each, seed `{seed}`. Every receiver measures the range sum, late by a Rayleigh
error of the given standard deviation, and the bearing with Gaussian noise. All methods but `ml_exact` take the mean of
the Rayleigh error, 1.913 standard deviations, from the range sums; `ml_exact` uses the density. The bound is the
Cramer-Rao bound for Gaussian errors of the same standard deviation. RMSE is per target over the trials, then averaged
over the grid (in the placement table, over every fifth row and column of it); the worst cell is the target with the
largest RMSE of `ml_range_bearing` over its own bound.

`ls` is the paper's LS, `ml_range` its ML_dist, `ml_range_bearing` its ML_proposed. Unless a table says otherwise, range
sums have 40 m and bearings 0.02 rad.
"""
