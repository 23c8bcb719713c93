"""Files that claim what cannot be, or become more than any memory holds: bounded, and one sentence each."""

from __future__ import annotations

import shutil
import sqlite3
import struct
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
import zstandard
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from test.bag.foreign import COUNT, FORM, START_NS, expected, messages, write_mcap, write_rosbags
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.survey import survey
from uw_acoustic_loc.bag.writer import BagWriter

KEPT = expected()


def contents(bag: Bag) -> list[tuple[str, int, bytes]]:
    return [(r.topic, r.t_ns, r.data) for r in bag.records()]


def places(data: bytes, opcode: int) -> list[int]:
    """Where the contents of a file's records of a kind begin."""
    found, at = [], 8
    while at + 9 <= len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, at)
        if kind == opcode:
            found.append(at + 9)
        at += 9 + length
    return found


@pytest.mark.parametrize("length", [1 << 63, (1 << 64) - 1, 1 << 62])
@pytest.mark.parametrize("field", [16, 24])  # chunk_start_offset, chunk_length
def test_absurd_chunk_indexes_are_walked_around(field: int, length: int, tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "x.mcap", enable_crcs=False)
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, places(data, Opcode.CHUNK_INDEX)[1] + field, length)
    path.write_bytes(data)
    bag = Bag(path)
    assert contents(bag) == KEPT
    assert len(bag.damage) == 1


@pytest.mark.parametrize("start", [8, 1, 1 << 62, (1 << 64) - 1])
def test_an_absurd_begin_of_the_summary_is_walked_around(start: int, tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "x.mcap", enable_crcs=False)
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, places(data, Opcode.FOOTER)[0], start)
    path.write_bytes(data)
    bag = Bag(path)
    assert contents(bag) == KEPT
    assert len(bag.damage) == 1


def chunk(packed: bytes, claimed: int) -> bytes:
    content = (
        struct.pack("<QQQII", START_NS, START_NS, claimed, 0, 4) + b"zstd" + struct.pack("<Q", len(packed)) + packed
    )
    return bytes([Opcode.CHUNK]) + struct.pack("<Q", len(content)) + content


@pytest.mark.parametrize("claimed", [100, 10 << 30])
def test_a_decompression_bomb_costs_no_memory(claimed: int, tmp_path: Path) -> None:
    """3 GB of zeros in 100 kB, in a chunk that claims 100 B, and in one that claims 10 GB."""
    packer = zstandard.ZstdCompressor(level=3).compressobj()
    bomb = b"".join(packer.compress(bytes(1 << 20)) for _ in range(3 << 10)) + packer.flush()
    path = write_mcap(tmp_path / "x.mcap", enable_crcs=False)
    data = path.read_bytes()
    path.write_bytes(data[:8] + chunk(bomb, claimed) + data[8:])
    script = """
import sys
from pathlib import Path
from test.peak_memory import peak_kb
from uw_acoustic_loc.bag.reader import Bag
before = peak_kb()
bag = Bag(Path(sys.argv[1]))
print(sum(1 for _ in bag.records()), peak_kb() - before, len(bag.damage))
"""
    done = subprocess.run([sys.executable, "-c", script, path], capture_output=True, text=True, check=True)
    count, grown_kb, damages = map(int, done.stdout.split())
    assert (count, damages) == (COUNT, 1)
    assert grown_kb < 100_000


def test_a_bomb_within_a_message_is_one_sentence(tmp_path: Path) -> None:
    bomb = zstandard.compress(bytes((1 << 30) + 1))
    path = write_mcap(tmp_path / "x.mcap", [*messages(), ("/a", START_NS + 10**9, bomb)])
    bag = Bag(path)
    assert contents(bag) == KEPT
    assert "become more than" in bag.damage[0]


def test_two_frames_in_a_chunk_are_read_whole(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "x.mcap", compression=CompressionType.NONE, use_chunking=False, enable_crcs=False)
    data = path.read_bytes()
    begin = places(data, Opcode.SCHEMA)[0] - 9
    end = places(data, Opcode.DATA_END)[0] - 9
    records = data[begin:end]
    half = len(records) // 2
    packed = zstandard.compress(records[:half]) + zstandard.compress(records[half:])
    path.write_bytes(data[:begin] + chunk(packed, len(records)) + data[end : end + 13] + data[-8:])
    assert contents(Bag(path)) == KEPT


def test_a_file_of_many_frames_is_read_whole(tmp_path: Path) -> None:
    folder = write_rosbags(tmp_path / "bag", StoragePlugin.SQLITE3)
    (plain,) = folder.glob("*.db3")
    data = plain.read_bytes()
    frames = [zstandard.compress(data[k : k + 5000]) for k in range(0, len(data), 5000)]
    plain.with_name(f"{plain.name}.zstd").write_bytes(b"".join(frames))
    plain.unlink()
    bag = Bag(folder)
    assert contents(bag) == KEPT
    assert bag.damage == []


def test_files_that_metadata_does_not_list_are_read_and_said(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for k in range(3):
        write_mcap(folder / f"bag_{k}.mcap", messages(100 * k, 100))
    about = {"relative_file_paths": ["bag_0.mcap", "bag_1.mcap"], "message_count": 200}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}))
    bag = Bag(folder)
    assert contents(bag) == expected(0, 300)
    assert bag.damage == [f"bag {folder}: bag_2.mcap is not listed in metadata.yaml; it is read as well"]


def test_a_compressed_copy_beside_a_listed_file_is_not_read_twice(tmp_path: Path) -> None:
    folder = write_rosbags(tmp_path / "bag", StoragePlugin.MCAP)
    (plain,) = folder.glob("*.mcap")
    plain.with_name(f"{plain.name}.zstd").write_bytes(zstandard.compress(plain.read_bytes()))
    bag = Bag(folder)
    assert contents(bag) == KEPT
    assert bag.damage == []


@pytest.mark.parametrize("name", ["../other.mcap", "/etc/passwd", "x/../../other.mcap"])
def test_metadata_that_leads_out_of_the_bag_is_refused(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    write_mcap(tmp_path / "other.mcap")
    write_mcap(folder / "bag_0.mcap", messages(0, 10))
    about = {"relative_file_paths": [name, "bag_0.mcap"]}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}))
    bag = Bag(folder)
    assert contents(bag) == expected(0, 10)
    assert bag.damage == [f"bag {folder}: {name} is listed in metadata.yaml and lies outside of the bag"]


@pytest.mark.parametrize("qos", ["[" * 5000, "- 2024-99-99", f"- durability: {'9' * 5000}", "- [1]", "!!python/x y"])
def test_a_qos_text_of_any_kind_costs_no_message(qos: str, tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        schema = writer.register_schema(FORM.msgtype, "ros2msg", b"")
        channel = writer.register_channel("/a", "cdr", schema, {"offered_qos_profiles": qos})
        writer.add_message(channel, START_NS, KEPT[0][2], START_NS)
        writer.finish()
    bag = Bag(path)
    assert len(contents(bag)) == 1
    with BagWriter(tmp_path / "copy") as copy:
        copy.copy_topic(bag.topics["/a"])
    assert bag.damage == []


def test_odd_names_in_metadata_cost_no_message(tmp_path: Path) -> None:
    """One too long for the file system, one that is there twice, and a count that is a text."""
    write_mcap(tmp_path / "x.mcap")
    about = {"relative_file_paths": ["a" * 5000, "x.mcap", "x.mcap"], "message_count": "400"}
    (tmp_path / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}))
    bag = Bag(tmp_path)
    assert contents(bag) == KEPT
    assert bag.damage == [f"bag {tmp_path}: {'a' * 5000} is listed in metadata.yaml but missing"]


def test_metadata_nested_without_end_is_said(tmp_path: Path) -> None:
    write_mcap(tmp_path / "x.mcap")
    (tmp_path / "metadata.yaml").write_text("[" * 100_000)
    bag = Bag(tmp_path)
    assert contents(bag) == KEPT
    assert "is not a rosbag2 description" in bag.damage[0]


def test_a_chunk_that_lies_about_its_times_is_said(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "x.mcap", enable_crcs=False)
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, places(data, Opcode.CHUNK_INDEX)[1], START_NS + 10**12)
    path.write_bytes(data)
    bag = Bag(path)
    assert sorted(contents(bag), key=lambda record: record[1]) == KEPT
    assert "other times than it claims" in bag.damage[0]


@pytest.mark.parametrize("size", [0, 1, 4000, 1 << 20])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_chunk_that_lies_about_its_size_costs_itself_alone(
    size: int, compression: CompressionType, tmp_path: Path
) -> None:
    path = write_mcap(tmp_path / "x.mcap", enable_crcs=False, compression=compression)
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, places(data, Opcode.CHUNK)[1] + 16, size)
    path.write_bytes(data)
    bag = Bag(path)
    found = contents(bag)
    assert 0.5 * COUNT < len(found) < COUNT
    assert set(found) < set(KEPT)
    assert len(bag.damage) == 1


def database(folder: Path) -> Path:
    (file,) = write_rosbags(folder / "bag", StoragePlugin.SQLITE3).glob("*.db3")
    return file


def test_an_endless_view_is_refused(tmp_path: Path) -> None:
    file = database(tmp_path)
    with sqlite3.connect(file) as base:
        base.execute("DROP TABLE messages")
        base.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)"
            " SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n"
        )
    base.close()
    bag = Bag(file)
    assert contents(bag) == []
    assert "`messages` must be a table, it is a view" in bag.damage[0]


def test_types_and_names_that_are_no_texts_are_said(tmp_path: Path) -> None:
    file = database(tmp_path)
    with sqlite3.connect(file) as base:
        base.execute("CREATE TABLE t AS SELECT * FROM topics")
        base.execute("DROP TABLE topics")
        base.execute("ALTER TABLE t RENAME TO topics")
        base.execute("INSERT INTO topics VALUES (7, x'0102', NULL, 'cdr', '', '')")
    base.close()
    bag = Bag(file)
    assert contents(bag) == KEPT
    assert "must be texts" in bag.damage[0]


def test_several_types_on_one_topic_are_read_and_said(tmp_path: Path) -> None:
    file = database(tmp_path)
    with sqlite3.connect(file) as base:
        base.execute(
            "INSERT INTO topics SELECT 9, name, 'std_msgs/msg/Float64', 'cdr', '', '' FROM topics WHERE id = 1"
        )
        base.execute("INSERT INTO messages VALUES (9999, 9, ?, x'00010000000000000000f83f')", (START_NS + 10**9,))
    base.close()
    bag = Bag(file)
    last = list(bag.records())[-1]
    assert last.msgtype == "std_msgs/msg/Float64"
    types = {found.msgtype: found.other_types for found in survey(bag).topics.values() if found.other_types}
    assert types in ({FORM.msgtype: ("std_msgs/msg/Float64",)}, {"std_msgs/msg/Float64": (FORM.msgtype,)})


def test_log_times_of_zero_do_not_begin_in_1970(tmp_path: Path) -> None:
    file = database(tmp_path)
    with sqlite3.connect(file) as base:
        base.execute("UPDATE messages SET timestamp = 0 WHERE id = 1")
    base.close()
    mcap = write_mcap(tmp_path / "x.mcap", [("/a", 0, KEPT[0][2]), *messages()])
    for path in (file, mcap):
        bag = Bag(path)
        assert bag.span()[0] >= START_NS
        assert survey(bag).span[0] >= START_NS
        assert sum(topic.unset_log_times for topic in survey(bag).topics.values()) == 1


def test_a_journal_on_read_only_media_is_read(tmp_path: Path) -> None:
    """As root nothing is read-only: a folder that SQLite cannot write its index of the journal into stands for it."""
    file = database(tmp_path)
    base = sqlite3.connect(file)
    base.execute("PRAGMA journal_mode=WAL")
    late = next(messages(COUNT, 1))
    base.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)", late[1:])
    base.commit()
    copy = tmp_path / "copy"
    copy.mkdir()
    for suffix in ("", "-wal"):
        shutil.copyfile(f"{file}{suffix}", copy / f"{file.name}{suffix}")
    base.close()
    (copy / f"{file.name}-shm").mkdir()  # SQLite cannot open its shared memory
    assert contents(Bag(copy / file.name)) == [*KEPT, late]


def test_zstd_messages_of_rosbag2_are_read(tmp_path: Path) -> None:
    assert contents(Bag(write_rosbags(tmp_path / "m", StoragePlugin.SQLITE3, CompressionMode.MESSAGE))) == KEPT
