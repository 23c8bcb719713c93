"""A bag of any length is processed in the same memory."""

import subprocess
import sys
from pathlib import Path

import numpy as np

from uw_acoustic_loc.bag.rosbags_messages import encode
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.types import HydrophoneInfo, Samples

START = 1_780_272_000_000_000_000
FRAMES, FRAME_NS = 1500, 100_000_000  # 120 MB of samples
ALLOWED_MB = 40.0
PROGRAM = """
import sys
from test.peak_memory import peak_kb
from uw_acoustic_loc.cli.main import main
print(main(sys.argv[1:]), peak_kb())
"""


def write_bag(path: Path, frames: int) -> Path:
    noise = np.random.default_rng(1).normal(0.0, 0.1, (2, 10_000)).astype(np.float32)
    info = HydrophoneInfo(START, 1e5, 0.6, 1500.0, 1e-3)
    with BagWriter(path) as writer:
        for topic in ("info", "samples"):
            writer.add_topic(f"/hydrophones/{topic}", "sensor_msgs/msg/PointCloud2", latched=topic == "info")
        writer.write("/hydrophones/info", START, encode(info))
        for k in range(frames):
            t_ns = START + k * FRAME_NS
            writer.write("/hydrophones/samples", t_ns, encode(Samples(t_ns, *noise)))
    return path


def most_memory(bag: Path) -> float:
    """MB that `uwloc process` has in use at the most."""
    graph = bag.parent / "graph.yaml"
    params = "{source_ids: [a], band_low: [18000.0], band_high: [24000.0]}"
    graph.write_text("nodes: [{executable: bearing, params: params.yaml}]")
    (bag.parent / "params.yaml").write_text(f"bearing: {{ros__parameters: {params}}}")
    arguments = ["process", bag, "--graph", graph, "-o", f"{bag}_out", "--keep-inputs"]
    done = subprocess.run([sys.executable, "-c", PROGRAM, *map(str, arguments)], capture_output=True, check=True)
    code, kilobytes = done.stdout.split()
    assert int(code) == 0, done.stderr
    return int(kilobytes) / 1024


def test_memory_does_not_grow_with_the_bag(tmp_path: Path) -> None:
    short, long = (most_memory(write_bag(tmp_path / f"bag{n}", n)) for n in (100, FRAMES))
    assert long < short + ALLOWED_MB
    assert long < 500.0
