"""Writes 1.5 s of three of six hydrophones off Hornby Island (xaviermouy/XAV-arrays) as a rosbag2 bag.

    python bags/convert_fish_array.py FISH_ARRAY_FOLDER bags/fish_array

The folder holds a mono WAV file per hydrophone and hydrophones.csv with their surveyed positions. Each pair is an array
of its own in the bag, `/pair01` being hydrophones 0 and 1, with x of the array's frame from the first to the second.
Counts are of 2^-21 of full scale, which the loudest sample here fills to three quarters; the pressure is not known.
"""

from __future__ import annotations

import csv
import shutil
import sys
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

from uw_acoustic_loc.bag.rosbags_messages import encode
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.types import AnyArray, HydrophoneInfo, Samples
from uw_acoustic_loc.wire.codec import codec

HYDROPHONES = (0, 1, 2)
START_NS = int(datetime(2019, 9, 20, 16, 38, 58, tzinfo=UTC).timestamp()) * 1_000_000_000  # by the files' names
BEGIN, LENGTH, FRAME = 1.2, 1.5, 0.1  # s
SOUND_SPEED = 1484.0  # m/s, as the data set's authors used
SCALE = 2.0**-21  # full scale per count


def main(folder: Path, out: Path) -> None:
    """Converts; keeps what else lies in `out` (README, licence, expected results)."""
    kept = {
        path.name: path.read_bytes() for path in out.glob("*") if path.name in ("README.md", "LICENSE", "expected.yaml")
    }
    shutil.rmtree(out, ignore_errors=True)
    positions, counts, rate = read(folder)
    start_ns = START_NS + round(BEGIN * 1e9)
    with BagWriter(out, {"source": "github.com/xaviermouy/XAV-arrays, large array, 2019-09-20T16:38:58Z"}) as bag:
        for a, b in combinations(HYDROPHONES, 2):
            spacing = float(np.linalg.norm(positions[b] - positions[a]))
            info = HydrophoneInfo(start_ns, float(rate), spacing, SOUND_SPEED, SCALE, f"pair{a}{b}")
            write(bag, f"/pair{a}{b}/hydrophones/info", info, start_ns, latched=True)
        for begin in range(0, counts.shape[1], round(FRAME * rate)):
            frame = counts[:, begin : begin + round(FRAME * rate)]
            t_ns, end_ns = (start_ns + round(k / rate * 1e9) for k in (begin, begin + frame.shape[1]))
            for a, b in combinations(HYDROPHONES, 2):
                write(bag, f"/pair{a}{b}/hydrophones/samples", Samples(t_ns, frame[a], frame[b], f"pair{a}{b}"), end_ns)
    for name, content in kept.items():
        (out / name).write_bytes(content)


def read(folder: Path) -> tuple[AnyArray, AnyArray, int]:
    """Positions (6, 3) in m, samples (3, N) int16, and their rate in Hz."""
    with (folder / "hydrophones.csv").open() as lines:
        positions = np.array([[float(row[axis]) for axis in "xyz"] for row in csv.DictReader(lines)])
    found = []
    for number in HYDROPHONES:
        (file,) = folder.glob(f"AMAR173.{number + 1}.*.wav")
        samples, rate = soundfile.read(file)
        found.append(samples[round(BEGIN * rate) : round((BEGIN + LENGTH) * rate)])
    counts = np.rint(np.stack(found) / SCALE)
    if np.abs(counts).max() > np.iinfo(np.int16).max:
        raise ValueError(
            f"samples must be at most {32767 * SCALE:g} of full scale, got {np.abs(counts).max() * SCALE:g}"
        )
    return positions, counts.astype(np.int16), rate


def write(bag: BagWriter, topic: str, value: Any, t_ns: int, latched: bool = False) -> None:
    """Writes a core value."""
    bag.add_topic(topic, codec(type(value)).msgtype, latched)
    bag.write(topic, t_ns, encode(value))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
