"""An MCAP file, read block by block: a damaged block costs its own messages, not those after it.

With an intact summary the blocks are its chunk indexes; without one they are found by walking from record to record,
until the file ends or a record's length makes no sense.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_left
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Metadata, MetadataIndex, Schema, Statistics

from .mcap_blocks import HEAD, McapBlock, append, bytes_at, known, payload_of, split, times
from .stored import Damage, Definition, Record, Topic, full_type, is_latched, unpacked

MAGIC = b"\x89MCAP0\r\n"
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_TAIL = HEAD.size + 20 + len(MAGIC)  # footer and magic
_DATA_END = HEAD.size + 4
_PIECE = 1 << 20
_LAST_NS = (1 << 63) - 1  # of ROS's clocks
_BROKEN = (McapError, struct.error, ValueError, MemoryError, RuntimeError, OverflowError)  # lz4: RuntimeError

_Message = tuple[int, int, bytes]  # log time, channel, CDR


class McapFile:
    """The file at `path`; `damage` takes the notes."""

    def __init__(self, path: Path, damage: Damage) -> None:
        self._path, self._damage = path, damage
        self.metadata: dict[str, dict[str, str]] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._topics: dict[int, Topic] = {}  # by channel
        with path.open("rb") as stream:
            self._size = stream.seek(0, 2)
            self._listed_count: int | None = None  # messages, by the summary's statistics
            self._data_end = 0  # where the record of the data's CRC begins
            if self._size == 0:
                damage.note("byte 0", "the file is empty")
            elif bytes_at(stream, 0, len(MAGIC)) != MAGIC:
                damage.note("byte 0", "the file does not begin as an MCAP file")
            self._blocks = self._indexed(stream) or self._walked(stream)
            if not self._channels or any(
                c.schema_id and c.schema_id not in self._schemas for c in self._channels.values()
            ):
                for block in self._blocks:
                    self._parse(stream, block)

    @property
    def topics(self) -> list[Topic]:
        """All topics, with or without messages."""
        return list(self._topics.values())

    def span(self) -> tuple[int, int] | None:
        """First and last log time in ns, as the file's index has them; messages of log time 0 do not count."""
        timed = [block for block in self._blocks if block.last_ns]
        return (min(b.first_ns or b.last_ns for b in timed), max(b.last_ns for b in timed)) if timed else None

    def records(self, topics: set[str] | None, by_time: bool) -> Iterator[Record]:
        """Yields messages in the order of their log times (equal ones as in the file), or all as in the file."""
        blocks = sorted(self._blocks, key=lambda block: block.first_ns if by_time else block.begin)
        pending: list[_Message] = []
        count = 0
        with self._path.open("rb") as stream:
            for k, block in enumerate(blocks):
                found = self._parse(stream, block)
                count += len(found)
                pending += self._wanted(found, topics)
                ready = len(pending)
                if by_time:
                    pending.sort(key=lambda message: message[0])
                    until_ns = blocks[k + 1].first_ns if k + 1 < len(blocks) else _LAST_NS + 1
                    ready = bisect_left(pending, until_ns, key=lambda message: message[0])
                yield from self._as_records(pending[:ready])
                del pending[:ready]
            if not self._damage.sentences:
                self._check_data(stream, count)

    def _wanted(self, messages: list[_Message], topics: set[str] | None) -> Iterator[_Message]:
        for message in messages:
            topic = self._topics.get(message[1])
            if topic is None:
                self._damage.note(f"log time {message[0]} ns", f"a message of channel {message[1]}, which is unknown")
            elif message[0] > _LAST_NS:
                self._damage.note(f"log time {message[0]} ns", "this time is beyond the clocks of ROS")
            elif topics is None or topic.name in topics:
                yield message

    def _as_records(self, messages: list[_Message]) -> Iterator[Record]:
        for t_ns, channel, data in messages:
            topic = self._topics[channel]
            try:
                yield Record(topic.name, topic.msgtype, t_ns, unpacked(data), topic.definition, topic.encoding)
            except ValueError as error:
                self._damage.note(f"log time {t_ns} ns", f"{topic.name}: {error}")

    # --- where the blocks are ---

    def _indexed(self, stream: IO[bytes]) -> list[McapBlock]:
        """Finds the blocks by the summary; none when there is no whole one."""
        tail = bytes_at(stream, max(self._size - _TAIL, 0), _TAIL)
        if not tail.endswith(MAGIC) or not tail.startswith(HEAD.pack(Opcode.FOOTER, 20)):
            return []
        footer = Footer.read(ReadDataStream(BytesIO(tail[HEAD.size :])))
        begin, end = footer.summary_start, self._size - _TAIL
        self._data_end = (begin or end) - _DATA_END
        if begin == 0:
            return []
        if not len(MAGIC) + _DATA_END <= begin <= end:
            self._damage.note(f"byte {end}", f"the summary cannot begin at byte {begin}")
            self._data_end = 0
            return []
        summary = bytes_at(stream, begin, max(end - begin, 0))
        if footer.summary_crc and zlib.crc32(summary + tail[:25]) != footer.summary_crc:
            self._damage.note(f"byte {begin}", "the checksum of the summary is wrong")
            return []
        try:
            return self._summarized(stream, summary)
        except _BROKEN as error:
            self._damage.note(f"byte {begin}", f"the summary cannot be read ({_words(error)})")
            return []

    def _summarized(self, stream: IO[bytes], summary: bytes) -> list[McapBlock]:
        blocks = []
        for opcode, begin, end in split(summary):
            content = ReadDataStream(BytesIO(summary[begin:end]))
            if opcode == Opcode.CHUNK_INDEX:
                index = ChunkIndex.read(content)
                at, length = index.chunk_start_offset, index.chunk_length
                if at < len(MAGIC) or at + length > self._size:
                    raise ValueError(f"a chunk of {length} bytes at byte {at} lies outside of the file")
                blocks.append(McapBlock(at, at + length, index.message_start_time, index.message_end_time, chunk=True))
            elif opcode == Opcode.METADATA_INDEX:
                place = MetadataIndex.read(content)
                self._learn(Opcode.METADATA, bytes_at(stream, place.offset, place.length)[HEAD.size :])
            elif opcode == Opcode.STATISTICS:
                self._listed_count = Statistics.read(content).message_count
            else:
                self._learn(opcode, summary[begin:end])
        return blocks

    def _walked(self, stream: IO[bytes]) -> list[McapBlock]:
        """Finds the blocks by going from record to record."""
        blocks: list[McapBlock] = []
        at = len(MAGIC)
        while True:
            head = bytes_at(stream, at, HEAD.size)
            opcode, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
            begin, end = at + HEAD.size, at + HEAD.size + length
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self._check_tail(at if opcode == Opcode.DATA_END else 0)
                return blocks
            if not known(opcode) or end > self._size:
                self._damage.note(f"byte {min(at, self._size)}", self._end_of_walk(at, opcode))
                if blocks and not blocks[-1].chunk and any(block.chunk for block in blocks):
                    blocks.pop()  # no writer mixes: what looked like messages was the inside of a damaged chunk
                if opcode == Opcode.CHUNK:
                    blocks.append(McapBlock(at, self._size, *times(stream, opcode, begin), chunk=True, cut=True))
                return blocks
            if opcode in (Opcode.CHUNK, Opcode.MESSAGE):
                append(blocks, McapBlock(at, end, *times(stream, opcode, begin), chunk=opcode == Opcode.CHUNK))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
                self._learn_or_note(at, opcode, bytes_at(stream, begin, length))
            at = end

    def _end_of_walk(self, at: int, opcode: int) -> str:
        if not known(opcode) and at + HEAD.size <= self._size:
            return f"no record begins with {opcode}"
        return f"the file ends at byte {self._size} within a record, or before its end was written"

    def _check_tail(self, data_end: int) -> None:
        if self._data_end == 0:
            self._damage.note(f"byte {self._size}", "the file does not end as an MCAP file")
        self._data_end = data_end

    def _check_data(self, stream: IO[bytes], count: int) -> None:
        """Checks the number of messages and the CRC of all data, which covers what no chunk's own CRC does."""
        if self._listed_count not in (None, count):
            self._damage.note("the messages", f"the summary lists {self._listed_count}, {count} are found")
        opcode, _length, expected = struct.unpack("<BQI", bytes_at(stream, self._data_end, _DATA_END).ljust(13, b"\0"))
        if opcode != Opcode.DATA_END:
            self._damage.note(f"byte {self._data_end}", "the end of the data is not marked")
        elif expected:
            crc, stream_at = 0, 0
            while stream_at < self._data_end:
                piece = bytes_at(stream, stream_at, min(_PIECE, self._data_end - stream_at))
                crc, stream_at = zlib.crc32(piece, crc), stream_at + len(piece)
            if crc != expected:
                self._damage.note(f"bytes 0 to {self._data_end}", "the checksum of all data is wrong")

    # --- what is in them ---

    def _parse(self, stream: IO[bytes], block: McapBlock) -> list[_Message]:
        """Returns the messages of a block, as far as it can be read."""
        found: list[_Message] = []
        try:
            payload = bytes_at(stream, block.begin, block.end - block.begin)
            if block.chunk:
                payload = payload_of(payload, block.cut)
            for opcode, begin, end in split(payload, block.cut):
                if opcode == Opcode.MESSAGE:
                    channel, _, t_ns, _ = _MESSAGE.unpack_from(payload, begin)
                    if end < begin + _MESSAGE.size:
                        raise ValueError(f"a message must have {_MESSAGE.size} bytes or more, got {end - begin}")
                    found.append((t_ns, channel, payload[begin + _MESSAGE.size : end]))
                else:
                    self._learn(opcode, payload[begin:end])
            self._check_times(block, [t_ns for t_ns, *_ in found])
        except _BROKEN as error:
            self._damage.note(f"byte {block.begin}", _words(error))
        return found

    def _check_times(self, block: McapBlock, times_ns: list[int]) -> None:
        """Notes times beyond those that a chunk claims: messages then come in another order than that of the times."""
        if times_ns and not block.first_ns <= min(times_ns) <= max(times_ns) <= block.last_ns:
            self._damage.note(f"byte {block.begin}", "a chunk has messages of other times than it claims")

    def _learn_or_note(self, at: int, opcode: int, content: bytes) -> None:
        try:
            self._learn(opcode, content)
        except _BROKEN as error:
            self._damage.note(f"byte {at}", _words(error))

    def _learn(self, opcode: int, content: bytes) -> None:
        """Takes schemas, channels and metadata over."""
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.METADATA:
            read = Metadata.read(stream)
            self.metadata[read.name] = read.metadata
        elif opcode == Opcode.SCHEMA and int.from_bytes(content[:2], "little") not in self._schemas:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema
            self._topics |= {k: _topic(c, schema) for k, c in self._channels.items() if c.schema_id == schema.id}
        elif opcode == Opcode.CHANNEL and int.from_bytes(content[:2], "little") not in self._channels:
            channel = Channel.read(stream)
            self._channels[channel.id] = channel
            self._topics[channel.id] = _topic(channel, self._schemas.get(channel.schema_id))


def _topic(channel: Channel, schema: Schema | None) -> Topic:
    qos = channel.metadata.get("offered_qos_profiles", "")
    definition = Definition(
        schema.data.decode(errors="replace") if schema else "",
        schema.encoding if schema else "",
        channel.metadata.get("topic_type_hash", ""),
    )
    msgtype = full_type(schema.name if schema else "")
    return Topic(channel.topic, msgtype, is_latched(qos), channel.message_encoding, definition, qos)


def _words(error: BaseException) -> str:
    return str(error) or type(error).__name__
