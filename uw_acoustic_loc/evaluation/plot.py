"""The look of the report's pictures: colours, axes, error bands, ellipses; a picture ends as PNG."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Ellipse

from ..core.types import AnyArray, Array

# Okabe and Ito 2008: distinct for colour-blind readers too
TRUTH, RAW = "#222222", "#8c8c8c"
BLUE, ORANGE, GREEN, RED, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
CYCLE = (BLUE, RED, GREEN, PURPLE, ORANGE, SKY)

WIDTH = 9.6  # inch
_DPI = 125
_STYLE: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#777777",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
}


@dataclass(frozen=True)
class Picture:
    """A figure of the report."""

    title: str
    caption: str
    png: bytes


def style() -> Any:
    """Returns the context in which pictures are drawn."""
    return mpl.rc_context(_STYLE)


def canvas(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, AnyArray]:
    """Makes a figure with axes (rows, columns); `height` is a row's, in inch."""
    layout = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.06)
    figure = Figure(figsize=(WIDTH, rows * height + 0.35), layout=layout)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def picture(title: str, caption: str, figure: Figure) -> Picture:
    """Returns the finished figure."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI)
    return Picture(title, caption, stream.getvalue())


def legend_below(figure: Figure, *axes: Any) -> None:
    """Draws one legend under the figure for what is drawn in `axes`, each name once."""
    found: dict[str, Any] = {}
    for axis in axes:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    figure.legend(found.values(), found.keys(), loc="outside lower center", ncols=min(len(found), 7))


def band(axis: Any, time: Array, error: Array, std: Array, colour: str, marker: str = "") -> None:
    """Draws errors over time on their 3-sigma band; far outliers are cut off and counted in the corner."""
    lower, upper = -3 * std, 3 * std
    axis.fill_between(time, lower, upper, color=colour, alpha=0.18, linewidth=0, label="3 sigma")
    axis.axhline(0.0, color=TRUTH, linewidth=0.6)
    line = "" if marker else "-"
    axis.plot(time, error, line, marker=marker, markersize=3, color=colour, linewidth=0.9, label="error")
    known = upper[np.isfinite(upper)]
    settled = float(np.percentile(known, 75)) if known.size else 0.0
    limit = 1.2 * max(float(np.percentile(np.abs(error), 99)), settled, 1e-9)
    axis.set_ylim(-limit, limit)
    if outside := int(np.sum(np.abs(error) > limit)):
        note = f"{outside} beyond, up to {np.abs(error).max():.3g}"
        box = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.5}
        axis.text(0.995, 0.97, note, transform=axis.transAxes, ha="right", va="top", fontsize=8, bbox=box)


def ellipse(axis: Any, centre: Array, cov: Array, colour: str) -> None:
    """Draws the 2-sigma ellipse of a covariance (2, 2)."""
    variances, directions = np.linalg.eigh(cov)
    angle = np.degrees(np.arctan2(directions[1, 1], directions[0, 1]))
    minor, major = 4 * np.sqrt(variances)
    shape = Ellipse((centre[0], centre[1]), major, minor, angle=angle, facecolor=colour, alpha=0.25, edgecolor=colour)
    axis.add_patch(shape)


def plan(axis: Any, unit: str, frame: str = "map") -> None:
    """Gives a plan view equal scales and the names of its axes."""
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.08)
    east, north = ("east", "north") if frame == "map" else ("x", "y")
    axis.set_xlabel(f"{east} in {frame} ({unit})")
    axis.set_ylabel(f"{north} in {frame} ({unit})")
