"""A bag's own definitions win: messages of other distributions, of own types, and in IDL."""

from __future__ import annotations

import sqlite3
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from test.bag.foreign import START_NS, write_rosbags
from uw_acoustic_loc.bag.definitions import decoded, deserialized, jazzy_definition, read_definitions
from uw_acoustic_loc.bag.fingerprint import fingerprints
from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import encode
from uw_acoustic_loc.bag.storage.stored import Definition, Record, Topic
from uw_acoustic_loc.bag.writer import BagWriter
from uw_acoustic_loc.core.types import Point
from uw_acoustic_loc.graph import load_graph

MARKER = "visualization_msgs/msg/Marker"
FOXY = get_typestore(Stores.ROS2_FOXY)  # its Marker has neither texture nor mesh file
POINT = "geometry_msgs/msg/PointStamped"
IDL = """================================================================================
IDL: my_msgs/msg/Depth
module my_msgs {
  module msg {
    struct Depth {
      double depth;
      int32 count;
    };
  };
};
"""


def foxy_marker() -> tuple[Topic, bytes]:
    t = FOXY.types
    stamp = t["builtin_interfaces/msg/Time"](5, 6)
    pose = t["geometry_msgs/msg/Pose"](
        t["geometry_msgs/msg/Point"](1.0, 2.0, 3.0), t["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    colour = t["std_msgs/msg/ColorRGBA"](0.1, 0.2, 0.3, 1.0)
    message = t[MARKER](
        header=t["std_msgs/msg/Header"](stamp, "map"),
        ns="a",
        id=7,
        type=1,
        action=0,
        pose=pose,
        scale=t["geometry_msgs/msg/Vector3"](1.0, 1.0, 1.0),
        color=colour,
        lifetime=t["builtin_interfaces/msg/Duration"](0, 0),
        frame_locked=False,
        points=[],
        colors=[],
        text="hello",
        mesh_resource="mesh",
        mesh_use_embedded_materials=True,
    )
    definition = Definition(FOXY.generate_msgdef(MARKER, ros_version=2)[0], "ros2msg")
    qos = "- history: 1\n  depth: 7\n"
    return Topic("/theirs", MARKER, False, "cdr", definition, qos), bytes(FOXY.serialize_cdr(message, MARKER))


def write(path: Path, topic: Topic, data: bytes) -> Bag:
    with BagWriter(path) as writer:
        writer.copy_topic(topic)
        writer.write(topic.name, START_NS, data)
    return Bag(path)


def test_a_type_that_changed_between_distributions_is_read_by_the_bags_definition(tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", *foxy_marker())
    (record,) = bag.records()
    message = deserialized(record)
    assert (message.text, message.mesh_resource, message.id) == ("hello", "mesh", 7)
    assert not hasattr(message, "texture_resource")
    (found,) = fingerprints(bag).values()
    assert (found.count, found.raw) == (1, 0)


def test_what_is_only_copied_keeps_bytes_definition_and_qos(tmp_path: Path) -> None:
    topic, data = foxy_marker()
    with BagWriter(tmp_path / "bag") as writer:
        writer.copy_topic(topic)
        writer.write(topic.name, START_NS, data)
        writer.copy_topic(Topic("/json", "a/msg/B", False, "json"))
        writer.write("/json", START_NS, b"{}")
        writer.add_topic("/mooring/buoy1/offset", POINT)
        writer.write("/mooring/buoy1/offset", START_NS, encode(Point(START_NS, np.array([1.0, 0.0, 0.0]), "map")))
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: mooring_tracker, params: p.yaml}]", encoding="utf-8")
    (tmp_path / "p.yaml").write_text("mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}", encoding="utf-8")
    run = OfflineRun(Bag(tmp_path / "bag"), load_graph(tmp_path / "graph.yaml"), lambda *_: None)
    run.run(tmp_path / "out", True, lambda _: None)
    copied = Bag(tmp_path / "out")
    assert copied.topics["/theirs"] == topic
    assert [r.data for r in copied.records(["/theirs"])] == [data]
    assert [r.data for r in copied.records(["/json"])] == [b"{}"]


def test_several_types_on_one_topic_are_copied_as_they_were(tmp_path: Path) -> None:
    """Two of one name with different texts, and one in JSON, among them; the stage takes what is of its type."""
    offset = "/mooring/buoy1/offset"
    own, later = (encode(Point(START_NS + k, np.array([1.0, 0.0, 0.0]), "map")) for k in (0, 10**9))
    sent = [
        (Topic(offset, POINT, False, "cdr", jazzy_definition(POINT)), own),
        (Topic(offset, POINT, False, "cdr", Definition("float64 x", "ros2msg")), b"\0\1\0\0" + bytes(8)),
        (Topic(offset, "std_msgs/msg/String", False), b"\0\1\0\0\2\0\0\0a\0"),
        (Topic(offset, "a/msg/B", False, "json"), b"{}"),
        (Topic(offset, POINT, False, "cdr", jazzy_definition(POINT)), later),
    ]
    with BagWriter(tmp_path / "bag") as writer:
        for k, (topic, data) in enumerate(sent):
            writer.copy_topic(topic)
            writer.write(offset, START_NS + k, data)
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: mooring_tracker, params: p.yaml}]", encoding="utf-8")
    (tmp_path / "p.yaml").write_text("mooring_tracker: {ros__parameters: {mooring_ids: [buoy1]}}", encoding="utf-8")
    refused: list[str] = []
    run = OfflineRun(
        Bag(tmp_path / "bag"), load_graph(tmp_path / "graph.yaml"), lambda _, refusal: refused.append(refusal.sentence)
    )
    run.run(tmp_path / "out", True, lambda _: None)
    copied = [r for r in Bag(tmp_path / "out").records() if r.topic == offset]
    assert [(r.msgtype, r.encoding, r.data) for r in copied] == [(t.msgtype, t.encoding, data) for t, data in sent]
    assert [r.definition.text for r in copied[:2]] == [jazzy_definition(POINT).text, "float64 x"]
    assert len(refused) == 3
    (found,) = (one for topic, one in fingerprints(Bag(tmp_path / "bag")).items() if topic == offset)
    assert (found.count, found.raw) == (5, 1)


def test_a_definition_in_idl_is_read(tmp_path: Path) -> None:
    data = b"\0\1\0\0" + np.float64(2.5).tobytes() + np.int32(-3).tobytes()
    topic = Topic("/depth", "my_msgs/msg/Depth", False, "cdr", Definition(IDL, "ros2idl"))
    (record,) = write(tmp_path / "bag", topic, data).records()
    message = deserialized(record)
    assert (message.depth, message.count) == (2.5, -3)


def test_a_definition_without_its_parts_takes_them_from_the_distribution(tmp_path: Path) -> None:
    text = "std_msgs/Header header\nfloat64 depth\n"
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(text, "my_msgs/msg/Depth"))
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](1, 2), "map")
    data = bytes(store.serialize_cdr(store.types["my_msgs/msg/Depth"](header, 4.0), "my_msgs/msg/Depth"))
    topic = Topic("/depth", "my_msgs/msg/Depth", False, "cdr", Definition(text, "ros2msg"))
    (record,) = write(tmp_path / "bag", topic, data).records()
    assert deserialized(record).depth == 4.0


def test_a_differing_layout_is_decoded_or_says_which_field_it_lacks(tmp_path: Path) -> None:
    """Points in single precision feed a stage; points without a header do not, and the sentence names the field."""
    t = FOXY.types
    for text, sentence in (
        ("std_msgs/Header header\ngeometry_msgs/Point32 point\n", ""),
        ("std_msgs/Header header\nfloat64 x\n", "has no field 'point'"),
    ):
        store = get_typestore(Stores.EMPTY)
        own = get_types_from_msg(text, POINT)
        needed = ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "geometry_msgs/msg/Point32")
        store.register(own | {name: FOXY.fielddefs[name] for name in needed})
        header = t["std_msgs/msg/Header"](t["builtin_interfaces/msg/Time"](1, 2), "map")
        value = 4.0 if sentence else t["geometry_msgs/msg/Point32"](1.0, 2.0, 3.0)
        data = bytes(store.serialize_cdr(store.types[POINT](header, value), POINT))
        topic = Topic("/p", POINT, False, "cdr", Definition(text, "ros2msg"))
        (record,) = write(tmp_path / f"bag{len(text)}", topic, data).records()
        if sentence:
            with pytest.raises(ValueError, match=sentence):
                decoded(Point, record)
        else:
            assert decoded(Point, record).position.tolist() == [1.0, 2.0, 3.0]


def test_what_cannot_be_decoded_is_hashed_as_it_is(tmp_path: Path) -> None:
    topic, data = foxy_marker()
    broken = replace(topic, definition=Definition("this is no definition", "ros2msg"), msgtype="a/msg/B")
    (found,) = fingerprints(write(tmp_path / "bag", broken, data)).values()
    assert (found.count, found.raw) == (1, 1)


def test_sqlite_definitions_are_read(tmp_path: Path) -> None:
    path = write_rosbags(tmp_path / "bag", StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as base:
        base.execute("DELETE FROM message_definitions")
        base.execute(
            "INSERT INTO message_definitions(topic_type, encoding, encoded_message_definition, type_description_hash)"
            " VALUES (?, 'ros2msg', 'float64 depth', 'RIHS01_1')",
            (POINT,),
        )
    base.close()
    definitions = {topic.definition for topic in Bag(path).topics.values()}
    assert definitions == {Definition("float64 depth", "ros2msg", "RIHS01_1")}


def test_definitions_given_by_the_user_stand_in_where_the_bag_has_none(tmp_path: Path) -> None:
    topic = Topic("/depth", "my_msgs/msg/Depth", False)
    write(tmp_path / "bag", topic, b"\0\1\0\0" + np.float64(2.5).tobytes())
    given = Definition("float64 depth", "ros2msg")
    (record,) = Bag(tmp_path / "bag", {"my_msgs/msg/Depth": given}).records()
    assert deserialized(record).depth == 2.5


def test_our_own_bags_need_no_parsing(tmp_path: Path) -> None:
    """A text or a hash that is ROS 2 Jazzy's is known without being parsed."""
    from uw_acoustic_loc.bag.definitions import STORE, store_of

    own = jazzy_definition(POINT)
    assert store_of(POINT, own) is STORE
    assert store_of(POINT, replace(own, text="# comment\n" + own.text)) is STORE
    assert store_of(POINT, replace(own, text="# comment\n" + own.text, type_hash="")) is STORE


def test_a_folder_of_definitions_is_read_with_what_they_are_made_of(tmp_path: Path) -> None:
    for name, text in (("Depth", "Level[] levels\n"), ("Level", "float64 depth\nuint8 KIND=3\n")):
        file = tmp_path / "ws" / "my_msgs" / "msg" / f"{name}.msg"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    topic = Topic("/depth", "my_msgs/msg/Depth", False)
    write(tmp_path / "bag", topic, b"\0\1\0\0" + np.int32(1).tobytes() + bytes(4) + np.float64(2.5).tobytes())
    (record,) = Bag(tmp_path / "bag", read_definitions(tmp_path / "ws")).records()
    assert deserialized(record).levels[0].depth == 2.5
    with pytest.raises(ValueError, match="it has none"):
        read_definitions(tmp_path / "bag")


HOSTILE = {
    "a type that is a part of itself": "geometry_msgs/PointStamped next\n",
    "two that are parts of each other": f"a/B b\n{'=' * 80}\nMSG: a/B\ngeometry_msgs/PointStamped[] next\n",
    "a part that nobody defines": "nobody/Knows x\n",
    "billions of texts": "string[400000000] x\n",
    "parts that double forty times": "\n".join(
        ["a/T0 x", *(f"{'=' * 80}\nMSG: a/T{k}\na/T{k + 1} x\na/T{k + 1} y" for k in range(40)), "=" * 80, "MSG: a/T40"]
    ),
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE.keys())
def test_a_definition_that_leads_nowhere_is_as_none(text: str) -> None:
    own = Record("/t", "a/msg/Own", 1, bytes(68), Definition(text, "ros2msg"))
    of_itself = Definition(text.replace("geometry_msgs/PointStamped", "a/Own"), "ros2msg")
    with pytest.raises(ValueError, match="a/msg/Own is not known here, and the bag has no definition that can be read"):
        deserialized(own._replace(definition=of_itself))
    data = encode(Point(5, np.array([1.0, 2.0, 3.0])))
    assert decoded(Point, own._replace(msgtype=POINT, data=data)).t_ns == 5, "of a type of ROS its own one counts"


def test_a_file_of_the_message_path_that_is_no_definition_is_named(tmp_path: Path) -> None:
    (tmp_path / "a/msg/Folder.msg").mkdir(parents=True)
    (tmp_path / "a/msg/Good.msg").write_bytes(b"\xef\xbb\xbffloat64 x\r\n")  # as an editor of Windows writes it
    assert set(read_definitions(tmp_path)) == {"a/msg/Good"}
    (tmp_path / "a/msg/Bad.msg").write_text("float64\n(((\n")
    with pytest.raises(ValueError, match=r"^a/Bad\.msg of the message path is no message definition$"):
        read_definitions(tmp_path)
