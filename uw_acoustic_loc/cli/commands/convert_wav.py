"""`uwloc convert-wav`: sound files become a bag."""
# ruff: noqa: PLC0415

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from ..console import say

HELP = "sound files of two hydrophones (WAV, FLAC, ...) into a bag for the bearing node"


def add(parser: ArgumentParser) -> None:
    """Declares the arguments."""
    parser.add_argument("wav", type=Path, metavar="IN.wav", nargs="*", help="one file, or consecutive ones")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="BAG")
    parser.add_argument("--spacing", type=float, required=True, metavar="D", help="m between the hydrophones")
    parser.add_argument("--sound-speed", type=float, default=1500.0, metavar="C", help="m/s (default %(default)s)")
    level = parser.add_mutually_exclusive_group()
    level.add_argument("--full-scale", type=float, default=1.0, metavar="PA", help="Pa of the largest sample")
    level.add_argument("--calibration", type=float, metavar="DB", help="the same in dB re 1 uPa")
    start = "of the first sample; without it the files' names or their metadata must say"
    parser.add_argument("--start", type=float, metavar="UNIX_S", help=start)
    parser.add_argument("--time-format", default="", metavar="FMT", help="of strptime, for the names without suffix")
    parser.add_argument("--frame", type=float, default=0.1, metavar="S", help="length of a frame (default %(default)s)")
    parser.add_argument("--namespace", default="auv1", help="of the topics (default %(default)s)")
    both = "of hydrophone 0 (-x) and 1 (+x): two numbers from 0, or two files of one channel each"
    parser.add_argument("--channels", default="0,1", metavar="I,J", help=both)


def run(options: Namespace) -> int:
    """Writes sound files into a bag."""
    from ...bag.sound.convert import WavSetup, convert_mono, convert_wav

    o = options
    files = _mono_files(o.channels)
    if bool(o.wav) == bool(files):
        raise ValueError("convert-wav must have either sound files, or --channels with two files, not both")
    full_scale = o.full_scale if o.calibration is None else _pressure(o.calibration)
    channels = (0, 1) if files else _pair(o.channels)
    setup = WavSetup(o.spacing, o.sound_speed, full_scale, _ns(o.start), o.frame, o.namespace, channels, o.time_format)
    note = lambda sentence: say(f"note: {sentence}")  # noqa: E731
    counts = convert_mono(files, o.output, setup, note) if files else convert_wav(o.wav, o.output, setup, note)
    say(f"{sum(counts.values())} messages on {len(counts)} topics in {o.output}")
    return 0


def _pressure(level_db: float) -> float:
    """Pa of a level re 1 uPa."""
    if not abs(level_db) <= _LOUDEST_DB:
        raise ValueError(f"calibration must be from {-_LOUDEST_DB:g} to {_LOUDEST_DB:g} dB re 1 uPa, got {level_db!r}")
    return float(10 ** (level_db / 20) * 1e-6)


def _ns(start: float | None) -> int:
    if start is None:
        return 0
    if not 0 < start < _LAST_S:
        raise ValueError(f"start must be after 1970-01-01 and before 2038-01-19, got {start!r} s")
    return round(start * 1e9)


_LAST_S = 1 << 31  # of ROS's stamps, in Unix time
_LOUDEST_DB = 300.0


def _mono_files(text: str) -> tuple[Path, Path] | None:
    parts = text.split(",")
    if len(parts) != 2 or any(part.strip().isdecimal() for part in parts) or not all(map(_is_file, parts)):
        return None
    return Path(parts[0]), Path(parts[1])


def _is_file(name: str) -> bool:
    return Path(name).suffix != "" or Path(name).exists()


def _pair(text: str) -> tuple[int, int]:
    parts = text.split(",")
    if len(parts) != 2 or not all(part.strip().isdecimal() for part in parts):
        raise ValueError(f"--channels must be two numbers such as 0,1, got {text!r}")
    return int(parts[0]), int(parts[1])
