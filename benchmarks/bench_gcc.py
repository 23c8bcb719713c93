"""Three TDOAs out of a block of two channels: ours, scipy, pyroomacoustics and the usual gcc_phat.

Everyone gets the same block of 10 000 samples at 100 kHz with a ping in each of three bands, and the windows of the
pings, and returns a TDOA finer than a sample for each band. Ours correlates the windows; the peers have no use for
them: they correlate the filtered block. Ours gets float32, as hydrophones send it; the peers get float64, numpy's own
type and their examples'. The snippet is timed with float32 as well, which numpy transforms in half the time since 2.0.
"""

from __future__ import annotations

import importlib.util
import math
import os
import sys
from collections.abc import Callable

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from scipy import fft, signal
from timing import Row, in_turn, report

from uw_acoustic_loc.core.bearing.gcc import BandSplitter, Correlator, Piece

RATE, N, PULSE, MAX_LAG = 100e3, 10_000, 0.01, 0.6 / 1500.0
BANDS = ((18e3, 24e3), (26e3, 32e3), (34e3, 40e3))
SNR_DB = 20.0  # in the band, over the ping
INTERP = 32  # of the peers that pad the spectrum: with 16, their steps would be most of their error
UPSAMPLED = 8  # the peer's correlation near lag 0
HALF_CYCLE = 1e-5  # s; an error beyond it is a wrong cycle
SNIPPET, SINGLE = "gcc_phat snippet, interp 32", "gcc_phat snippet, interp 32, float32"
Solver = Callable[[np.ndarray, np.ndarray, list[float]], list[float]]
Block = tuple[np.ndarray, np.ndarray, list[float], np.ndarray]


def blocks(count: int, rng: np.random.Generator) -> list[Block]:
    """(h0, h1, starts of the pings, TDOAs); float32 samples."""
    t, found = np.arange(N) / RATE, []
    for _ in range(count):
        tdoas, starts = rng.uniform(-0.8, 0.8, 3) * MAX_LAG, 0.01 + 0.025 * np.arange(3) + rng.uniform(0, 0.01, 3)
        noise = math.sqrt(0.5 * 10 ** (-SNR_DB / 10) * (RATE / 2) / 6e3)
        x = noise * rng.standard_normal((2, N))
        for (low, high), tdoa, start in zip(BANDS, tdoas, starts, strict=True):
            age = t - start - np.array([[0.5], [-0.5]]) * tdoa
            wave = np.cos(2 * np.pi * (low * age + (high - low) / (2 * PULSE) * age**2))
            x += np.where((age >= 0) & (age < PULSE), wave, 0.0)
        found.append((*x.astype(np.float32), starts.tolist(), tdoas))
    return found


class Ours:
    def __init__(self) -> None:
        low, high = np.array(BANDS).T
        self.splitter = BandSplitter(RATE, low, high, N)
        self.window = round(1.2 * PULSE * self.splitter.rate)
        self.correlator = Correlator(self.splitter, self.window, MAX_LAG)

    def rows(self, starts: list[float]) -> list[int]:
        return [int((start - 0.1 * PULSE) * self.splitter.rate) for start in starts]

    def __call__(self, h0: np.ndarray, h1: np.ndarray, starts: list[float]) -> list[float]:
        values = self.splitter.split(h0, h1).values
        pieces = [Piece(k, values[k][:, row : row + self.window], 1e-3) for k, row in enumerate(self.rows(starts))]
        return [float(found.tdoas[0]) for found in self.correlator.correlate(pieces, "cc", 4)]


def scipy_filter_correlate() -> Solver:
    """Filters, correlates, and refines the lags that the array allows: a parabola alone finds wrong cycles."""
    filters = [signal.butter(4, band, "bandpass", fs=RATE, output="sos") for band in BANDS]
    reach = 2 * math.ceil(MAX_LAG * RATE)
    middle = slice(N - 1 - reach, N + reach)
    lags = (np.arange(UPSAMPLED * (2 * reach + 1)) / UPSAMPLED - reach) / RATE
    possible = np.flatnonzero(np.abs(lags) <= MAX_LAG + 1 / RATE)
    lags, inner = lags[possible], slice(possible[0], possible[-1] + 1)

    def one(a: np.ndarray, b: np.ndarray) -> float:
        c = signal.correlate(a, b, method="fft")[middle]
        c = signal.resample(c, UPSAMPLED * c.size)[inner]
        k = 1 + int(np.argmax(c[1:-1]))
        return float(lags[k] + 0.5 * (c[k - 1] - c[k + 1]) / (c[k - 1] - 2 * c[k] + c[k + 1]) / (UPSAMPLED * RATE))

    def solve(h0: np.ndarray, h1: np.ndarray, _: list[float]) -> list[float]:
        pair = np.stack([h0, h1])
        return [one(*signal.sosfiltfilt(sos, pair)) for sos in filters]

    return solve


def usual_gcc_phat() -> Solver:
    """The snippet found everywhere, with the phase transform where it belongs: inside the band."""
    n = 2 * N
    freq = np.fft.rfftfreq(n, 1 / RATE)
    masks = [(freq >= low) & (freq <= high) for low, high in BANDS]
    reach = int(INTERP * RATE * MAX_LAG)

    def one(r: np.ndarray) -> float:
        cc = np.fft.irfft(r, n * INTERP)
        cc = np.concatenate([cc[-reach:], cc[: reach + 1]])
        return (int(np.argmax(cc)) - reach) / (INTERP * RATE)

    def solve(h0: np.ndarray, h1: np.ndarray, _: list[float]) -> list[float]:
        r = np.fft.rfft(h0, n) * np.conj(np.fft.rfft(h1, n))
        r /= np.abs(r) + 1e-15
        return [one(r * mask) for mask in masks]

    return solve


def pyroom_tdoa() -> Solver:
    from pyroomacoustics.experimental import tdoa  # noqa: PLC0415

    filters = [signal.butter(4, band, "bandpass", fs=RATE, output="sos") for band in BANDS]

    def solve(h0: np.ndarray, h1: np.ndarray, _: list[float]) -> list[float]:
        pairs = (signal.sosfiltfilt(sos, np.stack([h0, h1])) for sos in filters)
        return [float(tdoa(a, b, interp=INTERP, fs=RATE, phat=False)) for a, b in pairs]

    return solve


def bare_fft(h0: np.ndarray, h1: np.ndarray) -> np.ndarray:
    """Both channels as one complex array through one FFT of a fast length."""
    z = np.zeros(fft.next_fast_len(N), np.complex64)
    z.real[:N], z.imag[:N] = h0, h1
    return fft.fft(z, overwrite_x=True)


def accuracy(solve: Solver, data: list[Block]) -> str:
    errors = np.abs(np.array([np.array(solve(*given)) - tdoas for *given, tdoas in data]))
    right = errors[errors < HALF_CYCLE]
    wrong = 100 * np.mean(errors >= HALF_CYCLE)
    return f"RMSE {1e9 * math.sqrt(np.mean(right**2)):.0f} ns, wrong cycle {wrong:.0f} %"


def main() -> int:
    data = blocks(40, np.random.default_rng(1))
    solvers: dict[str, tuple[Solver, float]] = {
        "ours": (Ours(), 0.0),
        "scipy sosfiltfilt + correlate": (scipy_filter_correlate(), 20.0),
        SNIPPET: (usual_gcc_phat(), 80.0),
    }
    pyroom = "pyroomacoustics tdoa, interp 32"
    installed = importlib.util.find_spec("pyroomacoustics") is not None
    if installed:
        solvers[pyroom] = (pyroom_tdoa(), 50.0)
    h0, h1, starts, _ = data[0]
    d0, d1 = h0.astype(np.float64), h1.astype(np.float64)
    calls: dict[str, Callable[[], object]] = {"bare FFT": lambda: bare_fft(h0, h1)}
    calls |= {name: (lambda s=solve: s(d0, d1, starts)) for name, (solve, _) in solvers.items()}
    calls["ours"] = lambda: solvers["ours"][0](h0, h1, starts)
    calls[SINGLE] = lambda: solvers[SNIPPET][0](h0, h1, starts)
    medians = in_turn(calls, 8.0)
    rows = [Row("bare FFT", medians["bare FFT"], ours_within=3.0)]
    rows += [Row(name, medians[name], accuracy(solve, data), goal) for name, (solve, goal) in solvers.items()]
    rows.append(Row(SINGLE, medians[SINGLE]))
    if not installed:
        rows.append(Row(pyroom, None))
    return report("GCC of 2 x 10 000 samples, 3 bands", "ours", rows)


if __name__ == "__main__":
    sys.exit(main())
