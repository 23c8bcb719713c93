"""Real sound in the sea: the delays of three hydrophones close, whichever way the samples came.

With six hydrophones there are twenty triangles. Nothing was fitted: an event is strong where its power in 0.1 s is
twelve times the median on every hydrophone, and a sample lasts 31 us.
"""

from __future__ import annotations

import csv
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from uw_acoustic_loc.bag.definitions import decoded
from uw_acoustic_loc.bag.reader import Bag
from uw_acoustic_loc.bag.sound.convert import WavSetup, convert_mono
from uw_acoustic_loc.core.bearing.gcc import BandSplitter, Correlator, Piece
from uw_acoustic_loc.core.types import Array, HydrophoneInfo, Samples

REPO = Path(__file__).parents[3]
FISH = REPO.parent / "shared" / "data" / "fish_array"
RATE, SOUND_SPEED = 32000.0, 1484.0
SAMPLE = 1 / RATE
LOW, HIGH = 20.0, 1000.0  # Hz, of the fish
WINDOW, STEP, STRONG = 3200, 1600, 12.0


def pairs_of(bag: Path, namespace: str = "") -> tuple[HydrophoneInfo, Array]:
    """The array and all its samples (2, N)."""
    (info,) = (decoded(HydrophoneInfo, r) for r in Bag(bag).records([f"{namespace}/hydrophones/info"]))
    frames = [decoded(Samples, r) for r in Bag(bag).records([f"{namespace}/hydrophones/samples"])]
    return info, np.stack([np.concatenate([f.h0 for f in frames]), np.concatenate([f.h1 for f in frames])])


def strong_windows(channels: Array, usual: Array) -> list[slice]:
    """Where the power in the band is a multiple of the usual one on every channel."""
    windows = [slice(k, k + WINDOW) for k in range(0, channels.shape[1] - WINDOW + 1, STEP)]
    quiet = in_band(channels)
    return [w for w in windows if np.all(np.square(quiet[:, w]).mean(axis=1) > STRONG * usual)]


def in_band(channels: Array) -> Array:
    return np.asarray(sosfiltfilt(butter(4, [LOW, HIGH], "bandpass", fs=RATE, output="sos"), channels, axis=1))


def usual_power(channels: Array) -> Array:
    power = np.square(in_band(channels))[:, : channels.shape[1] // STEP * STEP].reshape(len(channels), -1, STEP)
    return np.asarray(np.median(power.mean(axis=2), axis=1))


def delays(pairs: dict[tuple[int, int], Array], window: slice, spacing: float) -> dict[tuple[int, int], float]:
    """By the correlator of the bearing node, in one wide band."""
    splitter = BandSplitter(RATE, np.array([LOW]), np.array([HIGH]), WINDOW)
    found = {}
    for pair, (h0, h1) in pairs.items():
        envelopes = splitter.split(h0[window].astype(np.float32), h1[window].astype(np.float32)).values[0]
        correlator = Correlator(splitter, envelopes.shape[1], 1.2 * spacing / SOUND_SPEED)
        (correlation,) = correlator.correlate([Piece(0, envelopes, 1e-12)], "cc", 1)
        found[pair] = float(correlation.tdoas[0])
    return found


def closures(tau: dict[tuple[int, int], float]) -> list[float]:
    """How far each triangle is from closing, in s."""
    hydrophones = sorted({number for pair in tau for number in pair})
    return [abs(tau[a, b] + tau[b, c] - tau[a, c]) for a, b, c in combinations(hydrophones, 3)]


def test_the_delays_in_the_bag_close() -> None:
    arrays = {(a, b): pairs_of(REPO / "bags" / "fish_array", f"/pair{a}{b}") for a, b in combinations(range(3), 2)}
    pairs = {pair: samples for pair, (_, samples) in arrays.items()}
    channels = np.stack([pairs[0, 1][0], pairs[0, 1][1], pairs[0, 2][1]]).astype(float)
    assert np.array_equal(pairs[1, 2], channels[1:])
    windows = strong_windows(channels, usual_power(channels))
    assert len(windows) >= 3
    for window in windows:
        tau = delays(pairs, window, max(info.spacing for info, _ in arrays.values()))
        assert max(closures(tau)) < SAMPLE
        for pair, (info, _) in arrays.items():
            assert abs(tau[pair]) < info.spacing / info.sound_speed + SAMPLE


@pytest.mark.skipif(not FISH.exists(), reason="the test data folder fish_array is not beside the repository")
def test_the_delays_of_all_hydrophones_close(tmp_path: Path) -> None:
    with (FISH / "hydrophones.csv").open() as lines:
        positions = np.array([[float(row[axis]) for axis in "xyz"] for row in csv.DictReader(lines)])
    files = sorted(FISH.glob("*.wav"))
    spacing = {(a, b): float(np.linalg.norm(positions[a] - positions[b])) for a, b in combinations(range(6), 2)}
    others = []
    for b in range(1, 6):
        setup = WavSetup(spacing[0, b], SOUND_SPEED, 1.0, 0, 0.1, "", (0, 1))
        convert_mono((files[0], files[b]), tmp_path / f"0{b}", setup)
        info, samples = pairs_of(tmp_path / f"0{b}")
        assert info.t_ns == 1_568_997_538_000_000_000  # 2019-09-20T16:38:58Z, by the names
        others.append(samples[1])
    channels = np.stack([samples[0], *others]).astype(float)
    pairs = {(a, b): channels[[a, b]] for a, b in spacing}
    windows = strong_windows(channels, usual_power(channels))
    assert len(windows) >= 5
    for window in windows:
        tau = delays(pairs, window, max(spacing.values()))
        assert max(closures(tau)) < SAMPLE
        assert all(abs(tau[pair]) < spacing[pair] / SOUND_SPEED + SAMPLE for pair in tau)
