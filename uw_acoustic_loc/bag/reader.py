"""Reads bags: rosbag2 folders or single files, MCAP by the mcap library, sqlite3 by rosbags.

A damaged MCAP file is read as far as it goes; `Bag.damage` then says where reading stopped.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader


@dataclass(frozen=True)
class Record:
    """A message as it stands in the bag."""

    topic: str
    msgtype: str
    t_ns: int  # log time
    data: bytes


@dataclass(frozen=True)
class Topic:
    """A topic of the bag."""

    name: str
    msgtype: str
    latched: bool


class Bag:
    """A bag at `path`: a rosbag2 folder (with or without metadata.yaml) or a file.

    Raises:
        ValueError: there is nothing at `path`, or it holds no bag.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise ValueError(f"bag {path} does not exist")
        self.path = path
        self.damage: list[str] = []
        self._files = _files(path)
        self.topics = {topic.name: topic for file in self._files for topic in _topics(file)}

    def span(self) -> tuple[int, int]:
        """Log times of the first and the last message in ns, as far as the files tell; equal when they do not."""
        spans = [span for file in self._files if (span := _span(file))]
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else (0, 0)

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """Messages (of `topics` only, when given) in the order of their log times, file by file."""
        for file in self._files:
            yield from _read(file, topics, self.damage)


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    listed = path / "metadata.yaml"
    if listed.exists():
        try:
            about = yaml.safe_load(listed.read_text())["rosbag2_bagfile_information"]
            files = [path / name for name in about["relative_file_paths"]]
        except (yaml.YAMLError, KeyError, TypeError):
            raise ValueError(f"bag {path}: metadata.yaml is not a rosbag2 description") from None
    else:
        files = sorted([*path.glob("*.mcap"), *path.glob("*.db3")])
    if not files:
        raise ValueError(f"bag {path} holds no .mcap or .db3 file")
    for file in files:
        if not file.exists():
            raise ValueError(f"bag {path}: {file.name} is listed in metadata.yaml but missing")
    return files


def _topics(file: Path) -> Iterator[Topic]:
    if file.suffix == ".db3":
        for topic, msgtype, qos in _sqlite_topics(file):
            yield Topic(topic, msgtype, "transient_local" in qos)
        return
    for channel, schema in _channels(file):
        if channel.message_encoding != "cdr":
            raise ValueError(f"bag {file}: topic {channel.topic} is encoded as '{channel.message_encoding}', not cdr")
        yield Topic(channel.topic, schema.name if schema else "", _latched(channel))


def _latched(channel: Channel) -> bool:
    """Durability is written as a name by new rosbag2, as 1 (transient local) by old."""
    try:
        profiles = yaml.safe_load(channel.metadata.get("offered_qos_profiles", "")) or []
        return any(profile.get("durability") in ("transient_local", 1) for profile in profiles)
    except (yaml.YAMLError, AttributeError):
        return False


def _channels(file: Path) -> list[tuple[Channel, Schema | None]]:
    with file.open("rb") as stream:
        try:
            summary = SeekingReader(stream).get_summary()
        except _DAMAGE:
            summary = None
    if summary is not None and summary.channels:
        return [(channel, summary.schemas.get(channel.schema_id)) for channel in summary.channels.values()]
    found: dict[int, tuple[Channel, Schema | None]] = {}
    for schema, channel, _message in _prefix(file, []):
        found[channel.id] = (channel, schema)
    return list(found.values())


def _span(file: Path) -> tuple[int, int] | None:
    with file.open("rb") as stream:
        try:
            summary = SeekingReader(stream).get_summary()
        except _DAMAGE:
            return None
    statistics = summary.statistics if summary else None
    return (statistics.message_start_time, statistics.message_end_time) if statistics else None


_DAMAGE = (McapError, struct.error, EOFError, ValueError, KeyError)


def _read(file: Path, topics: Collection[str] | None, damage: list[str]) -> Iterator[Record]:
    if file.suffix == ".db3":
        yield from _sqlite_records(file, topics)
        return
    for schema, channel, message in _messages(file, topics, damage):
        if topics is None or channel.topic in topics:
            yield Record(channel.topic, schema.name if schema else "", message.log_time, message.data)


def _messages(
    file: Path, topics: Collection[str] | None, damage: list[str]
) -> Iterator[tuple[Schema | None, Channel, Message]]:
    count = 0
    with file.open("rb") as stream:
        try:
            reader = SeekingReader(stream, validate_crcs=True)
            summary = reader.get_summary()
            if summary is None or not summary.chunk_indexes:
                raise McapError("no index")
            for item in reader.iter_messages(topics=list(topics) if topics is not None else None):
                count += 1
                yield item
            return
        except _DAMAGE as error:
            if count:
                damage.append(f"bag {file}: reading stopped after {count} messages: {error}")
                return
    yield from _prefix(file, damage)


def _prefix(file: Path, damage: list[str]) -> Iterator[tuple[Schema | None, Channel, Message]]:
    """What can be read from the front of a file without an index."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with file.open("rb") as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True, record_size_limit=None).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    yield schemas.get(channel.schema_id), channel, record
        except _DAMAGE as error:
            damage.append(f"bag {file}: damaged near byte {stream.tell()}: {str(error) or type(error).__name__}")


def _sqlite_topics(file: Path) -> Iterator[tuple[str, str, str]]:
    with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as base:
        for topic, msgtype, form, qos in base.execute(
            "SELECT name, type, serialization_format, offered_qos_profiles FROM topics"
        ):
            if form != "cdr":
                raise ValueError(f"bag {file}: topic {topic} is encoded as '{form}', not cdr")
            yield topic, msgtype, qos


def _sqlite_records(file: Path, topics: Collection[str] | None) -> Iterator[Record]:
    with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as base:
        rows = base.execute(
            "SELECT topics.name, topics.type, timestamp, data FROM messages JOIN topics ON topic_id = topics.id"
            " ORDER BY timestamp"
        )
        for topic, msgtype, t_ns, data in rows:
            if topics is None or topic in topics:
                yield Record(topic, msgtype, t_ns, data)
