"""Decompression within bounds: a few bytes can claim, or become, more than any memory holds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO

import zstandard
from lz4.frame import LZ4FrameDecompressor

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_PIECE = 1 << 20  # bytes unpacked at a time
_RATIO = 1000  # of a whole file, unpacked against packed; recordings of zeros reach some hundreds
_SMALL = 1 << 28  # bytes that a whole file may always have unpacked
_WINDOW = 1 << 31  # bytes, the largest window of zstd (level 22 with --long=31)


def unpacked_zstd(packed: bytes, limit: int, cut: bool = False) -> bytes:
    """All frames of zstd data; of cut data what can be read.

    Raises:
        ValueError: the data are damaged, or become more than `limit` bytes.
    """
    data = bytearray()
    try:
        for piece in _zstd_pieces(packed):
            data += piece
            _check(len(data), limit)
    except zstandard.ZstdError as error:
        raise ValueError(f"zstd data cannot be unpacked ({error})") from None
    if not cut and not data and packed:
        raise ValueError("zstd data end within their first block")
    return bytes(data)


def unpacked_lz4(packed: bytes, limit: int) -> bytes:
    """All frames of lz4 data, as far as they go; ValueError as for zstd."""
    data = bytearray()
    while packed:
        frame = LZ4FrameDecompressor()
        data += frame.decompress(packed, max_length=limit + 1 - len(data))
        _check(len(data), limit)
        packed = frame.unused_data or b""
    return bytes(data)


def unpack_file(packed: IO[bytes], out: IO[bytes], size: int) -> None:
    """A file of `size` bytes that rosbag2 compressed as a whole, in one zstd frame or many; what was read is written.

    Raises:
        ValueError: it is damaged, or grows beyond what a recording can.
    """
    limit, done = max(_SMALL, _RATIO * size), 0
    try:
        for piece in _zstd_pieces(packed):
            done += len(piece)
            _check(done, limit)
            out.write(piece)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from None


def _zstd_pieces(packed: bytes | IO[bytes]) -> Iterator[bytes]:
    unpacker = zstandard.ZstdDecompressor(max_window_size=_WINDOW)
    with unpacker.stream_reader(packed, read_across_frames=True, closefd=False) as stream:
        while piece := stream.read(_PIECE):
            yield piece


def _check(size: int, limit: int) -> None:
    if size > limit:
        raise ValueError(f"compressed data become more than the {limit} bytes that they may have")
