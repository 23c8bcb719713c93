"""Reads bags: rosbag2 folders or single files, MCAP or sqlite3, whole, split, compressed or damaged.

Everything that can be read is read; `Bag.damage` then has one sentence per damaged file.
"""

from __future__ import annotations

import heapq
import re
from collections.abc import Collection, Iterator
from itertools import chain, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml
import zstandard

from ..yaml_file import YAML_LOADER
from .storage.mcap_file import MAGIC, McapFile
from .storage.sqlite_file import MAGIC as SQLITE_MAGIC
from .storage.sqlite_file import SqliteFile
from .storage.stored import ZSTD_MAGIC, Damage, Record, Topic

__all__ = ["Bag", "Record", "Topic"]

_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")


class Bag:
    """A bag at `path`: a rosbag2 folder (with or without metadata.yaml) or a file.

    Raises:
        ValueError: there is nothing at `path`, it holds no bag, or none of its topics is encoded as cdr.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise ValueError(f"bag {path} does not exist")
        self.path = path
        self._notes: list[str] = []
        self._listed_count: int | None = None  # messages, by metadata.yaml
        self._scratch = TemporaryDirectory(prefix="uwloc_")  # of compressed files, as long as this object lives
        self.files = self._listed()
        self._damage = [Damage(file) for file in self.files]
        self._files = [self._open(file, damage) for file, damage in zip(self.files, self._damage, strict=True)]
        topics = {topic.name: topic for file in self._files for topic in file.topics}
        self.topics = {name: topic for name, topic in topics.items() if topic.encoding == "cdr"}
        self.refused = {name: topic for name, topic in topics.items() if topic.encoding != "cdr"}
        if self.refused and not self.topics:
            raise ValueError(f"bag {path}: {self._refusal(next(iter(self.refused)))}")

    @property
    def damage(self) -> list[str]:
        """What could not be read so far, in sentences; complete when `records` has been read to its end."""
        return [*self._notes, *(sentence for damage in self._damage for sentence in damage.sentences)]

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """MCAP's metadata records by name."""
        return {name: record for file in self._files for name, record in file.metadata.items()}

    def span(self) -> tuple[int, int]:
        """Returns log times in ns of the first and the last message; equal ones where the files do not have them."""
        spans = self._spans()
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else (0, 0)

    def records(self, topics: Collection[str] | None = None, by_time: bool = True) -> Iterator[Record]:
        """Yields messages (of `topics` only, when given) in the order of their log times, or as they were recorded."""
        for name in self.refused:
            if topics is None or name in topics:
                self._note(f"bag {self.path}: {self._refusal(name)}")
        wanted = None if topics is None else set(topics)
        streams = [file.records(wanted, by_time) for file in self._files]
        in_turn = not by_time or all(before[1] <= after[0] for before, after in pairwise(self._spans()))
        ordered = chain(*streams) if in_turn else heapq.merge(*streams, key=lambda record: record.t_ns)
        count = 0
        for record in ordered:
            count += 1
            yield record
        if wanted is None and not self.damage and self._listed_count not in (None, count):
            self._note(f"bag {self.path}: metadata.yaml lists {self._listed_count} messages, {count} are found")

    def _spans(self) -> list[tuple[int, int]]:
        return [span for file in self._files if (span := file.span())]

    def _refusal(self, name: str) -> str:
        return f"topic {name} is encoded as '{self.refused[name].encoding}', not cdr: it is not read"

    def _note(self, sentence: str) -> None:
        if sentence not in self._notes:
            self._notes.append(sentence)

    def _listed(self) -> list[Path]:
        if self.path.is_file():
            return [self.path]
        beside = sorted((file for file in self.path.iterdir() if file.name.endswith(_SUFFIXES)), key=_by_number)
        named = self._named()
        files = [file for name in named if (file := _found(self.path, name))]
        for name in named:
            if not _found(self.path, name):
                self._note(f"bag {self.path}: {name} is listed in metadata.yaml but missing")
        if not files and not beside:
            raise ValueError(self._notes[0] if self._notes else f"bag {self.path} holds no .mcap or .db3 file")
        return files or beside

    def _named(self) -> list[str]:
        """Returns the files that metadata.yaml lists; none when there is no such list."""
        listed = self.path / "metadata.yaml"
        if not listed.exists():
            return []
        try:
            about = yaml.load(listed.read_bytes(), YAML_LOADER)["rosbag2_bagfile_information"]
            self._listed_count = about.get("message_count")
            return [str(name) for name in about["relative_file_paths"]]
        except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError):
            self._note(f"bag {self.path}: metadata.yaml is not a rosbag2 description; the files beside it are read")
            return []

    def _open(self, file: Path, damage: Damage) -> McapFile | SqliteFile:
        with file.open("rb") as stream:
            start = stream.read(len(SQLITE_MAGIC))
        name = file.name
        if start.startswith(ZSTD_MAGIC) or name.endswith(".zstd"):
            name = name.removesuffix(".zstd")
            file = self._unpack(file, damage)
            with file.open("rb") as stream:
                start = stream.read(len(SQLITE_MAGIC))
        if start.startswith(SQLITE_MAGIC):
            return SqliteFile(file, damage, Path(self._scratch.name))
        if start.startswith(MAGIC) or name.endswith(".mcap"):
            return McapFile(file, damage)
        if name.endswith(".db3"):
            return SqliteFile(file, damage, Path(self._scratch.name))
        raise ValueError(f"bag {self.path}: {name} is neither an MCAP file nor an SQLite file")

    def _unpack(self, file: Path, damage: Damage) -> Path:
        """Unpacks a file that rosbag2 compressed as a whole, as far as it can be unpacked."""
        target = Path(self._scratch.name) / file.name
        with file.open("rb") as packed, target.open("wb") as out:
            unpacking: Any = zstandard.ZstdDecompressor().read_to_iter(packed, read_size=1 << 16)
            try:
                for piece in unpacking:
                    out.write(piece)
            except zstandard.ZstdError as error:
                damage.note(f"byte {packed.tell()}", f"it cannot be unpacked further ({error})")
        return target


def _found(folder: Path, name: str) -> Path | None:
    """Finds a listed file: in old bags its name begins with the folder's, or has no suffix of the compression."""
    tries = (folder / name, folder / Path(name).name, folder / f"{Path(name).name}.zstd")
    return next((file for file in tries if file.is_file()), None)


def _by_number(file: Path) -> list[tuple[int, str]]:
    """Sorts bag_2 before bag_10."""
    return [(int(part) if part.isdigit() else -1, part) for part in re.split(r"(\d+)", file.name)]
