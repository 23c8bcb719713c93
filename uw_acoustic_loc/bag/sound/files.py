"""Sound files, read in blocks by libsndfile: WAV, W64, RF64, FLAC, AIFF, CAF and the rest, of any sample format.

A recorder that is cut off leaves a WAV header with lengths that are zero, unset or, beyond 4 GB, wrapped. Only there
the file's own length counts, and the samples are read without the header's help.
"""

from __future__ import annotations

import io
import string
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
import soundfile

from ...core.types import AnyArray

_CHUNK = struct.Struct("<4sI")
_FORMAT = struct.Struct("<HHIIHH")  # tag, channels, rate, bytes per s, bytes per frame of all channels, bits
_EXTENSIBLE = 0xFFFE
_SUBTYPES = {
    (1, 8): "PCM_U8",
    (1, 16): "PCM_16",
    (1, 24): "PCM_24",
    (1, 32): "PCM_32",
    (3, 32): "FLOAT",
    (3, 64): "DOUBLE",
}
_LONGEST = 1 << 62  # samples; libsndfile's word for an unknown length is beyond
_NAMES = set(string.printable.encode())


@dataclass(frozen=True)
class _Raw:
    """Where a WAV file's samples lie, when its header does not say."""

    begin: int
    size: int
    channels: int
    rate: int
    subtype: str


@dataclass(frozen=True)
class Sound:
    """A sound file that can be read; `notes` say what was odd about it."""

    path: Path
    rate: int  # Hz
    channels: int
    length: int  # samples per channel
    subtype: str  # libsndfile's name of the sample format
    notes: tuple[str, ...] = ()
    _raw: _Raw | None = field(default=None, repr=False)

    @property
    def counts(self) -> bool:
        """Whether samples are given as 16-bit counts; all others are given as shares of full scale."""
        return self.subtype == "PCM_16"

    @property
    def can_be_infinite(self) -> bool:
        """Whether samples may be NaN or infinite."""
        return self.subtype in ("FLOAT", "DOUBLE")

    def blocks(self, size: int) -> Iterator[AnyArray]:
        """Samples (n, channels) from the beginning, `size` at a time, the last ones fewer: int16 or float64.

        Raises:
            ValueError: the file is damaged.
        """
        try:
            with self.path.open("rb") as stream, _opened(stream, self._raw) as sound:
                yield from sound.blocks(size, dtype="int16" if self.counts else "float64", always_2d=True)
        except soundfile.LibsndfileError as error:
            raise ValueError(f"{self.path} cannot be read to its end: {error.error_string}") from None


def open_sound(path: Path) -> Sound:
    """What a sound file holds.

    Raises:
        ValueError: it cannot be opened, is no sound file, or has no samples.
    """
    try:
        with path.open("rb") as stream:
            raw, notes = _repaired(stream)
            stream.seek(0)
            with _opened(stream, raw) as sound:
                found = Sound(path, sound.samplerate, sound.channels, sound.frames, sound.subtype, tuple(notes), raw)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror or error}") from None
    except (soundfile.LibsndfileError, TypeError, OverflowError) as error:
        words = error.error_string if isinstance(error, soundfile.LibsndfileError) else "its header makes no sense"
        raise ValueError(f"{path} is not a sound file that can be read: {words}") from None
    if found.length > _LONGEST:
        raise ValueError(f"{path} has no length in its header, as of a stream: make a WAV file of it first")
    if found.rate <= 0 or found.length <= 0:
        raise ValueError(f"{path} must have samples and a positive rate, got {found.length} at {found.rate} Hz")
    return found


def first_bad_sample(sound: Sound, channels: list[int]) -> int | None:
    """The first sample of these channels that is not finite; None where there is none."""
    done = 0
    for block in sound.blocks(1 << 16) if sound.can_be_infinite else ():
        bad = np.flatnonzero(~np.isfinite(block[:, channels]).all(axis=1))
        if bad.size:
            return done + int(bad[0])
        done += len(block)
    return None


def _opened(stream: BinaryIO, raw: _Raw | None) -> soundfile.SoundFile:
    if raw is None:
        return soundfile.SoundFile(_Part(stream, 0, stream.seek(0, 2)))
    part = _Part(stream, raw.begin, raw.size)
    options = {"samplerate": raw.rate, "channels": raw.channels, "subtype": raw.subtype, "endian": "LITTLE"}
    return soundfile.SoundFile(part, format="RAW", **options)


def _repaired(stream: BinaryIO) -> tuple[_Raw | None, list[str]]:
    """For a RIFF file whose header cannot be right: where the samples are. And what there is to say of any file."""
    if stream.read(4) != b"RIFF" or stream.read(8)[4:] != b"WAVE":
        return None, []
    size = stream.seek(0, 2)
    chunks = list(_chunks(stream, size))
    data = [(begin, length) for name, begin, length in chunks if name == b"data"]
    layout = next((stream_at(stream, begin, length) for name, begin, length in chunks if name == b"fmt "), b"")
    if not data or len(layout) < _FORMAT.size:
        return None, []
    begin, length = data[0]
    if _follows(stream, begin + length + length % 2, size) and 0 < length <= size - begin:
        second = [f"a second data chunk at byte {at} is not read" for at, _ in data[1:]]
        return (_raw(layout, begin, length) if second else None), second  # libsndfile would read the last one
    if 0 < length < 0xFFFFFFFF and begin + length > size:
        return None, [f"it is cut: {size - begin} bytes of samples where its header has {length}"]
    raw = _raw(layout, begin, size - begin)
    if raw is None:
        return None, []
    return raw, [f"its header has {length} bytes of samples; by the file's length there are {raw.size}"]


def _raw(layout: bytes, begin: int, available: int) -> _Raw | None:
    tag, channels, rate, _, width, bits = _FORMAT.unpack_from(layout)
    if tag == _EXTENSIBLE and len(layout) >= 26:
        (tag,) = struct.unpack_from("<H", layout, 24)  # the first bytes of the sub-format's GUID
    subtype = _SUBTYPES.get((tag, bits))
    if subtype is None or width != channels * bits // 8 or width == 0 or rate == 0:
        return None
    return _Raw(begin, available - available % width, channels, rate, subtype)


def _chunks(stream: BinaryIO, size: int) -> Iterator[tuple[bytes, int, int]]:
    """Name, begin and length of each chunk, as far as they make sense."""
    at = 12
    while at + _CHUNK.size <= size:
        name, length = _CHUNK.unpack(stream_at(stream, at, _CHUNK.size))
        if not set(name) <= _NAMES:
            return
        yield name, at + _CHUNK.size, length
        at += _CHUNK.size + length + length % 2


def _follows(stream: BinaryIO, at: int, size: int) -> bool:
    """Whether the file ends at `at`, or goes on with a chunk that fits."""
    if size - at in (-1, 0):
        return True
    head = stream_at(stream, at, _CHUNK.size)
    if len(head) < _CHUNK.size:
        return not any(head)
    name, length = _CHUNK.unpack(head)
    return set(name) <= _NAMES and at + _CHUNK.size + length <= size + 1


def stream_at(stream: BinaryIO, at: int, length: int) -> bytes:
    """Bytes of a file; fewer where it ends."""
    stream.seek(at)
    return stream.read(min(length, 1 << 20))


class _Part(io.RawIOBase):
    """A part of a file as a file of its own."""

    def __init__(self, stream: BinaryIO, begin: int, size: int) -> None:
        self._stream, self._begin, self._size, self._at = stream, begin, size, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = max(0, offset + {0: 0, 1: self._at, 2: self._size}[whence])  # before it where a header is damaged
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
        self._stream.seek(self._begin + self._at)
        data = self._stream.read(max(min(len(buffer), self._size - self._at), 0))
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)
