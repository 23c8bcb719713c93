"""Draws the picture of the README from a demo run: its report's plan views, one above the other.

uwloc demo -o out/demo && python docs/draw_demo.py out/demo docs/images/demo.png
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from uw_acoustic_loc.evaluation.plan_views import net_plans, vehicle_plans
from uw_acoustic_loc.evaluation.plot import style
from uw_acoustic_loc.evaluation.recording import load

COLOURS = 256  # of a palette: a third of the bytes


def main(demo: Path, png: Path) -> None:
    """Reads the demo's bag and writes the picture."""
    recording = load(demo / "bag")
    with style():
        views = [*vehicle_plans(recording), *net_plans(recording)]
    rows = [np.asarray(Image.open(io.BytesIO(view.png)).convert("RGB")) for view in views]
    Image.fromarray(np.vstack(rows)).quantize(COLOURS).save(png, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
