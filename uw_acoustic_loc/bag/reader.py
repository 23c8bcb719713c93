"""Reads bags: rosbag2 folders or single files, MCAP or sqlite3, whole, split, compressed or damaged.

Everything that can be read is read; `Bag.damage` then has one sentence per damaged file.
"""

from __future__ import annotations

import heapq
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from ..yaml_file import YAML_LOADER
from .storage.compression import ZSTD_MAGIC, unpack_file
from .storage.mcap_file import MAGIC, McapFile
from .storage.sqlite_file import MAGIC as SQLITE_MAGIC
from .storage.sqlite_file import SqliteFile
from .storage.stored import Damage, Definition, Record, Topic

__all__ = ["Bag", "Definition", "Record", "Topic"]

_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")


class Bag:
    """A bag at `path`: a rosbag2 folder (with or without metadata.yaml) or a file.

    `definitions` stand in where the bag carries none of a type. Messages that are not CDR (JSON, Protocol Buffers) are
    listed in `refused`; they can be copied and hashed.

    Raises:
        ValueError: there is nothing at `path`, or it holds no bag.
    """

    def __init__(self, path: Path | str, definitions: Mapping[str, Definition] | None = None) -> None:
        path = Path(path)
        if not path.exists():
            raise ValueError(f"bag {path} does not exist")
        self.path = path
        self._notes: list[str] = []
        self._listed_count: int | None = None  # messages, by metadata.yaml
        self._scratch = TemporaryDirectory(prefix="uwloc_")  # of compressed files, as long as this object lives
        self.files = self._listed()
        self._damage = [Damage(file) for file in self.files]
        self._files = [self._open(file, damage) for file, damage in zip(self.files, self._damage, strict=True)]
        self._definitions = dict(definitions or {})
        listed = [self._defined(topic) for file in self._files for topic in file.topics]
        topics = {topic.name: topic for topic in sorted(listed, key=lambda topic: topic.encoding == "cdr")}
        types = {(topic.name, topic.msgtype): None for topic in listed}
        self.types = {name: [msgtype for one, msgtype in types if one == name] for name in topics}
        self.topics = {name: topic for name, topic in topics.items() if topic.encoding == "cdr"}
        self.refused = {name: topic for name, topic in topics.items() if topic.encoding != "cdr"}

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
        """Messages in the order of their log times, or else as they were recorded: all that are CDR, or of `topics`."""
        wanted = (set(self.topics) if self.refused else None) if topics is None else set(topics)
        streams = [file.records(wanted, by_time) for file in self._files]
        in_turn = not by_time or all(before[1] <= after[0] for before, after in pairwise(self._spans()))
        ordered = chain(*streams) if in_turn else heapq.merge(*streams, key=lambda record: record.t_ns)
        count = 0
        for record in ordered:
            count += 1
            yield record if record.definition.text or not self._definitions else self._given(record)
        if wanted is None and not self.damage and self._listed_count not in (None, count):
            self._note(f"bag {self.path}: metadata.yaml lists {self._listed_count} messages, {count} are found")

    def _spans(self) -> list[tuple[int, int]]:
        return [span for file in self._files if (span := file.span())]

    def _defined(self, topic: Topic) -> Topic:
        given = self._definitions.get(topic.msgtype)
        return replace(topic, definition=given) if given and not topic.definition.text else topic

    def _given(self, record: Record) -> Record:
        return record._replace(definition=self._definitions.get(record.msgtype, record.definition))

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
            if _outside(name):
                self._note(f"bag {self.path}: {name} is listed in metadata.yaml and lies outside of the bag")
            elif not _found(self.path, name):
                self._note(f"bag {self.path}: {name} is listed in metadata.yaml but missing")
        if not files and not beside:
            raise ValueError(self._notes[0] if self._notes else f"bag {self.path} holds no .mcap or .db3 file")
        stems = {_stem(file) for file in files}
        unlisted = [file for file in beside if _stem(file) not in stems]
        if files and unlisted:
            names = ", ".join(file.name for file in unlisted)
            self._note(f"bag {self.path}: {names} is not listed in metadata.yaml; it is read as well")
        return sorted([*files, *unlisted], key=_by_number) if unlisted else files

    def _named(self) -> list[str]:
        """Returns the files that metadata.yaml lists; none when there is no such list."""
        listed = self.path / "metadata.yaml"
        if not listed.exists():
            return []
        try:
            about = yaml.load(listed.read_bytes(), YAML_LOADER)["rosbag2_bagfile_information"]
            count = about.get("message_count")
            self._listed_count = count if isinstance(count, int) else None
            return [*dict.fromkeys(str(name) for name in about["relative_file_paths"])]
        except (yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError, RecursionError):
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
            try:
                unpack_file(packed, out, file.stat().st_size)
            except ValueError as error:
                damage.note(f"byte {packed.tell()}", f"it cannot be unpacked further ({error})")
        return target


def _found(folder: Path, name: str) -> Path | None:
    """Finds a listed file: in old bags its name begins with the folder's, or has no suffix of the compression."""
    if _outside(name):
        return None
    tries = (folder / name, folder / Path(name).name, folder / f"{Path(name).name}.zstd")
    try:
        return next((file for file in tries if file.is_file()), None)
    except OSError:  # a name that is too long for the file system
        return None


def _outside(name: str) -> bool:
    """Whether a name in metadata.yaml leads out of the bag's folder: that of a folder beside it may stand before."""
    return Path(name).is_absolute() or ".." in Path(name).parts


def _stem(file: Path) -> str:
    """Without what compression adds: one recording, twice in a folder, is read once."""
    return file.name.removesuffix(".zstd")


def _by_number(file: Path) -> list[tuple[int, str]]:
    """Sorts bag_2 before bag_10."""
    return [(int(part) if part.isdigit() else -1, part) for part in re.split(r"(\d+)", file.name)]
