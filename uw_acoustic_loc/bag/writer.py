"""Writes a rosbag2 bag: one MCAP file with CRCs, message definitions and QoS profiles, and its metadata.yaml."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from ..version import __version__
from .definitions import jazzy_definition
from .metadata import ROS_DISTRO, described, earlier, metadata_text, qos_text
from .storage.stored import Definition, Topic, qos_profiles

_Key = tuple[str, str, str, Definition]  # topic, type, encoding: several of these may share the topic's name


class BagWriter:
    """A new bag folder at `path`; `about` is stored with the package's version as the metadata `uw_acoustic_loc`.

    What is written before an interruption stays readable. When nothing more can be written (disk full), OSError names
    the bag once, the file ends behind its last whole block, and everything later is left out. With `resume` a bag that
    exists goes on in a further file.

    Raises:
        ValueError: `path` exists already, or cannot be made.
    """

    def __init__(self, path: Path, about: dict[str, str] | None = None, resume: bool = False) -> None:
        if path.exists() and not resume:
            raise ValueError(f"bag {path} exists already: choose another name or remove it")
        try:
            path.mkdir(parents=True, exist_ok=resume)
        except OSError as error:
            raise ValueError(f"bag {path} cannot be made: {error.strerror}") from None
        self.path = path
        self._channels: dict[_Key, int] = {}
        self._keys: dict[str, _Key] = {}  # of the topic's latest declaration
        self._schemas: dict[tuple[str, Definition], int] = {}
        self._topics: dict[_Key, dict[str, Any]] = {}
        self._first, self._last = 0, 0
        self._saved = _Saved({}, 0, 0)
        self._open = True
        self._earlier = earlier(path)
        self._file = _File(path / f"{path.name}_{len(self._earlier.files)}.mcap")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD, enable_data_crcs=True)  # type: ignore[arg-type]
        try:
            self._whole(lambda: self._start(about or {}))
        except OSError:
            self._file.remove()  # nothing is in it
            raise

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def counts(self) -> dict[str, int]:
        """How many messages were written per topic."""
        counts: dict[str, int] = {}
        for (name, *_), topic in self._topics.items():
            counts[name] = counts.get(name, 0) + topic["message_count"]
        return counts

    def add_topic(self, name: str, msgtype: str, latched: bool = False) -> None:
        """Declares a topic of ROS 2 Jazzy's definition of its type; again is harmless."""
        self.copy_topic(Topic(name, msgtype, latched))

    def copy_topic(self, topic: Topic) -> None:
        """Declares a topic of another bag with its definition, encoding and QoS as they are there."""
        definition = topic.definition if topic.definition.text else jazzy_definition(topic.msgtype)
        self._keys[topic.name] = key = (topic.name, topic.msgtype, topic.encoding, definition)
        if key in self._channels or not self._open:
            return
        qos = topic.qos or qos_text(topic.latched)
        stored = {"offered_qos_profiles": qos, "topic_type_hash": definition.type_hash}
        self._channels[key] = self._writer.register_channel(
            topic.name, topic.encoding, self._schema(topic.msgtype, definition), stored
        )
        described = {
            "name": topic.name,
            "type": topic.msgtype,
            "serialization_format": topic.encoding,
            "offered_qos_profiles": qos_profiles(qos),
            "type_description_hash": definition.type_hash,
        }
        self._topics[key] = {"topic_metadata": described, "message_count": 0}

    def _schema(self, msgtype: str, definition: Definition) -> int:
        key = (msgtype, definition)
        if key not in self._schemas:
            language = definition.language or "ros2msg"
            self._schemas[key] = self._writer.register_schema(msgtype, language, definition.text.encode())
        return self._schemas[key]

    def write(self, name: str, t_ns: int, data: bytes, published_ns: int = 0) -> None:
        """Appends the CDR bytes of a message of a declared topic, received at t_ns."""
        if not self._open:
            return
        key = self._keys[name]
        self._topics[key]["message_count"] += 1
        self._first = min(self._first or t_ns, t_ns)
        self._last = max(self._last, t_ns)
        self._whole(lambda: self._writer.add_message(self._channels[key], t_ns, data, published_ns or t_ns))

    def flush(self) -> None:
        """Hands everything over to the operating system, so that the end of this process cannot lose it."""
        self._whole(self._writer.flush)

    def close(self) -> None:
        """Finishes the file and writes metadata.yaml."""
        if not self._open:
            return
        self._whole(self._writer.flush)
        self._whole(self._writer.finish)
        self._end()

    def _start(self, about: dict[str, str]) -> None:
        self._writer.start(profile="ros2", library=f"uw_acoustic_loc {__version__}")
        self._writer.add_metadata("rosbag2", {"ROS_DISTRO": ROS_DISTRO})
        self._writer.add_metadata("uw_acoustic_loc", {"version": __version__, **about})

    def _whole(self, write: Callable[[], None]) -> None:
        """Writes, or leaves the file as it was before and ends the bag."""
        if not self._open:
            return
        good = self._file.tell()
        try:
            write()
        except OSError as error:
            self._file.cut(good)
            self._forget_lost()
            with suppress(OSError):
                self._file.write(_end_of_file())
            self._end()
            raise OSError(error.errno, f"{error.strerror}; what was written is kept", str(self.path)) from None
        if self._file.tell() > good:
            self._saved = _Saved(self._counted(), self._first, self._last)

    def _counted(self) -> dict[_Key, int]:
        return {key: topic["message_count"] for key, topic in self._topics.items()}

    def _forget_lost(self) -> None:
        """Takes back the counts of what has not reached the file."""
        for key, topic in self._topics.items():
            topic["message_count"] = self._saved.counts.get(key, 0)
        self._first, self._last = self._saved.first, self._saved.last

    def _end(self) -> None:
        self._open = False
        self._file.close()
        listed = self.path / "metadata.yaml"
        try:
            own = described(self._file.path.name, sum(self.counts.values()), self._first, self._last)
            listed.write_text(metadata_text(self._earlier, own, list(self._topics.values())))
        except OSError:  # as full as before: a bag without it can be read, one with half of it cannot
            listed.unlink(missing_ok=True)


@dataclass(frozen=True)
class _Saved:
    """What has reached the file: messages per topic, first and last log time in ns."""

    counts: dict[_Key, int]
    first: int
    last: int


def _end_of_file() -> bytes:
    """Returns the end of an MCAP file without a summary."""
    records = RecordBuilder()
    DataEnd(data_section_crc=0).write(records)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(records)
    return bytes(records.end()) + MCAP0_MAGIC  # type: ignore[no-untyped-call]


class _File:
    """A file without a buffer: what `write` has returned from is with the operating system."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        self._end = 0

    def write(self, data: bytes) -> int:
        left = memoryview(data)
        while left:
            done = os.write(self._number, left)  # a full disk takes a part first, and then raises
            self._end += done
            left = left[done:]
        return len(data)

    def tell(self) -> int:
        return self._end

    def flush(self) -> None:
        pass

    def cut(self, size: int) -> None:
        """Takes back what was written behind `size`."""
        os.ftruncate(self._number, size)
        self._end = os.lseek(self._number, size, os.SEEK_SET)

    def close(self) -> None:
        os.close(self._number)

    def remove(self) -> None:
        """Of a file that is closed."""
        self.path.unlink(missing_ok=True)
