"""A mooring's offset through impulsive noise: particle filter, Kalman filter with and without a gate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from ...evaluation.tables import Sheet
from ..outcome import Outcome
from . import trials
from .trials import Tracked

if TYPE_CHECKING:
    from ...evaluation.plot import Picture

TITLE = "A mooring's offset through impulsive noise"
RUNS = 1000
Found = Mapping[float, Mapping[str, Tracked]]  # by fraction of impulses, by filter


def measure(runs: int, seed: int, progress: Callable[[float], None]) -> Outcome:
    """Numbers and tables; `progress` gets the share that is done."""
    found: dict[float, dict[str, Tracked]] = {}
    shaken: dict[float, dict[str, Tracked]] = {}
    for fraction in trials.FRACTIONS:
        truth = trials.simulate(fraction, runs, seed)
        found[fraction] = {name: trials.track(name, fraction, truth, seed) for name in trials.FILTERS}
        shaken[fraction] = _shaken(fraction, runs, seed)
        progress(len(found) / len(trials.FRACTIONS))
    sheets = {"table2": _paper_sheet(found), "filters": _filter_sheet(found), "nees": _nees_sheet(found)}
    sheets["shaken"] = _shaken_sheet(shaken)
    return Outcome({"table": [_row(*item) for item in found.items()]}, sheets, _TEXT.format(runs=runs, seed=seed))


def pictures(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """Figures by file name; they show the numbers and single runs with the same seed."""
    from .figures import draw  # noqa: PLC0415  matplotlib is slow to import

    return draw(numbers, seed)


def _shaken(fraction: float, runs: int, seed: int) -> dict[str, Tracked]:
    """Filters, as they are and with a widened process, on moorings whose motion has impulses, too."""
    truth, wide = trials.simulate(fraction, runs, seed, shaken=True), trials.widened(fraction)
    found = {name: trials.track(name, fraction, truth, seed) for name in ("kf", "particle")}
    return found | {f"{name} wide": trials.track(name, fraction, truth, seed, wide) for name in ("kf", "particle")}


def _row(fraction: float, found: Mapping[str, Tracked]) -> dict[str, float]:
    kf, particle = found["kf"], found["particle"]
    return {
        "e": fraction,
        "kf_mean": kf.mean,
        "kf_std": kf.std,
        "particle_mean": particle.mean,
        "particle_std": particle.std,
        "reference_std": found["reference"].std,
        "kf_gated_std": found["kf_gated"].std,
    }


def _paper_sheet(found: Found) -> Sheet:
    columns = (
        "e", "EKF mean, paper", "here", "ODPF mean, paper", "here",
        "EKF std, paper", "here", "ODPF std, paper", "here", "EKF / ODPF std, paper", "here",
    )  # fmt: skip
    return Sheet("Table 2 of Lee et al.: errors in m", columns, tuple(_paper_row(*item) for item in found.items()))


def _paper_row(fraction: float, found: Mapping[str, Tracked]) -> tuple[str, ...]:
    kf, particle = found["kf"], found["particle"]
    here = (kf.mean, particle.mean, kf.std, particle.std)
    pairs = [f"{x:.3f}" for pair in zip(trials.PAPER[fraction], here, strict=True) for x in pair]
    paper_ratio = trials.PAPER[fraction][2] / trials.PAPER[fraction][3]
    return f"{fraction:g}", *pairs, f"{paper_ratio:.1f}", f"{kf.std / particle.std:.2f}"


def _filter_sheet(found: Found) -> Sheet:
    columns = ("e", *_NAMES.values(), "particle / reference", "particle / Kalman")
    return Sheet("Standard deviation of the error in m", columns, tuple(_filter_row(*item) for item in found.items()))


def _filter_row(fraction: float, found: Mapping[str, Tracked]) -> tuple[str, ...]:
    std = {name: found[name].std for name in _NAMES}
    ratios = (std["particle"] / std["reference"], std["particle"] / std["kf"])
    return f"{fraction:g}", *(f"{x:.3f}" for x in (*std.values(), *ratios))


def _nees_sheet(found: Found) -> Sheet:
    rows = ((f"{e:g}", *(f"{by_name[name].nees:.2f}" for name in _NAMES)) for e, by_name in found.items())
    return Sheet("Squared error over the filter's own variance: 1 is honest", ("e", *_NAMES.values()), tuple(rows))


def _shaken_sheet(found: Found) -> Sheet:
    names = {"kf": "Kalman", "particle": "100 particles", "kf wide": "Kalman, widened"}
    names["particle wide"] = "100 particles, widened"
    columns = ("e", "widened to", *(column for name in names.values() for column in (f"{name}: std", "NEES")))
    rows = (
        (f"{e:g}", f"{trials.widened(e):.2f}", *(cell for name in names for cell in _std_and_nees(by_name[name])))
        for e, by_name in found.items()
    )
    return Sheet("Impulses in the motion, too: standard deviation of the error in m, and NEES", columns, tuple(rows))


def _std_and_nees(tracked: Tracked) -> tuple[str, str]:
    return f"{tracked.std:.3f}", f"{tracked.nees:.2f}"


_NAMES = {
    "kf": "Kalman",
    "kf_gated": "Kalman, 3-sigma gate",
    "particle": "100 particles",
    "learnt": "100 particles, noise learnt",
    "reference": "5000 particles",
}
_TEXT = """\
A mass-damper-spring system (1 kg, 0.5 N s/m, 1 N/m, 0.5 N) is released at 2 m and measured every 0.5 s for 10 s. In
each step it moves by 0.05 m at random. Measurements have Gaussian noise of 0.5 m; with probability `e` an alpha-stable
impulse stands in its place, of table 1 of the paper in units of 0.5 m: alpha 1.8, beta 1, scale 10, location -3 (S1).
The filters are the node's with its defaults: they begin with an offset of 0 +- 2 m and a velocity of 0 +- 1 m/s.
`{runs}` runs for each `e`, seed `{seed}`.

Errors are those of all runs together from 2 s on, when the paper finds its filter at the truth. The paper's figures
are those of one run each. Its f, g, u and process noise are not known, so only the pattern can be compared.

In the last table impulses stand in the place of the random steps, too, as the paper has it: with probability `e`, in
units of 0.05 m. The filters' process is Gaussian; widened, it has the variance of such steps with alpha = 2.

An alpha-stable error has no variance. The Kalman filter's error is a sum of such, so its standard deviation is that of
this set of runs: it grows with their number and scatters by about a third from seed to seed. The other columns scatter
by 2 %.
"""
