"""Pictures of the bearing node's results: errors by SNR and filter, bearings over time and along a quay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.ticker import FormatStrFormatter

from ...evaluation.plot import BLUE, GREEN, ORANGE, RAW, RED, TRUTH, Picture, canvas, legend_below, picture, style
from . import inside, trials
from .trials import MultipathChannel

LOOK = {"none": (RAW, "no filter"), "particle": (BLUE, "particle filter"), "histogram": (ORANGE, "histogram filter")}

_WIDTHS = {"particle": 2.4, "histogram": 0.9}  # one shows below the other


def draw(numbers: Mapping[str, Any], seed: int) -> Iterator[tuple[str, Picture]]:
    """All figures by file name."""
    with style():
        yield "extraction", inside.extraction()
        yield "gcc", inside.correlations(seed)
        yield "cloud", inside.clouds(seed)
        yield "posterior", inside.posteriors(seed)
        yield "positions", _positions(seed)
        yield "course", _courses(seed)
        yield "crlb", _bound(numbers["crlb"])
        yield "gross", _gross(numbers["multipath"])


def _positions(seed: int) -> Picture:
    x, y = trials.map_positions()
    truth = np.degrees(np.arctan2(y, x))
    figure, axes = canvas(1, 2, 3.3)
    both, error = axes[0]
    number = np.arange(1, trials.POSITIONS + 1)
    both.plot(number, truth, color=TRUTH, linewidth=1.8, label="map bearing")
    for name, shift in (("none", -0.15), ("particle", 0.15)):
        mean, std = np.degrees(trials.position_bearings(name, seed)).T
        colour, label = LOOK[name]
        bars = {"fmt": "o", "markersize": 3, "capsize": 2, "linewidth": 0.9, "color": colour, "label": label}
        both.errorbar(number + shift, mean, std, **bars)
        if name != "none":
            error.errorbar(number, mean - truth, std, **bars)
    error.axhline(0.0, color=TRUTH, linewidth=0.8)
    both.set_ylabel("bearing from the array's axis (°)")
    error.set_ylabel("estimate - map (°)")
    for axis in (both, error):
        axis.set_xlabel("position, 1.5 m apart")
        axis.set_xticks(number[::4])
    legend_below(figure, both)
    caption = (
        "Mean and standard deviation at each of 21 source positions on a line 41.2 m abeam, from right to left, "
        "against the bearing from the map (Shin et al. 2013, fig. 15); on the right the error with the filter. Channel "
        f"with echoes and snaps, 20 to 30 kHz at 0 dB, {trials.POSITION_PINGS} pings, the filter restarted at each "
        f"position and the first {trials.SETTLING:g} s left out. The map knows azimuths; the array measures "
        "the angle from its axis, at the ends 0.27 degrees nearer to broadside because the source lies deeper, and the "
        "echoes, which come more steeply, pull the same way."
    )
    return picture("Bearings at 21 positions", caption, figure)


def _courses(seed: int) -> Picture:
    figure, axes = canvas(1, 2, 3.3, sharey=True)
    for axis, case in zip(axes[0], trials.CASES, strict=True):
        _course(axis, case, seed)
    axes[0, 0].set_ylabel("bearing (°)")
    legend_below(figure, axes[0, 0])
    caption = (
        "The first run of each multipath channel: the maxima of the correlation alone jump between carrier cycles and "
        "echoes; the filters settle after a few pings, and only several misleading pings in a row carry them off. They "
        "have no odometry."
    )
    return picture("Bearings over time", caption, figure)


def _course(axis: Any, case: MultipathChannel, seed: int) -> None:
    course, heard = trials.one_course(case, 0, seed)
    axis.plot(trials.FRAME_NS * 1e-9 * np.arange(course.size), np.degrees(course), color=TRUTH, lw=3, alpha=0.3)
    axis.plot([], [], color=TRUTH, lw=3, alpha=0.3, label="truth")
    for name, (colour, label) in LOOK.items():
        time, bearing = np.array([(h.time, h.bearing) for h in heard if h.filter == name]).T
        look = {"linestyle": "", "marker": ".", "markersize": 3} if name == "none" else {"linewidth": _WIDTHS[name]}
        axis.plot(time, np.degrees(bearing), color=colour, label=label, **look)
    axis.set_title(_title(case))
    axis.set_xlabel("time (s)")
    axis.set_ylim(0.0, 180.0)
    axis.set_yticks(np.arange(0, 181, 30))


def _bound(rows: list[dict[str, float]]) -> Picture:
    figure, axes = canvas(1, 1, 3.8)
    axis = axes[0, 0]
    fine = np.linspace(-2.0, 32.0, 69)
    bounds = np.degrees([trials.bearing_bounds(trials.clean_scene(), snr) for snr in fine]).T
    axis.plot(fine, bounds[0], color=TRUTH, label="Cramer-Rao bound, waveform unknown")
    axis.plot(fine, bounds[1], color=TRUTH, linestyle=":", label="waveform known")
    snr = [row["snr_db"] for row in rows]
    axis.plot(snr, [row["rmse_deg"] for row in rows], "o", color=RED, markersize=6, label="RMSE")
    axis.plot(snr, [row["robust_deg"] for row in rows], "x", color=GREEN, markersize=7, label="robust spread")
    _log_degrees(axis)
    axis.set_xlabel("SNR in the band, over the ping (dB)")
    axis.set_ylabel("error of the bearing (°)")
    legend_below(figure, axis)
    caption = (
        "Single pings in the clean channel, chirp of 10 ms from 20 to 30 kHz, near broadside. At 0 dB some pings end "
        "on a neighbouring carrier cycle, 6 degrees away: that is the RMSE there."
    )
    return picture("Error of a single ping against the Cramer-Rao bound", caption, figure)


def _gross(rows: list[dict[str, Any]]) -> Picture:
    figure, axes = canvas(1, 2, 3.1)
    for axis, key, unit, scale in (
        (axes[0, 0], "gross_fraction", "errors over 5° (%)", 100.0),
        (axes[0, 1], "median_deg", "median error (°)", 1.0),
    ):
        for k, name in enumerate(LOOK):
            _bars(axis, k, [scale * row[key] for row in rows if row["filter"] == name], *LOOK[name])
        axis.set_xticks(range(len(trials.CASES)), [_title(case) for case in trials.CASES])
        axis.set_ylabel(unit)
        axis.grid(visible=False, axis="x")
    legend_below(figure, axes[0, 0])
    caption = "Multipath: all bearings of all runs, from the first ping on, the same pings for every filter."
    return picture("Errors in multipath by filter", caption, figure)


def _bars(axis: Any, k: int, values: list[float], colour: str, label: str) -> None:
    drawn = axis.bar(np.arange(len(values)) + 0.27 * (k - 1), values, 0.25, color=colour, label=label)
    axis.bar_label(drawn, [f"{value:.2f}" for value in values], padding=2, fontsize=8, color="#444444")


def _title(case: MultipathChannel) -> str:
    low, high = (f / 1e3 for f in case.band)
    return f"{low:g} to {high:g} kHz, {case.snr_db:g} dB{', snaps' if case.impulses else ''}"


def _log_degrees(axis: Any) -> None:
    axis.set_yscale("log")
    axis.set_yticks([0.003, 0.01, 0.03, 0.1, 0.3, 1.0])
    axis.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.minorticks_off()
