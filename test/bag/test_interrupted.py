"""Recordings that end badly: a full disk, a killed process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from uw_acoustic_loc.bag.reader import Bag

WRITES = """
import sys
from pathlib import Path
from test.bag.foreign import payload, START_NS, FORM
from uw_acoustic_loc.bag.writer import BagWriter
with BagWriter(Path(sys.argv[1])) as writer:
    writer.add_topic("/a", FORM.msgtype)
    writer.add_topic("/noise", "std_msgs/msg/ByteMultiArray")
    import random
    noise = random.Random(1)
    {loop}
"""
ENDLESS = """
    for k in range(1_000_000):
        writer.write("/a", START_NS + 1000 * k, payload(k % 1000))
        writer.write("/noise", START_NS + 1000 * k, bytes([0, 1, 0, 0]) + noise.randbytes(2000))
        if k % 1000 == 999:
            {each}
"""


def python(code: str, *arguments: Path) -> list[str]:
    return [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)]


def script(each: str) -> str:
    return WRITES.replace("    {loop}", ENDLESS.replace("{each}", each))


LIMITED = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (5_000_000, 5_000_000))\n"


def readable(bag: Path) -> int:
    """Messages of a bag, read by everybody."""
    reader = Bag(bag)
    count = sum(1 for _ in reader.records())
    assert reader.damage == []
    with AnyReader([bag]) as others:
        assert sum(1 for _ in others.messages()) == others.message_count == count
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        assert sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages()) == count
    return count


def test_a_full_disk_is_said_and_what_is_written_is_a_bag(tmp_path: Path) -> None:
    done = subprocess.run(
        python(LIMITED + script("pass"), tmp_path / "bag"), capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stderr.count("File too large; what was written is kept") == 1
    (file,) = (tmp_path / "bag").glob("*.mcap")
    assert 3_900_000 < file.stat().st_size <= 5_000_000
    count = readable(tmp_path / "bag")
    assert count > 3000
    about = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert about["message_count"] == count


def test_simulate_on_a_full_disk_exits_1_with_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("{duration: 100000.0, moorings: [{id: m}]}")
    limit = LIMITED.replace("5_000_000", "1_000_000")
    run = "import sys; from uw_acoustic_loc.cli.main import main; sys.exit(main(['simulate', *sys.argv[1:]]))"
    done = subprocess.run(
        python(limit + run, tmp_path / "s.yaml", Path("-o"), tmp_path / "bag"),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (
        1,
        f"uwloc: {tmp_path / 'bag'}: File too large; what was written is kept\n",
    )
    assert readable(tmp_path / "bag") > 0


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may mount a small file system")
def test_a_small_file_system_that_is_full(tmp_path: Path) -> None:
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(small)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        done = subprocess.run(python(script("pass"), small / "bag"), capture_output=True, text=True, check=False)
        assert done.returncode == 1
        assert "No space left on device; what was written is kept" in done.stderr
        assert readable(small / "bag") > 1000
    finally:
        subprocess.run(["umount", str(small)], check=True)


def test_a_killed_process_loses_what_it_had_not_flushed(tmp_path: Path) -> None:
    each = "writer.flush(); print(k + 1, flush=True)"
    with subprocess.Popen(python(script(each), tmp_path / "bag"), stdout=subprocess.PIPE, text=True) as process:
        for _ in range(3):
            flushed = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
    assert flushed == 3000
    bag = Bag(tmp_path / "bag")
    assert sum(record.topic == "/a" for record in bag.records()) >= flushed
    assert len(bag.damage) == 1
    assert "before its end was written" in bag.damage[0]
