import struct
import wave
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from uw_acoustic_loc.bag.process import OfflineRun
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.rosbags_messages import deserialize
from uw_acoustic_loc.bag.sound.convert import WavSetup, convert_wav
from uw_acoustic_loc.cli.main import main
from uw_acoustic_loc.core.types import Bearing, HydrophoneInfo, Samples
from uw_acoustic_loc.graph import load_graph
from uw_acoustic_loc.wire.codec import codec

RATE, SPACING, SPEED, FULL = 96_000, 0.6, 1480.0, 50.0
START = 1_700_000_000_500_000_000
SETUP = WavSetup(SPACING, SPEED, FULL, START, 0.1, "auv1", (0, 1))
PARAMS = "/**: {ros__parameters: {source_ids: [a], band_low: [20000.0], band_high: [30000.0]}}"


def sound(angle, seconds=2.0):
    """(2, n) of +-1: a chirp of 10 ms, 20 to 30 kHz, every 0.2 s from a direction; hydrophone 1 lies ahead."""
    t = np.arange(round(seconds * RATE)) / RATE
    x = 0.002 * np.random.default_rng(1).standard_normal((2, t.size))
    tdoa = SPACING * np.cos(angle) / SPEED
    for channel, delay in enumerate((tdoa / 2, -tdoa / 2)):
        age = np.mod(t - 0.05 - delay, 0.2)
        x[channel] += np.where(age < 0.01, 0.3 * np.sin(2 * np.pi * (20e3 + 0.5 * 10e3 / 0.01 * age) * age), 0.0)
    return x


def write(path, x, kind):
    """24 bits with Python's own module, as scipy writes none."""
    if kind == "int24":
        with wave.open(str(path), "wb") as file:
            file.setnchannels(len(x))
            file.setsampwidth(3)
            file.setframerate(RATE)
            counts = np.round(x.T * (2**23 - 1)).astype("<i4")
            file.writeframes(counts.reshape(-1, 1).view(np.uint8)[:, :3].tobytes())
        return
    scale = {"int16": 32767, "int32": 2**31 - 1, "float32": 1, "float64": 1}[kind]
    values = x.T * scale
    wavfile.write(path, RATE, (np.round(values) if kind.startswith("int") else values).astype(kind))


def read(bag, topic, kind):
    form = codec(kind)
    return [form.decode(deserialize(r.data, r.msgtype), r.t_ns) for r in Bag(bag).records([topic])]


@pytest.mark.parametrize("kind", ["int16", "int24", "int32", "float32", "float64"])
@pytest.mark.parametrize("angle", [0.8, 2.0])
def test_a_wav_gives_the_right_bearings(tmp_path: Path, kind: str, angle: float):
    write(tmp_path / "a.wav", sound(angle), kind)
    convert_wav([tmp_path / "a.wav"], tmp_path / "bag", SETUP)
    (tmp_path / "params.yaml").write_text(PARAMS)
    (tmp_path / "graph.yaml").write_text("nodes: [{executable: bearing, namespace: auv1, params: params.yaml}]")
    refused = []
    graph = load_graph(tmp_path / "graph.yaml")
    OfflineRun(Bag(tmp_path / "bag"), graph, lambda *what: refused.append(what)).run(
        tmp_path / "out", False, lambda _: None
    )
    found = read(tmp_path / "out", "/auv1/sources/a/bearing", Bearing)
    assert refused == []
    assert len(found) == 10
    assert [b.bearing for b in found] == pytest.approx([angle] * 10, abs=0.004)
    assert found[0].t_ns == pytest.approx(START + 50_000_000, abs=500_000)


@pytest.mark.parametrize(("kind", "dtype"), [("int16", np.int16), ("int24", np.float32), ("float32", np.float32)])
def test_pressures_info_and_stamps(tmp_path: Path, kind: str, dtype: type):
    x = sound(1.0, seconds=0.25)
    write(tmp_path / "a.wav", x, kind)
    counts = convert_wav([tmp_path / "a.wav"], tmp_path / "bag", SETUP)
    assert counts == {"/auv1/hydrophones/info": 1, "/auv1/hydrophones/samples": 3}
    (info,) = read(tmp_path / "bag", "/auv1/hydrophones/info", HydrophoneInfo)
    assert (info.sample_rate, info.spacing, info.sound_speed) == (RATE, SPACING, SPEED)
    frames = read(tmp_path / "bag", "/auv1/hydrophones/samples", Samples)
    assert [f.t_ns for f in frames] == [START, START + 100_000_000, START + 200_000_000]
    assert [f.h0.size for f in frames] == [9600, 9600, 4800]
    assert frames[0].h1.dtype == dtype
    pressure = np.concatenate([f.h1 for f in frames]) * (info.scale if dtype is np.int16 else 1.0)
    assert pressure == pytest.approx(x[1] * FULL, abs=2 * FULL / 32767)


def test_the_program_takes_channels_and_namespace(tmp_path: Path):
    x = np.stack([np.zeros(RATE // 5), *sound(1.0, seconds=0.2)])
    write(tmp_path / "a.wav", x, "int16")
    out = tmp_path / "bag"
    options = ["--spacing", "0.6", "--channels", "2,1", "--namespace", "", "--start", "1700000000.5", "--frame", "0.05"]
    assert main(["convert-wav", str(tmp_path / "a.wav"), "-o", str(out), *options]) == 0
    frames = read(out, "/hydrophones/samples", Samples)
    assert len(frames) == 4
    assert frames[0].t_ns == START
    assert np.concatenate([f.h0 for f in frames]) == pytest.approx(x[2] * 32767, abs=1)


def file_of(folder: Path, what: str) -> Path:
    path = folder / f"{what}.wav"
    if what == "text":
        path.write_text("no sound")
    elif what == "cut":
        path.write_bytes(b"RIFF" + struct.pack("<I", 36) + b"WAVEfmt " + struct.pack("<I", 16) + b"\x01")
    elif what == "empty":
        path.write_bytes(b"")
    elif what == "mono":
        write(path, sound(1.0, 0.1)[:1], "int16")
    elif what == "nan":
        x = sound(1.0, 0.1)
        x[1, 3] = np.nan
        write(path, x, "float32")
    elif what == "stereo":
        write(path, sound(1.0, 0.1), "int16")
    return path


@pytest.mark.parametrize(
    ("what", "options", "sentence"),
    [
        ("none", [], "none.wav cannot be read: No such file or directory"),
        ("text", [], "text.wav is not a sound file that can be read"),
        ("cut", [], "cut.wav is not a sound file that can be read"),
        ("empty", [], "empty.wav is not a sound file that can be read"),
        (
            "mono",
            [],
            "mono.wav must have channels [0, 1], counted from 0, it has 1; give two files of one channel each as",
        ),
        ("nan", [], "nan.wav must have finite samples, sample 3 is not"),
        ("stereo", [], "stereo.wav has no time in its name or its content: give --start or --time-format"),
        ("stereo", ["--start", "1e30"], "start must be after 1970-01-01 and before 2038-01-19, got 1e+30 s"),
        ("stereo", ["--channels", "0,2"], "must have channels [0, 2], counted from 0, it has 2\n"),
        ("stereo", ["--channels", "1,1"], "channels must be two different numbers from 0, got [1, 1]"),
        ("stereo", ["--channels", "left"], "--channels must be two numbers such as 0,1, got 'left'"),
        ("stereo", ["--spacing", "-1"], "spacing must be positive and finite, got -1.0"),
        ("stereo", ["--sound-speed", "nan"], "sound-speed must be positive and finite, got nan"),
        ("stereo", ["--full-scale", "0"], "full-scale must be positive and finite, got 0.0"),
        ("stereo", ["--frame", "1e-9"], "frame must be at least one sample of 1.04167e-05 s, got 1e-09 s"),
        ("stereo", ["--start", "-5"], "start must be after 1970-01-01 and before 2038-01-19, got -5.0 s"),
        (
            "stereo",
            ["--start", "2147483648"],
            "start must be after 1970-01-01 and before 2038-01-19, got 2147483648.0 s",
        ),
        (
            "stereo",
            ["--start", "2147483647.99"],
            "stereo.wav must begin after 1970-01-01 and end before 2038-01-19, it is",
        ),
        ("stereo", ["--start", "1", "--namespace", "a b"], "namespace 'a b': /a b/hydrophones/info is no topic of ROS"),
        ("stereo", ["--calibration", "1e9"], "calibration must be from -300 to 300 dB re 1 uPa, got 1000000000.0"),
        ("stereo", ["--time-format", "%Q"], "stereo.wav must fit --time-format: 'Q' is a bad directive in format '%Q'"),
        ("stereo", ["--time-format", "%Y"], "stereo.wav must fit --time-format: time data 'stereo' does not match"),
    ],
)
def test_wrong_input_is_one_sentence(tmp_path: Path, capsys, what, options, sentence):
    path = file_of(tmp_path, what)
    assert main(["convert-wav", str(path), "-o", str(tmp_path / "bag"), "--spacing", "0.6", *options]) == 1
    text = capsys.readouterr().err
    assert sentence in text
    assert len(text.strip().splitlines()) == 1
    assert not (tmp_path / "bag").exists()
