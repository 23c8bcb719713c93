"""Bags: what is written reads back, with our reader and with others'; damage is said and the rest is read."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from uw_acoustic_loc import __version__
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import BagMake, serialize
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.types import Point
from uw_acoustic_loc.wire.codec import codec

FOREIGN = Path(__file__).parents[3] / "shared" / "data" / "foreign_bags"
FORM = codec(Point)
PAYLOADS = [serialize(FORM.encode(BagMake(), Point(k + 1, np.array([k, 0.0, 0.0]))), FORM.msgtype) for k in range(5000)]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    with BagWriter(tmp_path / "run", {"seed": "7"}) as writer:
        writer.add_topic("/a", FORM.msgtype)
        writer.add_topic("/b", FORM.msgtype, latched=True)
        for k, payload in enumerate(PAYLOADS):
            writer.write("/b" if k % 10 == 0 else "/a", 1000 + k, payload)
    return tmp_path / "run"


def test_what_is_written_reads_back(bag: Path) -> None:
    reader = Bag(bag)
    records = list(reader.records())
    assert [record.data for record in records] == PAYLOADS
    assert [record.t_ns for record in records] == list(range(1000, 6000))
    assert (reader.topics["/a"].latched, reader.topics["/b"].latched) == (False, True)
    assert reader.span() == (1000, 5999)
    assert reader.damage == []
    assert sum(1 for _ in reader.records(["/b"])) == 500


def test_rosbags_and_mcap_read_it(bag: Path) -> None:
    with AnyReader([bag]) as reader:
        assert reader.message_count == 5000
        values = [reader.deserialize(data, c.msgtype).point.x for c, _, data in reader.messages()]
        assert values == list(range(5000))
    with (bag / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 5000
        stored = {record.name: record.metadata for record in reader.iter_metadata()}
        assert stored["uw_acoustic_loc"] == {"version": __version__, "seed": "7"}
        assert stored["rosbag2"] == {"ROS_DISTRO": "jazzy"}
        channel = next(iter(reader.get_summary().channels.values()))
        assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
        assert reader.get_summary().schemas[channel.schema_id].data.startswith(b"std_msgs/Header header\n")
    assert Bag(bag).metadata == stored


def test_metadata_is_rosbag2s(bag: Path) -> None:
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (about["version"], about["storage_identifier"], about["message_count"]) == (9, "mcap", 5000)
    assert about["relative_file_paths"] == ["run_0.mcap"]
    topics = {t["topic_metadata"]["name"]: t for t in about["topics_with_message_count"]}
    assert topics["/b"]["message_count"] == 500
    assert topics["/b"]["topic_metadata"]["offered_qos_profiles"][0]["durability"] == "transient_local"
    assert topics["/a"]["topic_metadata"]["type_description_hash"].startswith("RIHS01_")


def test_an_existing_bag_is_not_overwritten(bag: Path) -> None:
    with pytest.raises(ValueError, match="run exists already: choose another name or remove it"):
        BagWriter(bag)


@pytest.mark.parametrize("kept", [0.9, 0.5, 0.1])
def test_a_truncated_bag_is_read_as_far_as_it_goes(bag: Path, kept: float) -> None:
    file = bag / "run_0.mcap"
    content = file.read_bytes()
    file.write_bytes(content[: int(kept * len(content))])
    reader = Bag(bag)
    records = list(reader.records())
    assert [r.data for r in records] == PAYLOADS[: len(records)]
    assert len(reader.damage) == 1
    assert str(file) in reader.damage[0]


def test_a_flipped_byte_is_noticed(bag: Path) -> None:
    file = bag / "run_0.mcap"
    content = bytearray(file.read_bytes())
    content[5000] ^= 0x40  # inside the first chunk of messages
    file.write_bytes(content)
    reader = Bag(bag)
    records = list(reader.records())
    assert all(record.data in set(PAYLOADS) for record in records)
    assert reader.damage


def test_an_empty_file_holds_nothing_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "empty.mcap").write_bytes(b"")
    reader = Bag(tmp_path / "empty.mcap")
    assert list(reader.records()) == []
    assert "damaged near byte 0" in reader.damage[0]


def test_a_missing_bag_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nothing does not exist"):
        Bag(tmp_path / "nothing")
    with pytest.raises(ValueError, match=r"holds no \.mcap or \.db3 file"):
        Bag(tmp_path)


@pytest.mark.skipif(not FOREIGN.exists(), reason="the rosbag2 test suite's bags are not on this machine")
@pytest.mark.parametrize(("name", "count"), [("talker", 20), ("wbag", 6074)])
def test_bags_of_the_rosbag2_test_suite(name: str, count: int) -> None:
    reader = Bag(FOREIGN / name)
    assert sum(Counter(record.topic for record in reader.records()).values()) == count
    assert reader.damage == []
