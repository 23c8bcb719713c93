"""Bags of other writers, whole and broken: what can be read is read, and the rest is one sentence."""

import random
import shutil
from collections.abc import Iterable
from pathlib import Path

import pytest
import yaml
from mcap.writer import CompressionType

from test.bag.foreign import COUNT, FORM, START_NS, VARIANTS, expected, messages, write_mcap
from uw_acoustic_loc.bag.reader import Bag

KEPT = expected()


def contents(bag: Bag, topics: Iterable[str] | None = None) -> list[tuple[str, int, bytes]]:
    return [(r.topic, r.t_ns, r.data) for r in bag.records(None if topics is None else list(topics))]


@pytest.mark.parametrize("name", VARIANTS)
def test_every_variant_is_read_whole(name: str, tmp_path: Path) -> None:
    bag = Bag(VARIANTS[name](tmp_path))
    assert contents(bag) == KEPT
    assert contents(bag, ["/b"]) == [message for message in KEPT if message[0] == "/b"]
    assert {topic.msgtype for topic in bag.topics.values()} == {FORM.msgtype}
    assert bag.span() == (START_NS, START_NS + 1000 * (COUNT - 1))
    assert bag.damage == []


def damaged_file(bag: Path) -> Path:
    """The bag itself, or the first of its files."""
    return bag if bag.is_file() else min(file for file in bag.iterdir() if file.suffix != ".yaml")


@pytest.mark.parametrize("name", VARIANTS)
def test_a_bag_cut_at_any_byte_keeps_what_stands_before(name: str, tmp_path: Path) -> None:
    path = VARIANTS[name](tmp_path)
    file = damaged_file(path)
    whole = file.read_bytes()
    rng = random.Random(f"cut {name}")
    before = 0
    for kept in [0, *sorted(rng.sample(range(1, len(whole)), 12))]:
        file.write_bytes(whole[:kept])
        bag = Bag(path)
        found = contents(bag)
        assert set(found) <= set(KEPT)
        assert len(bag.damage) == 1, (kept, bag.damage)
        assert str(file) in bag.damage[0]
        assert len(found) >= before, "a longer piece must not hold less"
        before = len(found)
    if "zstd file" not in name:  # so small that it is a single block
        assert before > (16 if "split" in name else COUNT / 2)


@pytest.mark.parametrize("name", VARIANTS)
def test_a_flipped_byte_costs_its_block_at_most(name: str, tmp_path: Path) -> None:
    path = VARIANTS[name](tmp_path)
    file = damaged_file(path)
    whole = file.read_bytes()
    rng = random.Random(f"flip {name}")
    for at in sorted(rng.sample(range(len(whole)), 20)):
        flipped = bytearray(whole)
        flipped[at] ^= 1 << rng.randrange(8)
        file.write_bytes(flipped)
        try:
            bag = Bag(path)
        except ValueError as error:  # a topic's encoding is not cdr any more
            assert "not cdr" in str(error) or "neither" in str(error)
            continue
        found = contents(bag)
        if len(found) < len(KEPT):
            assert bag.damage, f"byte {at}: {len(KEPT) - len(found)} messages were lost in silence"
        assert len(bag.damage) <= 2


def test_every_flipped_byte_of_a_bag_with_checksums_is_noticed(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "x.mcap", compression=CompressionType.ZSTD, enable_data_crcs=True)
    whole = path.read_bytes()
    rng = random.Random(5)
    for at in [0, 7, *rng.sample(range(len(whole)), 60), len(whole) - 1]:
        flipped = bytearray(whole)
        flipped[at] ^= 1 << rng.randrange(8)
        path.write_bytes(flipped)
        bag = Bag(path)
        found = contents(bag)
        assert set(found) <= set(KEPT), f"byte {at}"
        assert len(bag.damage) == 1, f"byte {at}"
        assert len(found) > 0.7 * COUNT, f"byte {at}: all other chunks are read"


def test_one_damaged_file_of_several_costs_only_itself(tmp_path: Path) -> None:
    path = VARIANTS["split"](tmp_path)
    (path / "split_3.mcap").write_bytes(b"not an MCAP file")
    bag = Bag(path)
    lost = expected(96, 32)
    assert contents(bag) == [message for message in KEPT if message not in lost]
    assert len(bag.damage) == 1
    assert "split_3.mcap: damaged near byte 0" in bag.damage[0]


def test_a_missing_file_of_several_is_named(tmp_path: Path) -> None:
    path = VARIANTS["split"](tmp_path)
    names = [f"split_{k}.mcap" for k in range(13)] + ["split_13.mcap"]
    about = {"rosbag2_bagfile_information": {"relative_file_paths": names}}
    (path / "metadata.yaml").write_text(yaml.safe_dump(about))
    bag = Bag(path)
    assert contents(bag) == KEPT
    assert bag.damage == [f"bag {path}: split_13.mcap is listed in metadata.yaml but missing"]


@pytest.mark.parametrize("text", ["", "[1, 2]", "rosbag2_bagfile_information: 3", "{", "\x00\x01"])
def test_a_broken_metadata_file_does_not_hide_the_messages(text: str, tmp_path: Path) -> None:
    path = VARIANTS["split"](tmp_path)
    (path / "metadata.yaml").write_text(text)
    bag = Bag(path)
    assert contents(bag) == KEPT
    assert "metadata.yaml is not a rosbag2 description" in bag.damage[0]


def test_files_whose_times_overlap_are_merged(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    for k in range(2):
        write_mcap(tmp_path / "bag" / f"part_{k}.mcap", [message for n, message in enumerate(KEPT) if n % 2 == k])
    assert contents(Bag(tmp_path / "bag")) == KEPT


def test_messages_out_of_order_are_sorted_by_log_time(tmp_path: Path) -> None:
    shuffled = random.Random(1).sample(KEPT, len(KEPT))
    assert contents(Bag(write_mcap(tmp_path / "x.mcap", shuffled))) == KEPT


@pytest.mark.parametrize("encoding", ["json", "protobuf", "xcdr2", "ros1"])
def test_another_serialization_is_listed_and_can_be_copied(encoding: str, tmp_path: Path) -> None:
    bag = Bag(write_mcap(tmp_path / "x.mcap", encoding=encoding))
    assert {name: topic.encoding for name, topic in bag.refused.items()} == {"/a": encoding, "/b": encoding}
    assert (bag.topics, contents(bag), bag.damage) == ({}, [], [])
    assert contents(bag, ["/a", "/b"]) == KEPT


def test_a_topic_of_another_serialization_does_not_hide_the_others(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    write_mcap(tmp_path / "bag" / "p_0.mcap", [m for m in KEPT if m[0] == "/a"])
    write_mcap(tmp_path / "bag" / "p_1.mcap", [], encoding="json")
    path = tmp_path / "bag"
    from mcap.writer import Writer

    with (path / "p_1.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/other", "json", 0)
        writer.add_message(channel, START_NS, b"{}", START_NS)
        writer.finish()
    bag = Bag(path)
    assert contents(bag) == [m for m in KEPT if m[0] == "/a"]
    assert (set(bag.topics), set(bag.refused), bag.damage) == ({"/a", "/b"}, {"/other"}, [])
    assert contents(bag, ["/other"]) == [("/other", START_NS, b"{}")]


@pytest.mark.parametrize(
    ("msgtype", "read_as"),
    [
        ("example_interfaces/srv/AddTwoInts_Event", "example_interfaces/srv/AddTwoInts_Event"),
        ("geometry_msgs/PointStamped", "geometry_msgs/msg/PointStamped"),
        ("nobody_msgs/msg/Knows", "nobody_msgs/msg/Knows"),
        ("", ""),
    ],
)
def test_any_type_is_read_with_or_without_a_definition(msgtype: str, read_as: str, tmp_path: Path) -> None:
    bag = Bag(write_mcap(tmp_path / "x.mcap", msgtype=msgtype, text=""))
    assert contents(bag) == KEPT
    assert {topic.msgtype for topic in bag.topics.values()} == {read_as}


def test_an_empty_bag_is_a_bag(tmp_path: Path) -> None:
    bag = Bag(write_mcap(tmp_path / "x.mcap", []))
    assert contents(bag) == []
    assert set(bag.topics) == {"/a", "/b"}
    assert (bag.damage, bag.span()) == ([], (0, 0))


def test_a_file_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(ValueError, match=r"notes\.txt is neither an MCAP file nor an SQLite file"):
        Bag(tmp_path / "notes.txt")


def test_a_recorder_that_was_killed_leaves_its_journal(tmp_path: Path) -> None:
    """sqlite3 keeps what is not yet in the file in a -wal file beside it."""
    import sqlite3

    path = VARIANTS["sqlite3"](tmp_path)
    (file,) = path.glob("*.db3")
    base = sqlite3.connect(file)
    base.execute("PRAGMA journal_mode=WAL")
    late = next(messages(COUNT, 1))
    base.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)", late[1:])
    base.commit()
    shutil.copytree(path, tmp_path / "copy")
    base.close()
    assert contents(Bag(tmp_path / "copy")) == [*KEPT, late]
