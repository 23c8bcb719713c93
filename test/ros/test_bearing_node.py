"""The bearing node as a process: retuning while it runs, refusals, faults of the samples in diagnostics."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.serialization import serialize_message

from test.ros.conftest import Bench
from uw_acoustic_loc.core.types import Bearing, HydrophoneInfo, Samples
from uw_acoustic_loc.ros.rclpy_messages import RosMake
from uw_acoustic_loc.wire.codec import codec

RATE, SPACING, SPEED = 100_000.0, 0.6, 1500.0
START = 1_780_272_000_000_000_000
INFO = HydrophoneInfo(START, RATE, SPACING, SPEED, 1e-3)
PARAMS = (
    "/**: {ros__parameters: {source_ids: [a, b], band_low: [18000.0, 26000.0], band_high: [24000.0, 32000.0],"
    " lateness: 0.05}}"
)
A, B, OTHER = (18e3, 24e3), (26e3, 32e3), (36e3, 42e3)


def chirp(band: tuple[float, float], angle: float, onset: float) -> Any:
    """(2, 10 000) Pa: a ping of 10 ms from an angle; hydrophone 1 lies ahead."""
    tdoa = SPACING * np.cos(angle) / SPEED
    age = np.arange(10_000) / RATE - onset - np.array([[tdoa / 2], [-tdoa / 2]])
    wave = np.sin(2 * np.pi * (band[0] + (band[1] - band[0]) / 0.02 * age) * age)
    return np.where((age >= 0) & (age < 0.01), wave, 0.0)


def frame(k: int, *pings: tuple[tuple[float, float], float], kind: type = np.int16) -> Samples:
    """Frame k of 0.1 s with a ping per (band, angle)."""
    x = 0.02 * np.random.default_rng(k).standard_normal((2, 10_000))
    for n, (band, angle) in enumerate(pings):
        x += chirp(band, angle, 0.02 + 0.04 * n)
    x = (x / INFO.scale).astype(np.int16) if kind is np.int16 else x.astype(np.float32)
    return Samples(START + k * 100_000_000, x[0], x[1])


class Told:
    """The last status of the node."""

    def __init__(self, bench: Bench, name: str) -> None:
        self.level, self.message, self.values = 0, "", dict[str, str]()
        self._name = name
        bench.node.create_subscription(DiagnosticArray, "/diagnostics", self._note, 10)

    def _note(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._name:
                self.level, self.message = status.level[0], status.message
                self.values = {pair.key: pair.value for pair in status.values}


@pytest.fixture
def name(bench: Bench, tmp_path: Path) -> str:
    started = bench.start("bearing", params=PARAMS, folder=tmp_path)
    for source in "ab":
        bench.listen(f"/sources/{source}/bearing", Bearing)
    bench.latch("/hydrophones/info", INFO)
    return started


def bearings(bench: Bench, source: str) -> list[float]:
    return [value.bearing for value in bench.received[f"/sources/{source}/bearing"]]


def play(bench: Bench, name: str, frames: list[Samples]) -> None:
    for one in frames:
        bench.publish("/hydrophones/samples", one)
        bench.executor.spin_once(timeout_sec=0.005)
    taken = bench.count = getattr(bench, "count", 0) + len(frames)

    def all_taken() -> bool:
        counts = bench.report(name, finish=True).counts
        return counts.get("hydrophones/samples", {}).get("received") == taken

    bench.wait(all_taken, f"{taken} frames to be taken")


def change(bench: Bench, **bands: list[float]) -> list[Any]:
    """Sets parameters at once; the answers."""
    kind = ParameterType.PARAMETER_DOUBLE_ARRAY
    given = [
        Parameter(name=key, value=ParameterValue(type=kind, double_array_value=value)) for key, value in bands.items()
    ]
    answer = bench.call(SetParameters, "/bearing/set_parameters", SetParameters.Request(parameters=given))
    return list(answer.results)


def test_a_retuned_pinger_is_heard_on_its_new_band(bench: Bench, name: str) -> None:
    play(bench, name, [frame(k, (A, 1.0), (B, 2.0)) for k in range(6)])
    bench.wait(lambda: len(bearings(bench, "b")) == 6, "bearings in the old band")
    for key, value in (("band_high", [24e3, 42e3]), ("band_low", [18e3, 36e3])):
        (answer,) = change(bench, **{key: value})
        assert answer.successful, answer.reason
    play(bench, name, [frame(k, (A, 1.0), (OTHER, 0.7)) for k in range(6, 12)])
    bench.wait(lambda: len(bearings(bench, "a")) == 12, "bearings of the other source all along")
    bench.wait(lambda: len(bearings(bench, "b")) >= 11, "bearings in the new band")
    assert bearings(bench, "a") == pytest.approx([1.0] * 12, abs=0.01)
    assert bearings(bench, "b")[-4:] == pytest.approx([0.7] * 4, abs=0.02)


def test_a_bad_band_is_refused_with_its_sentence_and_nothing_changes(bench: Bench, name: str) -> None:
    play(bench, name, [frame(k, (A, 1.0), (B, 2.0)) for k in range(3)])
    bad = {
        "band_high must be": [24e3],
        "band_low of source a must be below its band_high 17000 Hz": [17e3, 32e3],
        "band must be 0 < low < high < 50000 Hz, got 26000 to 60000 Hz": [24e3, 60e3],
    }
    for sentence, value in bad.items():
        (answer,) = change(bench, band_high=value)
        assert not answer.successful
        assert sentence.removesuffix(" must be") in answer.reason
    play(bench, name, [frame(k, (A, 1.0), (B, 2.0)) for k in range(3, 6)])
    bench.wait(lambda: len(bearings(bench, "b")) == 6, "bearings in the old band")
    assert bearings(bench, "b") == pytest.approx([2.0] * 6, abs=0.01)
    assert bench.processes[name].poll() is None


def test_a_frame_with_nan_is_counted_and_the_next_is_used(bench: Bench, name: str) -> None:
    told = Told(bench, name)
    frames = [frame(k, (A, 1.0), (B, 2.0), kind=np.float32) for k in range(6)]
    frames[2].h1[77] = np.nan
    play(bench, name, frames)
    bench.wait(lambda: told.values.get("hydrophones/samples rejected") == "1", "diagnostics")
    bench.wait(lambda: len(bearings(bench, "a")) == 5, "bearings of the other frames")
    assert told.values["gaps"] == "1"
    assert np.isfinite(bearings(bench, "a")).all()


def test_bytes_that_are_no_message_are_counted(bench: Bench, name: str) -> None:
    told = Told(bench, name)
    whole = bytes(serialize_message(codec(Samples).encode(RosMake(), frame(0, (A, 1.0)))))
    play(bench, name, [frame(k, (A, 1.0), (B, 2.0)) for k in range(3)])
    for data in (whole[: len(whole) // 2], b"\0\1\0\0no such message"):
        bench.publish_message("/hydrophones/samples", codec(Samples).msgtype, data)
    bench.wait(lambda: told.values.get("hydrophones/samples malformed") == "2", "diagnostics")
    assert len(bearings(bench, "a")) == 3


def test_clipping_and_lost_frames_are_named(bench: Bench, name: str) -> None:
    told = Told(bench, name)
    frames = [frame(k, (A, 1.0), (B, 2.0)) for k in range(8)]
    frames[6].h0[100:110] = 32767
    play(bench, name, frames[:3] + frames[5:])
    bench.wait(lambda: "hydrophone 0 clips: 10 samples at full scale so far" in told.message, "the warning")
    assert told.level == 1
    assert told.values["gaps"] == "1"


def test_a_dead_hydrophone_is_named(bench: Bench, name: str) -> None:
    told = Told(bench, name)
    frames = [frame(k, (A, 1.0), (B, 2.0)) for k in range(4)]
    for one in frames:
        one.h1[:] = 0
    play(bench, name, frames)
    bench.wait(lambda: "hydrophone 1 is dead" in told.message, "the warning")
    assert told.level == 1
    assert bearings(bench, "a") == []
