"""Writes the towed-array recording of 2017-09-12 (PinaGruden/Localization_Towed_Array) as a rosbag2 bag.

    python bags/convert_towed_array.py TOWED_ARRAY_FOLDER bags/lasker_ac109

The folder holds tdoa_tracks.csv (track, time_s, tdoa_s) and GPSandPosition_table.csv (one row per 0.5 s). Signs there:
tdoa = (|P - S1| - |P - S2|) / c, positive = nearer to the aft sensor S2, so cos(angle from the tow axis, towards S1)
= -c tdoa / d. In the bag, base_link is the middle of the array with x along the tow axis, and odom is the data set's
own position frame. Two sensors cannot tell port from starboard: the bearings are given as if to port.
"""

from __future__ import annotations

import csv
import math
import shutil
import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from uw_acoustic_loc.bag.rosbags_messages import BagMake, serialize
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.geometry import angle_from_tdoa, quat_from_yaw
from uw_acoustic_loc.core.types import Bearing, Odometry
from uw_acoustic_loc.wire.codec import codec

SOUND_SPEED = 1500.0  # m/s, as the data set's authors used
SPACING = 25.59  # m, nominal
PERIOD = 0.5  # s between rows
BEARING_STD = math.radians(1.5)  # array shape and sound speed; the spread of a track around its trend is 0.1 degrees
ANIMALS = {"b": (18, 23, 28, 33), "c": (25, 29, 32, 38)}  # tracks of each animal
ODOMETRY, NAMESPACE = "odometry", "/auv1"


def main(folder: Path, out: Path) -> None:
    """Converts; keeps what else lies in `out` (README, licence)."""
    kept = {path.name: path.read_bytes() for path in out.glob("*") if path.suffix in (".md", "") and path.is_file()}
    shutil.rmtree(out, ignore_errors=True)
    start_ns, odometry = read_odometry(folder / "GPSandPosition_table.csv")
    bearings = read_bearings(folder / "tdoa_tracks.csv", start_ns)
    messages = [(value.t_ns, f"{NAMESPACE}/{ODOMETRY}", value) for value in odometry]
    for animal, values in bearings.items():
        messages += [(value.t_ns, f"{NAMESPACE}/sources/{animal}/bearing", value) for value in values]
    with BagWriter(out, {"source": "github.com/PinaGruden/Localization_Towed_Array, encounter of 2017-09-12"}) as bag:
        for t_ns, topic, value in sorted(messages, key=lambda message: message[:2]):
            form = codec(type(value))
            bag.add_topic(topic, form.msgtype)
            bag.write(topic, t_ns, serialize(form.encode(BagMake(), value), form.msgtype))
    for name, content in kept.items():
        (out / name).write_bytes(content)


def read_odometry(file: Path) -> tuple[int, list[Odometry]]:
    """Start in ns, and the array's pose and speed at every row."""
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    first = datetime.strptime(rows[0]["Time_UTC"], "%d-%b-%Y %H:%M:%S.%f").replace(tzinfo=UTC)
    start_ns = round(first.timestamp() * 1000) * 1_000_000
    fore, aft = (np.array([[float(row[f"Sensor{n}_pos_{axis}_m"]) for axis in "xy"] for row in rows]) for n in (1, 2))
    middle, axis = (fore + aft) / 2, fore - aft
    yaw = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
    velocity, rate = np.gradient(middle, PERIOD, axis=0), np.gradient(yaw, PERIOD)
    values = []
    for k in range(len(rows)):
        forward = velocity[k] @ [math.cos(yaw[k]), math.sin(yaw[k])]
        left = velocity[k] @ [-math.sin(yaw[k]), math.cos(yaw[k])]
        values.append(
            Odometry(
                t_ns=start_ns + round(k * PERIOD * 1e9),
                position=np.array([*middle[k], 0.0]),
                quat_xyzw=quat_from_yaw(float(yaw[k])),
                linear=np.array([forward, left, 0.0]),
                angular=np.array([0.0, 0.0, rate[k]]),
            )
        )
    return start_ns, values


def read_bearings(file: Path, start_ns: int) -> dict[str, list[Bearing]]:
    """Bearings of each animal from its TDOA tracks."""
    with file.open() as lines:
        rows = list(csv.DictReader(lines))
    found: dict[str, list[Bearing]] = {animal: [] for animal in ANIMALS}
    for animal, tracks in ANIMALS.items():
        for row in rows:
            if int(row["track"]) in tracks:
                angle, _clipped = angle_from_tdoa(-float(row["tdoa_s"]), SPACING, SOUND_SPEED)
                t_ns = start_ns + round(float(row["time_s"]) * 1e9)
                found[animal].append(Bearing(t_ns, angle, BEARING_STD**2, np.zeros(3)))
    return found


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
