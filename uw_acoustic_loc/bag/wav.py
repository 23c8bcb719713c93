"""A WAV file of an array's recording becomes a bag that the bearing node accepts.

scipy reads the file: Python's own `wave` knows neither float samples nor (before 3.12) the extensible header of most
recorders with more than 16 bits.
"""

from __future__ import annotations

import math
import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.types import AnyArray, HydrophoneInfo, Samples
from ..wire.codec import codec
from .rosbags_messages import encode
from .writer import BagWriter

_COUNTS = 32767


@dataclass(frozen=True)
class WavSetup:
    """What a WAV file does not contain."""

    spacing: float  # m
    sound_speed: float  # m/s
    full_scale: float  # Pa of the largest sample
    start_ns: int
    frame: float  # s
    namespace: str
    channels: tuple[int, int]  # hydrophone 0 (-x), hydrophone 1 (+x), counted from 0

    def __post_init__(self) -> None:
        for name in ("spacing", "sound_speed", "full_scale", "frame"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name.replace('_', '-')} must be positive and finite, got {value!r}")
        if self.start_ns <= 0:
            raise ValueError(f"start must be after 1970-01-01, got {self.start_ns * 1e-9!r} s")
        if len(self.channels) != 2 or self.channels[0] == self.channels[1] or min(self.channels) < 0:
            raise ValueError(f"channels must be two different numbers from 0, got {list(self.channels)}")


def convert_wav(path: Path, out: Path, setup: WavSetup) -> dict[str, int]:
    """Writes hydrophones/info and hydrophones/samples; returns counts per topic.

    16-bit samples stay counts; others become float32 Pa. The last frame may be shorter.

    Raises:
        ValueError: no WAV file, no such channel, or samples that are not finite.
    """
    rate, samples = _read(path)
    pair = _channels(path, samples, setup)
    size = round(setup.frame * rate)
    if size < 1:
        raise ValueError(f"frame must be at least one sample of {1 / rate:g} s, got {setup.frame:g} s")
    scale = setup.full_scale / _COUNTS
    info = HydrophoneInfo(setup.start_ns, float(rate), setup.spacing, setup.sound_speed, scale)
    prefix = f"/{setup.namespace.strip('/')}" if setup.namespace.strip("/") else ""
    with BagWriter(out, {"made_by": "convert-wav", "input": path.name}) as writer:
        _write(writer, f"{prefix}/hydrophones/info", info, setup.start_ns, latched=True)
        for k in range(0, pair.shape[1], size):
            t_ns, end_ns = (setup.start_ns + round(1e9 * n / rate) for n in (k, min(k + size, pair.shape[1])))
            frame = Samples(t_ns, pair[0, k : k + size], pair[1, k : k + size])
            _write(writer, f"{prefix}/hydrophones/samples", frame, end_ns)
        return writer.counts


def _read(path: Path) -> tuple[int, AnyArray]:
    """Reads sample rate and (N,) or (N, channels) samples as the file has them."""
    from scipy.io import wavfile  # noqa: PLC0415

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks of recorders' own
            rate, samples = wavfile.read(path)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, EOFError, struct.error, ArithmeticError, UnboundLocalError) as error:
        raise ValueError(f"{path} is not a WAV file that can be read: {error}") from None
    if rate <= 0 or samples.shape[0] == 0:
        raise ValueError(f"{path} must have samples and a positive rate, got {samples.shape[0]} at {rate} Hz")
    return int(rate), samples


def _channels(path: Path, samples: AnyArray, setup: WavSetup) -> AnyArray:
    """Returns (2, N) int16 counts, or float32 Pa."""
    count = 1 if samples.ndim == 1 else samples.shape[1]
    if max(setup.channels) >= count:
        raise ValueError(f"{path} must have channels {list(setup.channels)}, it has {count}, counted from 0")
    pair = np.ascontiguousarray(samples[:, list(setup.channels)].T)
    if pair.dtype == np.int16:
        return pair
    values = pair * (setup.full_scale / _largest(path, pair.dtype))
    if not np.isfinite(values).all():
        raise ValueError(f"{path} must have finite samples, got {int((~np.isfinite(values)).sum())} that are not")
    return values.astype(np.float32)


def _largest(path: Path, kind: np.dtype[Any]) -> float:
    """Returns the value of full scale; scipy puts 24 bits into the upper three bytes of an int32."""
    if kind.kind == "f":
        return 1.0
    if kind == np.int32:
        return 2.0**31
    raise ValueError(f"{path} must have samples of 16, 24 or 32 bits, or float, got {kind}")


def _write(writer: BagWriter, topic: str, value: Any, t_ns: int, latched: bool = False) -> None:
    writer.add_topic(topic, codec(type(value)).msgtype, latched)
    writer.write(topic, t_ns, encode(value))
