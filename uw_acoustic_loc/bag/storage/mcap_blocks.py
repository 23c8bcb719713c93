"""Blocks of an MCAP file: where they lie, how they are unpacked, and the records in them. Layout: mcap.dev/spec."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

from mcap.opcode import Opcode

from .compression import unpacked_lz4, unpacked_zstd

HEAD = struct.Struct("<BQ")  # opcode, length of what follows
_CHUNK = struct.Struct("<QQQII")  # first and last log time, size and CRC when unpacked, length of compression's name
_RUN = 1 << 20  # bytes
_LARGEST_CHUNK = 1 << 30  # bytes, unpacked; rosbag2's have less than 1 MB, other writers' some MB
_LAST_OPCODE = max(Opcode)


@dataclass(frozen=True)
class McapBlock:
    """A chunk, or a run of messages outside of chunks: bytes [begin, end) of the file."""

    begin: int
    end: int
    first_ns: int
    last_ns: int
    chunk: bool
    cut: bool = False  # the file ends within it


def bytes_at(stream: IO[bytes], begin: int, length: int) -> bytes:
    """Bytes of a file; fewer where it ends, whatever a damaged length says."""
    size = os.fstat(stream.fileno()).st_size
    if not 0 <= begin < size:
        return b""
    stream.seek(begin)
    return stream.read(min(length, size - begin))


def known(opcode: int) -> bool:
    """Returns whether a record may begin so: 1 to 15 are defined, those from 128 are private and left out."""
    return 0 < opcode <= _LAST_OPCODE or opcode >= 0x80


def append(blocks: list[McapBlock], block: McapBlock) -> None:
    """Appends a block; messages outside of chunks make one, up to a size."""
    last = blocks[-1] if blocks else None
    if last is None or last.chunk or block.chunk or last.end != block.begin or block.end - last.begin > _RUN:
        blocks.append(block)
    else:
        first_ns, last_ns = min(last.first_ns, block.first_ns), max(last.last_ns, block.last_ns)
        blocks[-1] = McapBlock(last.begin, block.end, first_ns, last_ns, chunk=False)


def times(stream: IO[bytes], opcode: int, begin: int) -> tuple[int, int]:
    """Reads first and last log time in ns of a chunk or a message."""
    if opcode == Opcode.CHUNK:
        first_ns, last_ns = struct.unpack("<QQ", bytes_at(stream, begin, 16).ljust(16, b"\0"))
        return first_ns, last_ns
    (t_ns,) = struct.unpack("<Q", bytes_at(stream, begin + 6, 8).ljust(8, b"\0"))
    return t_ns, t_ns


def split(data: bytes, cut: bool = False) -> Iterator[tuple[int, int, int]]:
    """Yields opcode, begin and end of each record's content; ValueError if one does not fit and data are not cut."""
    at = 0
    while at < len(data):
        opcode, length = HEAD.unpack_from(data, at) if at + HEAD.size <= len(data) else (0, 0)
        begin, at = at + HEAD.size, at + HEAD.size + length
        if cut and at > len(data):
            return
        if not known(opcode) or at > len(data):
            raise ValueError(f"a record of kind {opcode} and {length} bytes does not fit into a block of {len(data)}")
        yield opcode, begin, at


def payload_of(record: bytes, cut: bool) -> bytes:
    """Returns the unpacked records of a chunk; of a cut one, what its part of the data gives.

    Raises:
        ValueError: no chunk, or its length or CRC is wrong.
    """
    if record[:1] != bytes([Opcode.CHUNK]):
        raise ValueError("no chunk begins here")
    _, _, size, crc, name_length = _CHUNK.unpack_from(record, HEAD.size)
    begin = HEAD.size + _CHUNK.size
    name = record[begin : begin + name_length].decode()
    (length,) = struct.unpack_from("<Q", record, begin + name_length)
    packed = record[begin + name_length + 8 :][:length]
    if size > _LARGEST_CHUNK:
        raise ValueError(f"a chunk must have at most {_LARGEST_CHUNK} bytes unpacked, it claims {size}")
    data = _decompressed(name, packed, size, cut)
    if len(data) > size or (len(data) < size and not cut):
        raise ValueError(f"a chunk must have {size} bytes, got {len(data)}")
    if crc and len(data) == size and zlib.crc32(data) != crc:
        raise ValueError("the checksum of a chunk is wrong")
    return data


def _decompressed(name: str, packed: bytes, size: int, cut: bool) -> bytes:
    """As far as `packed` goes, and no more than it claims."""
    if name == "zstd":
        return unpacked_zstd(packed, size, cut)
    if name == "lz4":
        return unpacked_lz4(packed, size)
    if name:
        raise ValueError(f"compression of a chunk must be zstd, lz4 or none, got '{name}'")
    return packed
