"""The bag reader with damaged files and descriptions: messages and sentences, never another exception."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from test.bag.foreign import VARIANTS
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.survey import survey
from uw_acoustic_loc.bag.usable import uses

EDITS = st.lists(
    st.tuples(st.sampled_from(["set", "cut", "insert", "remove", "zero"]), st.floats(0, 1), st.binary(max_size=12)),
    min_size=1,
    max_size=4,
)


def edited(whole: bytes, edits: list[tuple[str, float, bytes]]) -> bytes:
    content = bytearray(whole)
    for kind, where, piece in edits:
        at = int(where * len(content))
        if kind == "set":
            content[at : at + len(piece)] = piece
        elif kind == "cut":
            del content[at:]
        elif kind == "insert":
            content[at:at] = piece
        elif kind == "remove":
            del content[at : at + len(piece)]
        else:
            content[at : at + 100] = bytes(len(content[at : at + 100]))
    return bytes(content)


@dataclass(frozen=True, repr=False)
class Whole:
    """A bag, one of its files, and what that holds when it is whole."""

    path: Path
    file: Path
    content: bytes


@pytest.fixture(scope="module", params=["zstd chunks", "lz4 chunks", "no chunks", "no summary", "zstd file", "sqlite3"])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Whole:
    path = VARIANTS[request.param](tmp_path_factory.mktemp("fuzz"))
    file = path if path.is_file() else next(file for file in path.iterdir() if file.suffix != ".yaml")
    return Whole(path, file, file.read_bytes())


@given(edits=EDITS)
def test_a_damaged_file_is_read_or_refused(bag: Whole, edits: list[tuple[str, float, bytes]]) -> None:
    bag.file.write_bytes(edited(bag.content, edits))
    read(bag.path)
    bag.file.write_bytes(bag.content)


@given(edits=EDITS)
def test_a_damaged_description_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, edits: list[tuple[str, float, bytes]]
) -> None:
    path = VARIANTS["zstd file"](tmp_path_factory.mktemp("fuzz"))
    listed = path / "metadata.yaml"
    listed.write_bytes(edited(listed.read_bytes(), edits))
    read(path)


@given(content=st.binary(max_size=200), suffix=st.sampled_from([".mcap", ".db3", ".mcap.zstd", ".db3.zstd", ".txt"]))
def test_any_bytes_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes, suffix: str) -> None:
    path = tmp_path_factory.mktemp("fuzz") / f"x{suffix}"
    for magic in (b"", b"\x89MCAP0\r\n", b"SQLite format 3\0", b"\x28\xb5\x2f\xfd"):
        path.write_bytes(magic + content)
        read(path)


def read(path: Path) -> None:
    try:
        bag = Bag(path)
        found = survey(bag)
        uses(found)
        assert sum(topic.count for topic in found.topics.values()) == sum(1 for _ in bag.records())
    except ValueError as error:
        assert str(path) in str(error)
        return
    assert all(isinstance(sentence, str) and str(path) in sentence for sentence in bag.damage)
