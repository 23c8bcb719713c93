"""Memory and time of the program on a bag of 2 GB: the harbour's measurements again and again, 1.4 hours of them.

Two hydrophones at 100 kHz in int16 are 0.4 MB/s; the vehicle is back at its start with each repetition, which the
estimators have to live with. Memory is the most that the process had in use (ru_maxrss), time that of the wall.
"""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ["OMP_NUM_THREADS"] = "1"

from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.simulate import simulate
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.resources import resource
from uw_acoustic_loc.sim.scenario import load_scenario

BYTES = 2_000_000_000
GOAL_MB = 500.0
GRAPH = resource("config/harbour/graph.yaml")
_SECONDS = struct.Struct("<i")  # of the stamp, behind the four bytes that CDR begins with


def main() -> int:
    if shutil.disk_usage(os.environ.get("TMPDIR", "/tmp")).free < 2 * BYTES:
        print(f"needs {2e-9 * BYTES:g} GB of disk space", file=sys.stderr)
        return 2
    with TemporaryDirectory() as name:
        bag = Path(name, "large")
        seconds = write(bag, Path(name, "once"))
        size = sum(file.stat().st_size for file in bag.iterdir())
        print(f"## A bag of {1e-9 * size:.2f} GB, {seconds:.0f} s\n\n| | s | MB | goal, MB |\n|---|---|---|---|")
        good = measured("info", bag)
        good &= measured("hash", bag)
        good &= measured("process", bag, "--graph", GRAPH, "-o", Path(name, "out"))
    print()
    return int(not good)


def write(bag: Path, once: Path) -> float:
    """Writes the bag; returns the seconds that it covers."""
    scenario = load_scenario(resource("config/harbour/scenario.yaml"))
    simulate(scenario, once, lambda _t_ns: None)
    source = Bag(once)
    measurements = [topic for topic in source.topics.values() if not topic.name.startswith("/truth/")]
    step, shift = int(scenario.duration) + 1, 0
    with BagWriter(bag) as writer:
        for topic in measurements:
            writer.add_topic(topic.name, topic.msgtype, topic.latched)
        while (bag / f"{bag.name}_0.mcap").stat().st_size < BYTES:
            for record in source.records([topic.name for topic in measurements]):
                data = bytearray(record.data)
                _SECONDS.pack_into(data, 4, _SECONDS.unpack_from(data, 4)[0] + shift)
                writer.write(record.topic, record.t_ns + shift * 1_000_000_000, bytes(data))
            shift += step
    return shift


def measured(command: str, *arguments: str | Path) -> bool:
    begun = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-m", "uw_acoustic_loc", command, *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(child.pid, 0)
    megabytes = usage.ru_maxrss / 1024
    good = status == 0 and megabytes < GOAL_MB
    words = "" if good else " **missed**" if status == 0 else f" **failed with {status}**"
    print(
        f"| uwloc {command} | {time.perf_counter() - begun:.0f} | {megabytes:.0f} | < {GOAL_MB:g}{words} |", flush=True
    )
    return good


if __name__ == "__main__":
    sys.exit(main())
