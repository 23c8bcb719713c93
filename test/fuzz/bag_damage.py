"""Damage to the files of a bag, from a seed: bits flipped, pieces cut, lengths set to extremes."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np

Rng = np.random.Generator
_EXTREMES = (0, 1, 0x7F, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 1 << 62, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)


def damaged(whole: bytes, rng: Rng) -> bytes:
    """The content with one to four faults."""
    content = bytearray(whole)
    for _ in range(rng.integers(1, 5)):
        if content:
            _FAULTS[rng.integers(len(_FAULTS))](content, rng)
    return bytes(content)


def _at(content: bytearray, rng: Rng) -> int:
    """Anywhere, and often near the beginning or the end, where headers and indexes are."""
    size = len(content)
    near = int(min(rng.exponential(200.0), size - 1))
    return [int(rng.integers(size)), near, size - 1 - near][rng.integers(3)]


def _flip(content: bytearray, rng: Rng) -> None:
    content[_at(content, rng)] ^= 1 << int(rng.integers(8))


def _random(content: bytearray, rng: Rng) -> None:
    at = _at(content, rng)
    piece = rng.bytes(int(rng.integers(1, 40)))
    content[at : at + len(piece)] = piece[: len(content) - at]


def _zeros(content: bytearray, rng: Rng) -> None:
    at = _at(content, rng)
    length = min(int(rng.exponential(300.0)), len(content) - at)
    content[at : at + length] = bytes(length)


def _cut(content: bytearray, rng: Rng) -> None:
    del content[_at(content, rng) :]


def _remove(content: bytearray, rng: Rng) -> None:
    at = _at(content, rng)
    del content[at : at + int(rng.exponential(100.0))]


def _insert(content: bytearray, rng: Rng) -> None:
    at = _at(content, rng)
    content[at:at] = rng.bytes(int(rng.integers(1, 100)))


def _repeat(content: bytearray, rng: Rng) -> None:
    at = _at(content, rng)
    content[at:at] = content[at : at + int(rng.exponential(500.0))]


def _extreme(content: bytearray, rng: Rng) -> None:
    """A number of four or eight bytes, wherever it is."""
    _put(content, _at(content, rng), rng)


def _record_length(content: bytearray, rng: Rng) -> None:
    """The length of an MCAP record, or a number at the beginning of its content."""
    places, at = [], 8
    while at + 9 <= len(content):
        places.append(at + 1)
        at += 9 + struct.unpack_from("<Q", content, at + 1)[0]
    if places:
        _put(content, places[rng.integers(len(places))] + int(rng.choice([0, 0, 8, 10, 12, 16, 24, 32])), rng)


def _put(content: bytearray, at: int, rng: Rng) -> None:
    form = "<Q" if rng.integers(2) else "<I"
    size = struct.calcsize(form)
    value = _EXTREMES[rng.integers(len(_EXTREMES))] & ((1 << 8 * size) - 1)
    if at + size <= len(content):
        struct.pack_into(form, content, at, value)


_FAULTS: list[Callable[[bytearray, Rng], None]] = [
    *(_flip, _flip, _random, _zeros, _cut, _remove, _insert, _repeat, _extreme, _record_length, _record_length)
]
