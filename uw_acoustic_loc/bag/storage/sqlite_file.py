"""A bag file of rosbag2's older storage: an SQLite data base with tables `topics` and `messages`."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from .stored import NO_DEFINITION, Damage, Definition, Record, Topic, full_type, is_latched, unpacked

MAGIC = b"SQLite format 3\0"


class SqliteFile:
    """The file at `path`; `damage` takes the notes, `scratch` a copy of a file that is damaged or cannot be opened."""

    def __init__(self, path: Path, damage: Damage, scratch: Path) -> None:
        self._damage = damage
        self._path = self._openable(self._whole_pages(path, scratch), scratch)
        self.metadata: dict[str, dict[str, str]] = {}
        self._topics: dict[int, Topic] = {}
        try:
            with closing(self._connect()) as base:
                self._topics = dict(_topics(base, damage))
        except (sqlite3.Error, ValueError) as error:
            damage.note("the table of topics", str(error))

    @property
    def topics(self) -> list[Topic]:
        """All topics, with or without messages."""
        return list(self._topics.values())

    def span(self) -> tuple[int, int] | None:
        """Returns first and last log time in ns."""
        try:
            with closing(self._connect()) as base:
                _check_table(base, "messages")
                query = "SELECT min(timestamp), max(timestamp) FROM messages WHERE timestamp > 0"
                first, last = base.execute(query).fetchone()
        except (sqlite3.Error, ValueError):
            return None
        return (first, last) if isinstance(first, int) and isinstance(last, int) else None

    def records(self, topics: set[str] | None, by_time: bool) -> Iterator[Record]:
        """Yields messages in the order of their log times, or as they were recorded.

        Messages whose entry in the index of times is damaged come last.
        """
        given: set[int] = set()
        for order in (
            ("timestamp, id", "id") if by_time else ("id",)
        ):  # the index of times may be damaged where the messages are not
            try:
                with closing(self._connect()) as base:
                    _check_table(base, "messages")
                    query = f"SELECT id, topic_id, timestamp, data FROM messages ORDER BY {order}"
                    for row in base.execute(query):
                        if row[0] not in given:
                            given.add(row[0])
                            yield from self._record(topics, *row)
                return
            except (sqlite3.Error, ValueError) as error:
                self._damage.note(f"message {len(given) + 1}", str(error))

    def _record(self, topics: set[str] | None, number: int, topic_id: int, t_ns: Any, data: Any) -> Iterator[Record]:
        topic = self._topics.get(topic_id)
        if topic is None or not isinstance(t_ns, int) or not isinstance(data, bytes):
            self._damage.note(f"message {number}", "it has no topic, time or content that can be read")
        elif t_ns < 0:
            self._damage.note(f"message {number}", f"its log time of {t_ns} ns lies before 1970")
        elif topics is None or topic.name in topics:
            try:
                yield Record(topic.name, topic.msgtype, t_ns, unpacked(data), topic.definition, topic.encoding)
            except ValueError as error:
                self._damage.note(f"message {number}", f"{topic.name}: {error}")

    def _whole_pages(self, path: Path, scratch: Path) -> Path:
        """Copies the file without its last page when that is cut: SQLite would read the missing bytes as zeros."""
        with path.open("rb") as stream:
            header, size = stream.read(32), stream.seek(0, 2)
        page, count = (int.from_bytes(header[16:18]), int.from_bytes(header[28:32])) if len(header) == 32 else (1, 0)
        page = 65536 if page == 1 else page
        self._cut = bool(page) and size < page * count and not _journal(path).exists()
        if not self._cut:
            return path
        self._damage.note(f"byte {size}", f"the file ends here, it must have {page * count} bytes")
        copy = scratch / f"{path.name}.whole"
        shutil.copyfile(path, copy)
        with copy.open("r+b") as stream:
            stream.truncate(size - size % page)
        return copy

    def _openable(self, path: Path, scratch: Path) -> Path:
        """The file, or a copy where SQLite cannot open it: a journal wants a writable folder."""
        self._path = path
        try:
            with closing(self._connect()) as base:
                base.execute("SELECT count(*) FROM sqlite_master").fetchone()
        except sqlite3.OperationalError:
            if not _journal(path).exists():
                return path  # something else is wrong, and will be said
            shutil.copyfile(_journal(path), _journal(scratch / path.name))
            return Path(shutil.copyfile(path, scratch / path.name))
        except sqlite3.Error:
            return path
        return path

    def _connect(self) -> sqlite3.Connection:
        options = "mode=ro" if _journal(self._path).exists() else "mode=ro&immutable=1"
        base = sqlite3.connect(f"{self._path.resolve().as_uri()}?{options}", uri=True)
        if self._cut:
            base.execute("PRAGMA writable_schema=ON")  # else SQLite refuses a file with fewer pages than it should have
        base.text_factory = lambda raw: raw.decode(errors="replace")
        return base


def _journal(path: Path) -> Path:
    """Returns where a recorder that was killed left what is not yet in the file."""
    return path.with_name(f"{path.name}-wal")


def _check_table(base: sqlite3.Connection, name: str) -> None:
    """A view of that name could go on for ever."""
    kind = base.execute("SELECT type FROM sqlite_master WHERE name = ?", (name,)).fetchone()
    if kind is None or kind[0] != "table":
        raise ValueError(f"`{name}` must be a table, it is {'missing' if kind is None else f'a {kind[0]}'}")


def _columns(base: sqlite3.Connection, table: str) -> set[str]:
    return {row[1] for row in base.execute(f"PRAGMA table_info({table})")}


def _topics(base: sqlite3.Connection, damage: Damage) -> Iterator[tuple[int, Topic]]:
    _check_table(base, "topics")
    qos = "offered_qos_profiles" if "offered_qos_profiles" in _columns(base, "topics") else "''"  # 2019 had none
    definitions = _definitions(base)
    for row in base.execute(f"SELECT id, name, type, serialization_format, {qos} FROM topics"):
        number, *texts = row
        if not all(isinstance(text, str) for text in texts):
            damage.note(f"topic {number}", f"its name, type, format and QoS must be texts, got {texts!r:.200}")
            continue
        name, msgtype, form, profiles = texts
        definition = definitions.get(full_type(msgtype), NO_DEFINITION)
        yield number, Topic(name, full_type(msgtype), is_latched(profiles), form, definition, profiles)


def _definitions(base: sqlite3.Connection) -> dict[str, Definition]:
    """By type, from the table that rosbag2 writes since 2023."""
    wanted = ("topic_type", "encoded_message_definition", "encoding", "type_description_hash")
    if not set(wanted) <= _columns(base, "message_definitions"):
        return {}
    _check_table(base, "message_definitions")
    rows = base.execute(f"SELECT {', '.join(wanted)} FROM message_definitions")
    return {full_type(row[0]): Definition(*row[1:]) for row in rows if all(isinstance(text, str) for text in row)}
