"""Small bags as other writers make them: every storage, compression and omission that rosbag2 knows."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
import zstandard
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from uw_acoustic_loc.bag.definitions import jazzy_definition
from uw_acoustic_loc.bag.rosbags_messages import STORE, BagMake, serialize
from uw_acoustic_loc.core.types import Point
from uw_acoustic_loc.wire.codec import codec

FORM = codec(Point)
START_NS = 1_700_000_000_000_000_000
COUNT = 400
TOPICS = ("/a", "/b")


@cache
def payload(k: int) -> bytes:
    return serialize(FORM.encode(BagMake(), Point(START_NS + k, np.array([k, 0.5, -k]))), FORM.msgtype)


def messages(first: int = 0, count: int = COUNT) -> Iterator[tuple[str, int, bytes]]:
    for k in range(first, first + count):
        yield TOPICS[k % 7 == 0], START_NS + 1000 * k, payload(k)


def expected(first: int = 0, count: int = COUNT) -> list[tuple[str, int, bytes]]:
    return list(messages(first, count))


def write_mcap(
    path: Path,
    given: Any = None,
    *,
    msgtype: str = FORM.msgtype,
    encoding: str = "cdr",
    text: str | None = None,
    **options: Any,
) -> Path:
    """One MCAP file by the mcap library; small chunks unless told otherwise."""
    text = jazzy_definition(FORM.msgtype).text if text is None else text
    with path.open("wb") as stream:
        writer = Writer(stream, **({"chunk_size": 4096} | options))
        writer.start(profile="ros2", library="a test")
        schema = writer.register_schema(msgtype, "ros2msg", text.encode())
        channels = {name: writer.register_channel(name, encoding, schema) for name in TOPICS}
        for topic, t_ns, data in messages() if given is None else given:
            writer.add_message(channels[topic], t_ns, data, t_ns)
        writer.finish()
    return path


def write_rosbags(path: Path, storage: StoragePlugin, mode: CompressionMode = CompressionMode.NONE) -> Path:
    """A folder by the rosbags library."""
    writer = RosbagsWriter(path, version=9, storage_plugin=storage)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {name: writer.add_connection(name, FORM.msgtype, typestore=STORE) for name in TOPICS}
        for topic, t_ns, data in messages():
            writer.write(connections[topic], t_ns, data)
    return path


def _split(folder: Path) -> Path:
    """A dozen files, so that sorting by name alone would go wrong, without metadata.yaml."""
    folder.mkdir()
    for k in range(0, COUNT, 32):
        write_mcap(folder / f"split_{k // 32}.mcap", messages(k, min(32, COUNT - k)))
    return folder


def _zstd_file(folder: Path) -> Path:
    """mode FILE of the MCAP storage, with rosbag2's metadata.yaml."""
    folder.mkdir()
    plain = write_mcap(folder / "plain.mcap")
    (folder / "bag_0.mcap.zstd").write_bytes(zstandard.compress(plain.read_bytes()))
    plain.unlink()
    about = {"relative_file_paths": ["bag_0.mcap.zstd"], "compression_mode": "FILE", "compression_format": "zstd"}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}))
    return folder


def _old_sqlite(folder: Path) -> Path:
    """Eloquent: no QoS column, no metadata.yaml, and paths of the folder's own."""
    write_rosbags(folder, StoragePlugin.SQLITE3)
    (folder / "metadata.yaml").unlink()
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as base:
        base.execute("ALTER TABLE topics DROP COLUMN offered_qos_profiles")
    base.close()
    return folder


VARIANTS = {
    "zstd chunks": lambda folder: write_mcap(folder / "x.mcap", compression=CompressionType.ZSTD),
    "lz4 chunks": lambda folder: write_mcap(folder / "x.mcap", compression=CompressionType.LZ4),
    "plain chunks": lambda folder: write_mcap(folder / "x.mcap", compression=CompressionType.NONE),
    "no chunks": lambda folder: write_mcap(folder / "x.mcap", use_chunking=False),
    "no CRC": lambda folder: write_mcap(folder / "x.mcap", enable_crcs=False),
    "no statistics": lambda folder: write_mcap(folder / "x.mcap", use_statistics=False),
    "no index": lambda folder: write_mcap(folder / "x.mcap", index_types=IndexType.NONE),
    "no schemas in the summary": lambda folder: write_mcap(folder / "x.mcap", repeat_schemas=False),
    "no channels in the summary": lambda folder: write_mcap(folder / "x.mcap", repeat_channels=False),
    "no summary": lambda folder: write_mcap(
        folder / "x.mcap",
        index_types=IndexType.NONE,
        repeat_channels=False,
        repeat_schemas=False,
        use_statistics=False,
        use_summary_offsets=False,
    ),
    "split": lambda folder: _split(folder / "bag"),
    "zstd file": lambda folder: _zstd_file(folder / "bag"),
    "rosbags MCAP": lambda folder: write_rosbags(folder / "bag", StoragePlugin.MCAP),
    "sqlite3": lambda folder: write_rosbags(folder / "bag", StoragePlugin.SQLITE3),
    "sqlite3, zstd file": lambda folder: write_rosbags(folder / "bag", StoragePlugin.SQLITE3, CompressionMode.FILE),
    "sqlite3, zstd messages": lambda folder: write_rosbags(
        folder / "bag", StoragePlugin.SQLITE3, CompressionMode.MESSAGE
    ),
    "old sqlite3": lambda folder: _old_sqlite(folder / "bag"),
}
