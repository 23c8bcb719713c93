"""`uwloc convert-wav`: a sound file becomes a bag."""
# ruff: noqa: PLC0415

from __future__ import annotations

import math
from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..console import STDERR

HELP = "a WAV recording of two hydrophones into a bag for the bearing node"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("wav", type=Path, metavar="IN.wav")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="BAG")
    parser.add_argument("--spacing", type=float, required=True, metavar="D", help="m between the hydrophones")
    parser.add_argument("--sound-speed", type=float, default=1500.0, metavar="C", help="m/s (default %(default)s)")
    parser.add_argument("--full-scale", type=float, default=1.0, metavar="PA", help="Pa of the largest sample")
    parser.add_argument("--start", type=float, default=1_780_272_000.0, metavar="UNIX_S", help="of the first sample")
    parser.add_argument("--frame", type=float, default=0.1, metavar="S", help="length of a frame (default %(default)s)")
    parser.add_argument("--namespace", default="auv1", help="of the topics (default %(default)s)")
    parser.add_argument("--channels", default="0,1", metavar="I,J", help="of hydrophone 0 (-x) and 1 (+x), from 0")


def run(options: Namespace) -> int:
    """Writes a WAV file into a bag."""
    from ...bag.wav import WavSetup, convert_wav

    start_ns = round(options.start * 1e9) if math.isfinite(options.start) else 0
    o, channels = options, _pair(options.channels)
    setup = WavSetup(o.spacing, o.sound_speed, o.full_scale, start_ns, o.frame, o.namespace, channels)
    counts = convert_wav(options.wav, options.output, setup)
    STDERR.print(f"{sum(counts.values())} messages on {len(counts)} topics in {options.output}")
    return 0


def _pair(text: str) -> tuple[int, int]:
    parts = text.split(",")
    if len(parts) != 2 or not all(part.strip().isdecimal() for part in parts):
        raise ValueError(f"--channels must be two numbers such as 0,1, got {text!r}")
    return int(parts[0]), int(parts[1])
