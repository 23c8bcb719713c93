"""Sound files of every format, whole, cut off, and with headers that recorders left unfinished."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import decode
from uw_acoustic_loc.bag.sound.convert import WavSetup, convert_mono, convert_wav
from uw_acoustic_loc.bag.sound.files import open_sound
from uw_acoustic_loc.bag.sound.start_time import start_of
from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.types import Samples

RATE = 48_000
START = 1_700_000_000_000_000_000
SETUP = WavSetup(0.6, 1500.0, 2.0, START, 0.1, "auv1", (0, 1))
RNG = np.random.default_rng(3)
SOUND = RNG.uniform(-0.5, 0.5, (RATE, 2))


def samples(bag: Path) -> list[Samples]:
    return [decode(Samples, r.data, r.t_ns) for r in Bag(bag).records(["/auv1/hydrophones/samples"])]


def joined(bag: Path) -> np.ndarray:
    frames = samples(bag)
    return np.stack([np.concatenate([f.h0 for f in frames]), np.concatenate([f.h1 for f in frames])], axis=1)


FORMATS = [
    ("WAV", "PCM_U8", 2**-6),
    ("WAV", "PCM_24", 2**-22),
    ("WAV", "PCM_32", 2**-22),
    ("WAV", "FLOAT", 2**-22),
    ("WAV", "DOUBLE", 2**-22),
    ("W64", "PCM_24", 2**-22),
    ("RF64", "PCM_24", 2**-22),
    ("FLAC", "PCM_24", 2**-22),
    ("AIFF", "PCM_24", 2**-22),
    ("CAF", "PCM_24", 2**-22),
]


@pytest.mark.parametrize(("kind", "subtype", "step"), FORMATS)
def test_formats_are_read_to_their_precision(kind: str, subtype: str, step: float, tmp_path: Path) -> None:
    path = tmp_path / f"a.{kind.lower()}"
    soundfile.write(path, SOUND, RATE, format=kind, subtype=subtype)
    convert_wav([path], tmp_path / "bag", SETUP)
    assert joined(tmp_path / "bag") == pytest.approx(2.0 * SOUND, abs=2.0 * step)


@pytest.mark.parametrize("kind", ["WAV", "FLAC", "W64"])
def test_sixteen_bits_stay_counts(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{kind.lower()}"
    counts = np.round(SOUND * 32767).astype(np.int16)
    soundfile.write(path, counts, RATE, format=kind, subtype="PCM_16")
    convert_wav([path], tmp_path / "bag", SETUP)
    found = joined(tmp_path / "bag")
    assert found.dtype == np.int16
    assert np.array_equal(found, counts)


def wav_with_size(path: Path, riff: int, data: int, subtype: str = "PCM_24") -> None:
    """A WAV file whose header has these lengths; the data chunk begins at byte 44 or a little later."""
    soundfile.write(path, SOUND, RATE, format="WAV", subtype=subtype)
    content = bytearray(path.read_bytes())
    at = content.index(b"data")
    struct.pack_into("<I", content, 4, riff)
    struct.pack_into("<I", content, at + 4, data)
    path.write_bytes(content)


@pytest.mark.parametrize("subtype", ["PCM_16", "PCM_24", "FLOAT"])
@pytest.mark.parametrize(("riff", "data"), [(0, 0), (0xFFFFFFFF, 0xFFFFFFFF), (36, 0), (7200 * 4, 7200 * 4)])
def test_a_header_that_was_never_finished_or_wrapped_costs_nothing(
    riff: int, data: int, subtype: str, tmp_path: Path
) -> None:
    wav_with_size(tmp_path / "a.wav", riff, data, subtype)
    notes: list[str] = []
    convert_wav([tmp_path / "a.wav"], tmp_path / "bag", SETUP, notes.append)
    assert len(joined(tmp_path / "bag")) == RATE
    assert len(notes) == 1
    assert "by the file's length there are" in notes[0]


def test_a_cut_file_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", SOUND, RATE, subtype="PCM_24")
    whole = (tmp_path / "a.wav").read_bytes()
    (tmp_path / "a.wav").write_bytes(whole[: len(whole) // 2])
    notes: list[str] = []
    convert_wav([tmp_path / "a.wav"], tmp_path / "bag", SETUP, notes.append)
    assert len(joined(tmp_path / "bag")) == pytest.approx(RATE / 2, abs=20)
    assert "it is cut" in notes[0]


def test_chunks_of_recorders_own_and_a_second_data_chunk(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", SOUND, RATE, subtype="PCM_24")
    whole = (tmp_path / "a.wav").read_bytes()
    for name, notes_wanted in ((b"LIST", 0), (b"data", 1)):
        (tmp_path / "b.wav").write_bytes(whole + name + struct.pack("<I", 10) + bytes(10))
        sound = open_sound(tmp_path / "b.wav")
        assert (sound.length, len(sound.notes)) == (RATE, notes_wanted)


@pytest.mark.parametrize(
    ("name", "when"),
    [
        ("5678.240315123456.wav", "2024-03-15T12:34:56+00:00"),  # SoundTrap
        ("20240315_123456.WAV", "2024-03-15T12:34:56+00:00"),  # AudioMoth
        ("20240315_123456T.WAV", "2024-03-15T12:34:56+00:00"),  # AudioMoth, triggered
        ("AMAR173.1.20190920T163858Z.wav", "2019-09-20T16:38:58+00:00"),
        ("PAM_20240315_123456_789.wav", "2024-03-15T12:34:56.789+00:00"),  # PAMGuard
        ("site-20240315T123456+0200.flac", "2024-03-15T10:34:56+00:00"),
        ("2024-03-15T12-34-56.wav", "2024-03-15T12:34:56+00:00"),
    ],
)
def test_times_in_names(name: str, when: str, tmp_path: Path) -> None:
    from datetime import datetime

    found = start_of(tmp_path / name) if (tmp_path / name).write_bytes(b"") == 0 else None
    assert found == round(datetime.fromisoformat(when).timestamp() * 1000) * 1_000_000


@pytest.mark.parametrize("name", ["dive.wav", "take_12.wav", "99999999_999999.wav", "123456.wav"])
def test_names_without_a_time(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"RIFF")
    assert start_of(tmp_path / name) is None


@pytest.mark.parametrize(
    "content",
    [
        b"GUANO|Version: 1.0\nTimestamp: 2024-03-15T14:34:56+02:00\nLength: 1",
        b"ICMT" + struct.pack("<I", 80) + b"Recorded at 14:34:56 15/03/2024 (UTC+2) by AudioMoth 24",
        b"bext" + struct.pack("<I", 602) + bytes(320) + b"2024-03-1512:34:56" + bytes(100),
    ],
)
def test_times_in_what_recorders_write(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.wav").write_bytes(b"RIFF" + bytes(100) + content)
    assert start_of(tmp_path / "a.wav") == 1_710_506_096 * 1_000_000_000


def test_a_format_of_the_users_own(tmp_path: Path) -> None:
    assert start_of(tmp_path / "x15-03-24 12h34m56.wav", "x%d-%m-%y %Hh%Mm%S") == 1_710_506_096 * 1_000_000_000


def test_consecutive_files_are_joined_without_a_seam(tmp_path: Path) -> None:
    """The seam lies within a frame; names have whole seconds and the clock is not theirs."""
    x = RNG.uniform(-0.5, 0.5, (3 * RATE + 1000, 2))
    for k, name in enumerate(("r_20240315_120000.wav", "r_20240315_120001.wav", "r_20240315_120002.wav")):
        soundfile.write(tmp_path / name, x[k * RATE : (k + 1) * RATE + (1000 if k == 2 else 0)], RATE, subtype="FLOAT")
    paths = sorted(tmp_path.glob("*.wav"))[::-1]  # given in any order
    convert_wav(paths, tmp_path / "bag", WavSetup(0.6, 1500.0, 1.0, 0, 0.07, "auv1", (0, 1)))
    frames = samples(tmp_path / "bag")
    assert joined(tmp_path / "bag") == pytest.approx(x, abs=1e-7)
    start = 1_710_504_000 * 1_000_000_000
    size = round(0.07 * RATE)
    assert [f.t_ns for f in frames] == [start + round(1e9 * k * size / RATE) for k in range(len(frames))]


def test_a_gap_between_files_stays_a_gap(tmp_path: Path) -> None:
    for name in ("r_20240315_120000.wav", "r_20240315_120101.wav"):
        soundfile.write(tmp_path / name, SOUND, RATE)
    notes: list[str] = []
    setup = WavSetup(0.6, 1500.0, 1.0, 0, 0.1, "auv1", (0, 1))
    convert_wav(sorted(tmp_path.glob("*.wav")), tmp_path / "bag", setup, notes.append)
    stamps = [f.t_ns for f in samples(tmp_path / "bag")]
    assert notes == ["60.0 s are missing before r_20240315_120101.wav"]
    assert max(np.diff(stamps)) == 61_000_000_000 - 900_000_000


def test_the_clocks_error_is_said_of_a_long_recording(tmp_path: Path) -> None:
    """Files of 300 s by the samples, which begin 300.3 s apart: 1000 ppm, known to 1 s in the whole recording."""
    for k in range(11):
        seconds = round(300.3 * k)
        name = f"r_20240315_12{seconds // 60:02d}{seconds % 60:02d}.wav"
        soundfile.write(tmp_path / name, np.zeros((300 * 100, 2)), 100)
    notes: list[str] = []
    setup = WavSetup(0.6, 1500.0, 1.0, 0, 10.0, "auv1", (0, 1))
    convert_wav(sorted(tmp_path.glob("*.wav")), tmp_path / "bag", setup, notes.append)
    assert notes == ["by the files' starts a second of samples lasts +1000 +- 333 ppm more than a second"]


def test_overlapping_files_are_refused(tmp_path: Path) -> None:
    for name in ("r_20240315_120000.wav", "r_20240315_120004.wav"):
        soundfile.write(tmp_path / name, np.zeros((10 * 1000, 2)), 1000)
    setup = WavSetup(0.6, 1500.0, 1.0, 0, 0.1, "auv1", (0, 1))
    with pytest.raises(ValueError, match=r"begins 6\.0 s before r_20240315_120000\.wav ends"):
        convert_wav(sorted(tmp_path.glob("*.wav")), tmp_path / "bag", setup)


def test_two_files_of_one_channel_each(tmp_path: Path) -> None:
    for k in (0, 1):
        soundfile.write(tmp_path / f"h{k}.wav", SOUND[: RATE - 100 * k, k], RATE, subtype="FLOAT")
    notes: list[str] = []
    convert_mono((tmp_path / "h0.wav", tmp_path / "h1.wav"), tmp_path / "bag", SETUP, notes.append)
    assert joined(tmp_path / "bag") == pytest.approx(2.0 * SOUND[: RATE - 100], abs=1e-6)
    assert "the shorter one ends both" in notes[0]


def test_the_program_takes_many_files_or_two_of_one_channel(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k in (0, 1):
        soundfile.write(tmp_path / f"h{k}_20240315_120000.wav", SOUND[:, k], RATE)
    names = ",".join(str(tmp_path / f"h{k}_20240315_120000.wav") for k in (0, 1))
    arguments = ["convert-wav", "--channels", names, "-o", str(tmp_path / "bag"), "--spacing", "1"]
    assert main([*arguments, "--calibration", "180"]) == 0
    assert joined(tmp_path / "bag").shape == (RATE, 2)
    assert main(["convert-wav", "-o", str(tmp_path / "b"), "--spacing", "1"]) == 1
    assert "must have either sound files, or --channels with two files" in capsys.readouterr().err


def test_memory_stays_flat(tmp_path: Path) -> None:
    """200 MB of 24-bit samples, in float64 560 MB, take little more than 1 s of sound."""
    block = RNG.uniform(-0.5, 0.5, (192_000, 2))
    short, long = (most_memory(tmp_path / f"{seconds}.wav", seconds, block) for seconds in (1, 180))
    assert long < short + 60_000


def most_memory(path: Path, seconds: int, block: np.ndarray) -> int:
    """kB that converting takes at the most."""
    with soundfile.SoundFile(path, "w", 192_000, 2, "PCM_24") as file:
        for _ in range(seconds):
            file.write(block)
    script = """
import sys
from test.peak_memory import peak_kb
from uw_acoustic_loc.cli.main import main
code = main(["convert-wav", sys.argv[1], "-o", sys.argv[2], "--spacing", "0.6", "--start", "1700000000"])
print(code, peak_kb())
"""
    command = [sys.executable, "-c", script, path, f"{path}_bag"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, kilobytes = map(int, done.stdout.split())
    assert code == 0
    return kilobytes
