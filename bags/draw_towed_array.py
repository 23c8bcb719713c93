"""Draws both animals of the towed-array bag, with both mirror hypotheses, over the published fixes.

python bags/draw_towed_array.py docs/images/localizer_towed_array.png
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.evaluation.plot import BLUE, GREEN, RED, TRUTH, canvas, ellipse, legend_below, picture, plan, style
from uw_acoustic_loc.evaluation.recording import Recording, load
from uw_acoustic_loc.graph import load_graph

HOME = Path(__file__).parents[1]
PUBLISHED = {"b": ((1850, 3300), (380, -3730)), "c": ((3250, 2400), (2000, -3400))}  # m, read from the authors' figure
COLOURS = {"b": BLUE, "c": GREEN}
KM = 1e-3


def main(png: Path) -> None:
    """Runs the localizer on the bag and draws what it ends with."""
    with tempfile.TemporaryDirectory() as folder, style():
        recording = processed(Path(folder) / "out")
        figure, axes = canvas(1, 1, 5.6)
        draw(axes[0, 0], recording)
        legend_below(figure, axes[0, 0])
        png.write_bytes(picture("", "", figure).png)


def processed(out: Path) -> Recording:
    """The bag with what the localizer makes of it."""
    graph = load_graph(HOME / "config" / "lasker_ac109" / "graph.yaml")
    bag = Bag(HOME / "bags" / "lasker_ac109")
    OfflineRun(bag, graph, lambda topic, refusal: print(topic, refusal.sentence)).run(out, True, lambda _: None)
    return load(out)


def draw(axis: Any, recording: Recording) -> None:
    """Track, hypotheses and published fixes."""
    for series in recording.all("odometry"):
        track = KM * np.array([value.position for value in series.values])
        axis.plot(track[:, 0], track[:, 1], color=TRUTH, linewidth=2, label="towed array")
        axis.plot(*track[-1, :2], ">", color=TRUTH, markersize=8)
    for role, label, marker in (
        ("source", "to port, with 2 sigma", "o"),
        ("mirror", "mirror image, with 2 sigma", "s"),
    ):
        for series in recording.all(role):
            mean, cov = KM * series.values[-1].position[:2], KM**2 * series.values[-1].cov[:2, :2]
            axis.plot(*mean, marker, color=COLOURS[series.id], markersize=5, label=label)
            ellipse(axis, mean, cov, COLOURS[series.id])
            axis.annotate(f"animal {series.id}", mean, (14, 0), textcoords="offset points", color=COLOURS[series.id])
    fixes = KM * np.array([fix for both in PUBLISHED.values() for fix in both])
    axis.plot(fixes[:, 0], fixes[:, 1], "x", color=RED, markersize=8, markeredgewidth=1.5, label="published fixes")
    plan(axis, "km", "odom")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
