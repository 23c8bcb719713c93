"""The bearing node against the Cramer-Rao bound, and in multipath with each of its filters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ...evaluation.tables import Sheet
from ..outcome import Outcome
from . import trials
from .trials import BearingErrors, MultipathChannel

if TYPE_CHECKING:
    from ...evaluation.plot import Picture

TITLE = "Bearing of a pinger from two hydrophones"
RUNS = 8
Clean = Mapping[float, BearingErrors]  # by SNR in dB
Echoes = Mapping[MultipathChannel, Mapping[str, BearingErrors]]  # by filter


def measure(runs: int, seed: int, progress: Callable[[float], None]) -> Outcome:
    """Numbers and tables; `progress` gets the share that is done."""
    clean: dict[float, BearingErrors] = {}
    echoes: dict[MultipathChannel, dict[str, BearingErrors]] = {}
    for snr_db in trials.SNRS_DB:
        clean[snr_db] = trials.clean_errors(snr_db, runs, seed)
        progress(0.05 * len(clean))
    for case in trials.CASES:
        echoes[case] = trials.echo_errors(case, runs, seed, partial(_part, progress, len(echoes)))
    return Outcome(_numbers(clean, echoes), dict(_sheets(clean, echoes, seed)), _TEXT.format(runs=runs, seed=seed))


def pictures(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """Figures by file name; they show the numbers and single runs with the same seed."""
    from .figures import draw  # noqa: PLC0415  matplotlib is slow to import

    return draw(numbers, seed)


def _part(progress: Callable[[float], None], done: int, share: float) -> None:
    progress(0.2 + 0.8 * (done + share) / len(trials.CASES))


def _numbers(clean: Clean, echoes: Echoes) -> dict[str, Any]:
    crlb = [
        {"snr_db": snr, "rmse_deg": e.rmse_deg, "robust_deg": e.robust_deg, "crlb_deg": _bounds_deg(snr)[0]}
        for snr, e in clean.items()
    ]
    multipath = [
        {"band_hz": list(case.band), "filter": name, "gross_fraction": e.gross_fraction, "median_deg": e.median_deg}
        for case, by_filter in echoes.items()
        for name, e in by_filter.items()
    ]
    return {"crlb": crlb, "multipath": multipath}


def _bounds_deg(snr_db: float) -> tuple[float, float]:
    unknown, known = trials.bearing_bounds(trials.clean_scene(), snr_db)
    return math.degrees(unknown), math.degrees(known)


def _sheets(clean: Clean, echoes: Echoes, seed: int) -> Iterator[tuple[str, Sheet]]:
    yield "crlb", _clean_sheet(clean)
    yield "multipath", _echo_sheet(echoes)
    yield "papers", _paper_sheet(clean, echoes, seed)


def _clean_sheet(clean: Clean) -> Sheet:
    columns = (
        "SNR dB", "pings", "heard %", "RMSE °", "robust °", "bound °", "RMSE / bound", "robust / bound",
        "bound, waveform known °",
    )  # fmt: skip
    return Sheet("Clean channel, 20 to 30 kHz, no filter", columns, tuple(_clean_row(*item) for item in clean.items()))


def _clean_row(snr_db: float, e: BearingErrors) -> tuple[str, ...]:
    bound, known = _bounds_deg(snr_db)
    shown = (e.rmse_deg, e.robust_deg, bound)
    ratios = (f"{e.rmse_deg / bound:.2f}", f"{e.robust_deg / bound:.2f}")
    return (
        f"{snr_db:g}", str(e.pings), f"{100 * e.heard:.1f}", *(f"{x:.4f}" for x in shown), *ratios, f"{known:.4f}",
    )  # fmt: skip


def _echo_sheet(echoes: Echoes) -> Sheet:
    columns = (
        "band kHz",
        "SNR dB",
        "snaps",
        "filter",
        "pings",
        "heard %",
        "over 5° %",
        "median °",
        "within 2 sigma %",
    )
    rows = (_echo_row(case, name, e) for case, by_filter in echoes.items() for name, e in by_filter.items())
    return Sheet("Multipath, 35 to 145 degrees at 3 degrees per second", columns, tuple(rows))


def _echo_row(case: MultipathChannel, name: str, e: BearingErrors) -> tuple[str, ...]:
    low, high = (f"{f / 1e3:g}" for f in case.band)
    shares = (f"{100 * e.heard:.1f}", f"{100 * e.gross_fraction:.2f}", f"{e.median_deg:.2f}")
    snaps = "yes" if case.impulses else "no"
    return (
        f"{low}-{high}", f"{case.snr_db:g}", snaps, name, str(e.pings), *shares, f"{100 * e.within_2_sigma:.1f}",
    )  # fmt: skip


def _paper_sheet(clean: Clean, echoes: Echoes, seed: int) -> Sheet:
    """What the papers say in numbers, and the same here."""
    spread, bias = _positions_deg(seed)
    medians = [by_filter["particle"].median_deg for by_filter in echoes.values()]
    fine = clean[max(clean)].rmse_deg
    rows = (
        ("bearings at 21 positions (Shin et al., fig. 15)", "70 to 110°, in a graph only",
         f"70 to 110°; mean off by {bias:.2f}°, standard deviation {spread:.2f}°"),
        ("error of a bearing", "uniform within 10° in simulation (Shin et al., IV.1); 15° standard deviation "
         "taken for SLAM at sea (Choi et al., 4)", f"median {min(medians):.2f} to {max(medians):.2f}° in multipath"),
        ("step of the TDOA", "one sample of 10 µs (Choi et al., 4): 1.4° at broadside for 0.6 m",
         f"none; {fine:.4f}° at {max(clean):g} dB"),
    )  # fmt: skip
    return Sheet("Beside the papers", ("", "published", "here"), rows)


def _positions_deg(seed: int) -> tuple[float, float]:
    """Mean over the positions of the standard deviation, and of the absolute error of the mean."""
    mean, std = np.degrees(trials.position_bearings("particle", seed)).T
    x, y = trials.map_positions()
    return float(std.mean()), float(np.abs(mean - np.degrees(np.arctan2(y, x))).mean())


_TEXT = """\
Two hydrophones 0.6 m apart at 100 kHz hear a pinger's chirp of 10 ms ten times a second. Errors are against the angle
that the true TDOA stands for. SNR is that of the direct path over the ping, in the band. `{runs}` runs, seed `{seed}`.

The clean channel has one path and white noise; the source lies 85 to 95 degrees from the array's axis; every ping
stands alone. The bound is the Cramer-Rao bound for an unknown waveform, computed from the spectrum of the very chirp.
At 0 dB some pings end on a neighbouring carrier cycle, which the robust spread (1.4826 x median absolute deviation)
leaves out.

The multipath channel is 20 m deep; the array lies 5 m and the source 12 m below the surface, 60 m apart over ground;
surface and seabed reflect once each, with -0.7 and 0.4. Impulsive noise is that of snapping shrimp, 100 snaps per
second with alpha-stable amplitudes. The source moves to and fro at 3 degrees per second. Gross errors are counted over
all bearings that are published, from the first ping on; the filters have no odometry. Filter `none` is the maximum of
the correlation alone; like the others it gets its samples with the loudest of the snaps cut down.
"""
