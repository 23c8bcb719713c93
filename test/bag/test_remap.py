"""Topics of a bag under other names."""

from pathlib import Path

import pytest

from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.remap import RemappedBag, remaps
from uw_acoustic_loc.bag.writer import BagWriter


@pytest.fixture
def bag(tmp_path: Path) -> Bag:
    with BagWriter(tmp_path / "bag") as writer:
        for k, topic in enumerate(["/a", "/b", "/a", "/c"], 1):
            writer.add_topic(topic, "std_msgs/msg/Empty", latched=topic == "/b")
            writer.write(topic, k, bytes([0, 1, 0, 0, k]))
    return Bag(tmp_path / "bag")


def test_messages_come_under_their_new_names_and_in_order(bag: Bag) -> None:
    renamed = RemappedBag(bag, {"/a": "/ours/a", "/b": "/a"})
    assert [(r.topic, r.t_ns) for r in renamed.records()] == [("/ours/a", 1), ("/a", 2), ("/ours/a", 3), ("/c", 4)]
    assert [(r.topic, r.t_ns) for r in renamed.records(["/a", "/nothing"])] == [("/a", 2)]
    assert {name: (topic.name, topic.latched) for name, topic in renamed.topics.items()} == {
        "/ours/a": ("/ours/a", False),
        "/a": ("/a", True),
        "/c": ("/c", False),
    }
    assert (renamed.path, renamed.span(), renamed.damage) == (bag.path, bag.span(), [])


def test_what_cannot_be_renamed_is_refused(bag: Bag) -> None:
    with pytest.raises(ValueError, match=r"has no topic /x to be renamed, it has /a, /b, /c"):
        RemappedBag(bag, {"/x": "/y"})
    with pytest.raises(ValueError, match=r"/a and /b would both be /b"):
        RemappedBag(bag, {"/a": "/b"})


def test_pairs_are_two_full_names() -> None:
    assert remaps(["/a:=/b", "/c:=/d/e"]) == {"/a": "/b", "/c": "/d/e"}
    for bad in ("/a", "a:=/b", "/a:=b", "/a=/b", ""):
        with pytest.raises(ValueError, match=r"a renaming must be two full topic names as in /theirs:=/ours"):
            remaps([bad])
    with pytest.raises(ValueError, match="/a is renamed twice"):
        remaps(["/a:=/b", "/a:=/c"])
