"""Sound files of an array's recording become a bag that the bearing node accepts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.types import AnyArray, HydrophoneInfo, Samples
from ...graph import check_topics
from ...wire.codec import codec
from ..rosbags_messages import encode
from ..writer import BagWriter
from .files import Sound, first_bad_sample, open_sound
from .timeline import Segment, timeline

_COUNTS = 32767
LAST_S = 1 << 31  # of ROS's stamps, in Unix time


@dataclass(frozen=True)
class WavSetup:
    """What sound files do not say."""

    spacing: float  # m
    sound_speed: float  # m/s
    full_scale: float  # Pa of the largest sample
    start_ns: int  # of the first sample; 0 = by the files' names or what the recorder wrote into them
    frame: float  # s
    namespace: str
    channels: tuple[int, int]  # hydrophone 0 (-x), hydrophone 1 (+x), counted from 0
    time_format: str = ""  # of strptime, for names that are not known

    def __post_init__(self) -> None:
        for name in ("spacing", "sound_speed", "full_scale", "frame"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name.replace('_', '-')} must be positive and finite, got {value!r}")
        if not 0 <= self.start_ns < LAST_S * 10**9:
            raise ValueError(f"start must be after 1970-01-01 and before 2038-01-19, got {self.start_ns * 1e-9!r} s")
        if len(self.channels) != 2 or self.channels[0] == self.channels[1] or min(self.channels) < 0:
            raise ValueError(f"channels must be two different numbers from 0, got {list(self.channels)}")


def convert_wav(
    paths: Sequence[Path], out: Path, setup: WavSetup, note: Callable[[str], None] = lambda sentence: None
) -> dict[str, int]:
    """Writes hydrophones/info and hydrophones/samples of consecutive files; returns counts per topic.

    16-bit samples stay counts; others become float32 Pa. The last frame before a gap or the end may be shorter. `note`
    is called with a sentence for whatever is odd about the files.

    Raises:
        ValueError: no sound file, no such channel, samples that are not finite, or a start that nobody knows.
    """
    sounds = [_checked(path, list(setup.channels)) for path in paths]
    return _convert([sounds], [(0, channel) for channel in setup.channels], out, setup, note)


def convert_mono(
    paths: tuple[Path, Path], out: Path, setup: WavSetup, note: Callable[[str], None] = lambda sentence: None
) -> dict[str, int]:
    """The same of two files of one channel each, hydrophone 0 first, which began together."""
    tracks = [[_checked(path, [0])] for path in paths]
    lengths = [track[0].length for track in tracks]
    if lengths[0] != lengths[1]:
        note(f"{paths[0]} and {paths[1]} have {lengths[0]} and {lengths[1]} samples: the shorter one ends both")
    return _convert(tracks, [(0, 0), (1, 0)], out, setup, note)


def _convert(
    tracks: list[list[Sound]], pair: list[tuple[int, int]], out: Path, setup: WavSetup, note: Callable[[str], None]
) -> dict[str, int]:
    """`pair` has the track and the channel in it of both hydrophones."""
    first = tracks[0][0]
    for sound in (sound for track in tracks for sound in track):
        _check_alike(first, sound)
        for sentence in sound.notes:
            note(f"{sound.path}: {sentence}")
    size = round(setup.frame * first.rate)
    if size < 1:
        raise ValueError(f"frame must be at least one sample of {1 / first.rate:g} s, got {setup.frame:g} s")
    segments, sentences = timeline(tracks[0], setup.start_ns, setup.time_format)
    _check_instants(segments)
    for sentence in sentences:
        note(sentence)
    info = HydrophoneInfo(
        segments[0].start_ns, float(first.rate), setup.spacing, setup.sound_speed, setup.full_scale / _COUNTS
    )
    prefix = f"/{setup.namespace.strip('/')}" if setup.namespace.strip("/") else ""
    check_topics([f"{prefix}/hydrophones/info"], f"namespace '{setup.namespace}'")
    about = {"made_by": "convert-wav", "input": ", ".join(sound.path.name for track in tracks for sound in track)}
    with BagWriter(out, about) as writer:
        _write(writer, f"{prefix}/hydrophones/info", info, segments[0].start_ns, latched=True)
        for frame, end_ns in _frames(segments, tracks[1:], pair, size, setup.full_scale):
            _write(writer, f"{prefix}/hydrophones/samples", frame, end_ns)
        return writer.counts


def _check_instants(segments: list[Segment]) -> None:
    """Stamps of ROS are seconds of 32 bits."""
    for segment in segments:
        start, end = segment.start_ns * 1e-9, segment.start_ns * 1e-9 + segment.duration
        if not 0 < start < end < LAST_S:
            raise ValueError(
                f"{segment.sounds[0].path} must begin after 1970-01-01 and end before 2038-01-19,"
                f" it is from {start:.0f} s to {end:.0f} s of Unix time"
            )


def _frames(
    segments: list[Segment], others: list[list[Sound]], pair: list[tuple[int, int]], size: int, full_scale: float
) -> Iterator[tuple[Samples, int]]:
    """Frames and the instants of their ends; other tracks go along with the first."""
    for segment in segments:
        sources = [_joined(segment.sounds, size), *(_joined(sounds, size) for sounds in others)]
        done, rate = 0, segment.rate
        for blocks in zip(*sources, strict=False):
            n = min(len(block) for block in blocks)
            h0, h1 = (_pressure(blocks[track][:n, channel], full_scale) for track, channel in pair)
            t_ns, end_ns = (segment.start_ns + round(1e9 * k / rate) for k in (done, done + n))
            yield Samples(t_ns, h0, h1), end_ns
            done += n


def _joined(sounds: Sequence[Sound], size: int) -> Iterator[AnyArray]:
    """Blocks (size, channels) across the borders of files; the last one may be shorter."""
    kept: list[AnyArray] = []
    have = 0
    for sound in sounds:
        for block in sound.blocks(size):
            kept.append(block)
            have += len(block)
            if have >= size:
                whole = np.concatenate(kept)
                yield whole[:size]
                kept, have = [whole[size:]], have - size
    if have:
        yield np.concatenate(kept)


def _pressure(samples: AnyArray, full_scale: float) -> AnyArray:
    """int16 counts as they are, shares of full scale as float32 Pa."""
    return np.ascontiguousarray(samples if samples.dtype == np.int16 else (samples * full_scale).astype(np.float32))


def _checked(path: Path, channels: list[int]) -> Sound:
    sound = open_sound(path)
    if max(channels) >= sound.channels:
        hint = "; give two files of one channel each as --channels AFT,FORE" if sound.channels == 1 else ""
        raise ValueError(f"{path} must have channels {channels}, counted from 0, it has {sound.channels}{hint}")
    if (bad := first_bad_sample(sound, channels)) is not None:
        raise ValueError(f"{path} must have finite samples, sample {bad} is not")
    return sound


def _check_alike(first: Sound, other: Sound) -> None:
    if (first.rate, first.counts) != (other.rate, other.counts):
        have = f"{other.rate} Hz and {other.subtype}, {first.path.name} has {first.rate} Hz and {first.subtype}"
        raise ValueError(f"{other.path} must have the same rate and sample format as the others, it has {have}")


def _write(writer: BagWriter, topic: str, value: Any, t_ns: int, latched: bool = False) -> None:
    writer.add_topic(topic, codec(type(value)).msgtype, latched)
    writer.write(topic, t_ns, encode(value))
