"""A picture of what a calibration changes: the angles that the pings give before and after it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.types import Array
from ..evaluation.plot import BLUE, RED, TRUTH, canvas, legend_below, picture, style
from .model import Pair, Poses, predicted
from .sources import SourceData
from .verdict import Calibration


def before_after(found: Calibration) -> bytes:
    """PNG: angles to the array's axis of every ping as the graph has it and as calibrated, and their errors.

    What is drawn as true is the direction to the pinger as known, or as fitted.
    """
    fit, c = found.fit, found.seen.config
    before = Pair(c.electronics.delay_offset, c.array.spacing_scale, c.array.array_yaw)
    with style():
        figure, axes = canvas(2, 2, 2.9, sharex="col")
        begin = 0
        for k, source in enumerate(found.sources):
            place, part = fit.values[3 + 3 * k : 6 + 3 * k], slice(begin, begin + len(source.pings))
            begin = part.stop
            _column(axes[:, 0], source, before, _strongest(source, c.electronics.invert != "none"), place, RED)
            _column(axes[:, 1], source, fit.pair, fit.tdoas[part], place, BLUE)
        for column, title in enumerate(("As the graph has it", "Calibrated")):
            axes[0, column].set(title=title, ylabel="angle to the array's axis, deg", ylim=(-5, 185))
            axes[1, column].set(xlabel="ping", ylabel="error, deg")
        legend_below(figure, axes[0, 0], axes[0, 1])
        return picture("", "", figure).png


def _column(axes: Any, source: SourceData, pair: Pair, tdoas: Array, place: Array, colour: str) -> None:
    ideal = predicted(source.poses, pair, *place[:, None])[0]
    true, measured = (np.degrees(_angle(source.poses, pair, lags)) for lags in (ideal, tdoas))
    axes[0].plot(true, color=TRUTH, label="to the pinger")
    axes[0].plot(measured, ".", color=colour, label="by the TDOA")
    axes[1].plot(measured - true, ".", color=colour)


def _strongest(source: SourceData, opposite: bool) -> Array:
    """(n,) s, of the maxima that the node would take first: within the largest lag of its array."""
    return np.array([(ping.opposite if opposite else ping.alike).tdoas[0] for ping in source.pings])


def _angle(poses: Poses, pair: Pair, tdoas: Array) -> Array:
    cosine = (tdoas - pair.delay_offset) * poses.sound_speed / (poses.spacing * pair.spacing_scale)
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))
