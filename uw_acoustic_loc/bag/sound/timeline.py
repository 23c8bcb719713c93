"""Consecutive files on one line of time: where they join, where something is missing, and how far the clock is off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .files import Sound
from .start_time import start_of

_JOIN_S = 1.5  # names have whole seconds: files whose starts are off by less follow each other without a gap
_DRIFT = 1e-3  # of the time since the first file, which a recorder's clock may be off
_KNOWN_S = 600.0  # of recording, after which whole seconds tell a clock's error to some hundred ppm


@dataclass(frozen=True)
class Segment:
    """Files without a gap between them."""

    start_ns: int
    sounds: tuple[Sound, ...]

    @property
    def rate(self) -> int:
        """Samples per s."""
        return self.sounds[0].rate

    @property
    def duration(self) -> float:
        """In s, by the number of samples."""
        return sum(sound.length for sound in self.sounds) / self.rate


def timeline(sounds: Sequence[Sound], start_ns: int, time_format: str) -> tuple[list[Segment], list[str]]:
    """Segments in the order of their starts, and what there is to say about them.

    `start_ns`, when it is not 0, is the start of the first file; names then give only the distances between files.

    Raises:
        ValueError: a file's start is not known, or files overlap.
    """
    starts = {sound.path: start_of(sound.path, time_format) for sound in sounds}
    alone = len(sounds) == 1 and start_ns
    unknown = [path for path, start in starts.items() if start is None]
    if unknown and not alone:
        way = "--time-format" if start_ns else "--start or --time-format"
        raise ValueError(f"{unknown[0]} has no time in its name or its content: give {way}")
    ordered = sorted(sounds, key=lambda sound: starts[sound.path] or 0)
    first_ns = starts[ordered[0].path] or 0
    shift_ns = start_ns - first_ns if start_ns else 0
    begins = [start_ns if alone else (starts[sound.path] or 0) + shift_ns for sound in ordered]
    return _segments(ordered, begins)


def _segments(sounds: list[Sound], begins: list[int]) -> tuple[list[Segment], list[str]]:
    segments = [Segment(begins[0], (sounds[0],))]
    sentences = []
    for sound, begin_ns in zip(sounds[1:], begins[1:], strict=True):
        last = segments[-1]
        off = (begin_ns - last.start_ns) * 1e-9 - last.duration
        if abs(off) <= _JOIN_S + _DRIFT * last.duration:
            segments[-1] = Segment(last.start_ns, (*last.sounds, sound))
        elif off < 0:
            before = last.sounds[-1].path.name
            raise ValueError(f"{sound.path} begins {-off:.1f} s before {before} ends: they are not one recording")
        else:
            sentences.append(f"{off:.1f} s are missing before {sound.path.name}")
            segments.append(Segment(begin_ns, (sound,)))
    return segments, [*sentences, *_drift(sounds, begins, segments)]


def _drift(sounds: list[Sound], begins: list[int], segments: list[Segment]) -> list[str]:
    """How far the sample clock is off against the names, where the recording is long enough to know it."""
    if len(segments) > 1:
        return []
    by_samples = sum(sound.length for sound in sounds[:-1]) / sounds[0].rate
    by_names = (begins[-1] - begins[0]) * 1e-9
    if by_samples < _KNOWN_S:
        return []
    ppm, unsure = 1e6 * (by_names / by_samples - 1.0), 1e6 / by_samples
    return [f"by the files' starts a second of samples lasts {ppm:+.0f} +- {unsure:.0f} ppm more than a second"]
