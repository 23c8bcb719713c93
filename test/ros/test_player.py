"""A bag that nobody filtered, played alone: what cannot be played is left out, said and counted."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from uw_acoustic_loc.bag.rosbags_messages import encode
from uw_acoustic_loc.bag.storage.stored import Definition, Topic
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.types import Point

START_NS = 1_700_000_000_000_000_000
POINT = "geometry_msgs/msg/PointStamped"
DEPTH = Definition("float64 depth", "ros2msg")


def test_what_cannot_be_played_is_left_out_and_counted(domain: int, tmp_path: Path) -> None:
    data = encode(Point(START_NS, np.array([1.0, 0.0, 0.0]), "map"))
    topics = [
        Topic("/p", "std_msgs/msg/String", False),
        Topic("/depth", "my_msgs/msg/Depth", False, "cdr", DEPTH),
        Topic("/no name", POINT, False),
        Topic("/p", POINT, False),
        Topic("/p", POINT, False),
    ]
    with BagWriter(tmp_path / "bag") as writer:
        for k, topic in enumerate(topics):
            writer.copy_topic(topic)
            writer.write(topic.name, START_NS + k, data)
    given = ["-p", f"bag:={tmp_path / 'bag'}", "-p", "rate:=0.0", "--disable-external-lib-logs"]
    command = [sys.executable, "-m", "uw_acoustic_loc.ros", "player", "--ros-args", *given]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "/depth is not played: message type my_msgs/msg/Depth is not installed" in done.stderr
    assert "/no name is not played: Invalid" in done.stderr
    *_, last = done.stderr.splitlines()
    assert last.startswith("played 2 messages of ")
    assert last.endswith("left out 1 on /depth, left out 1 on /no name, left out 1 on /p"), last
