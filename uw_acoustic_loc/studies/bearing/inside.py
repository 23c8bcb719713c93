"""Pictures of what goes on inside the bearing node: extraction, correlation, likelihood, particles, posterior."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ...core.bearing.config import BearingConfig
from ...core.bearing.detection import DB, energies
from ...core.bearing.estimator import BearingEstimator
from ...core.bearing.filters import HistogramFilter, ParticleFilter, PeakLikelihood
from ...core.bearing.gcc import BandSplitter, Correlation
from ...core.types import AnyArray, Array, HydrophoneInfo
from ...evaluation.plot import BLUE, ORANGE, RED, TRUTH, Picture, canvas, legend_below, picture
from ...resources import resource
from ...sim.hydrophones import HydrophoneSource
from ...sim.scenario import load_scenario
from . import trials
from .trials import FRAME_NS, NARROW, MultipathChannel

US = 1e6
SHOWN_PEAKS = 4  # Shin et al. 2013
AZIMUTH = math.radians(70.0)
_FRAME, _WARM_UP = 940, 30  # of the harbour scenario: shown, heard before
_ONE_PING, _FEW_PINGS = 4, 5  # keep the random numbers of the pictures apart


def extraction() -> Picture:
    """Choi et al. 2016, fig. 1: three pingers in one frame."""
    scenario = load_scenario(resource("config/harbour/scenario.yaml"))
    source, pingers = HydrophoneSource(scenario), scenario.pingers
    info = _info(source)
    low, high = (tuple(getattr(p, name) for p in pingers) for name in ("band_low", "band_high"))
    node = BearingEstimator(BearingConfig(tuple(p.id for p in pingers), low, high, "none"), info)
    pings = [heard for k in range(_FRAME - _WARM_UP, _FRAME + 2) for heard in node.process(source.frame(k))]
    frame = source.frame(_FRAME)
    h0, h1 = frame.h0 * info.scale, frame.h1 * info.scale
    envelopes = BandSplitter(info.sample_rate, np.array(low), np.array(high), h0.size).split(h0, h1)
    figure, axes = canvas(1 + len(pingers), 1, 1.35, sharex=True)
    axes[0, 0].plot(np.arange(h0.size) / info.sample_rate * 1e3, h0, color=TRUTH, linewidth=0.4)
    axes[0, 0].set(ylabel="pressure (Pa)", title="hydrophone 0", xlim=(0.0, h0.size / info.sample_rate * 1e3))
    for k, energy in enumerate(np.log(energies(envelopes))):
        axis, begins = axes[k + 1, 0], [(b.t_ns - frame.t_ns) * 1e-6 for source, b in pings if source == k]
        _band(axis, DB * energy - node.listener.noise_db(k), envelopes.rate, begins)
        axis.set(ylabel="level (dB)", title=f"pinger {pingers[k].id}, {low[k] / 1e3:g} to {high[k] / 1e3:g} kHz")
    axes[-1, 0].set_xlabel("time in the frame (ms)")
    legend_below(figure, axes[-1, 0])
    caption = (
        "A frame of the harbour scenario: the pressure, and in each pinger's band the level over the noise floor, mean "
        "logarithm over a pulse length. Pings are shaded where the node takes them to be, and "
        "the band says whose (Choi et al. 2016, fig. 1). The later humps are the same ping over surface and seabed: "
        "they repeat with it, and come after it."
    )
    return picture("Three pingers in one frame", caption, figure)


def _info(source: HydrophoneSource) -> HydrophoneInfo:
    return next(value for _, _, value in source.events() if isinstance(value, HydrophoneInfo))


def _band(axis: Any, level: AnyArray, rate: float, begins: list[float]) -> None:
    """Level (dB) of one band over the mean of one channel's noise, and the pings that begin at the given ms."""
    config = BearingConfig()
    window = round(config.detection.pulse_length * rate)
    mean = np.convolve(level - DB * (math.log(2.0) + 1.0 - np.euler_gamma), np.full(window, 1.0 / window), "valid")
    axis.plot((np.arange(mean.size) + window / 2) / rate * 1e3, mean, color=BLUE, label="level over the noise floor")
    for begin in begins:
        end = begin + config.detection.pulse_length * 1e3
        axis.axvspan(begin, end, color=ORANGE, alpha=0.3, linewidth=0, label="ping")


def correlations(seed: int) -> Picture:
    """Shin et al. 2013, fig. 5 and 6."""
    figure, axes = canvas(2, 2, 2.4, sharex=True, sharey="row")
    for column, case in zip(axes.T, trials.CASES, strict=True):
        found, truth = _misleading(case, seed)
        column[0].plot(found.lags * US, found.values / found.values.max(), color=BLUE, linewidth=0.9, label="GCC")
        peaks = slice(SHOWN_PEAKS)
        column[0].plot(found.tdoas[peaks] * US, found.heights[peaks], "o", color=RED, label="its 4 largest maxima")
        grid = np.linspace(found.lags[0], found.lags[-1], 40_001)
        column[1].semilogy(grid * US, _likelihood(found, case).at(grid) / US, color=RED, lw=0.9, label="likelihood")
        for axis in column:
            axis.axvline(truth * US, color=TRUTH, linestyle="--", linewidth=1.0, label="true TDOA")
        low, high = (f / 1e3 for f in case.band)
        column[0].set_title(f"{low:g} to {high:g} kHz, {case.snr_db:g} dB")
        column[1].set_xlabel("TDOA (µs)")
    axes[0, 0].set_ylabel("GCC, relative")
    axes[1, 0].set_ylabel("likelihood (1/µs)")
    axes[1, 0].set_ylim(bottom=1e-5)
    legend_below(figure, axes[0, 0], axes[1, 0])
    caption = (
        "One ping with echoes whose largest maximum is not the true one, and the likelihood made of all its maxima: "
        "normal distributions weighted by height on a uniform floor (Shin et al. 2013, fig. 5 and 6)."
    )
    return picture("Correlation, maxima and likelihood", caption, figure)


def _misleading(case: MultipathChannel, seed: int) -> tuple[Correlation, float]:
    """The first ping at 70 degrees whose strongest maximum is a gross error, and the true TDOA."""
    scene, config = case.scene, BearingConfig()
    truth, rng = scene.tdoa(AZIMUTH), np.random.default_rng([seed, _ONE_PING])
    threshold, peaks = config.detection.threshold, config.correlation.peaks
    off = math.radians(trials.GROSS_DEG) * scene.spacing / scene.sound_speed
    while True:
        listener, frame = trials.estimator(scene, "none", seed).listener, scene.frame(AZIMUTH, case.snr_db, rng)
        for heard in listener.hear(frame, threshold, config.correlation.weighting, peaks):
            if abs(heard.correlation.tdoas[0] - truth) > off:
                return heard.correlation, truth


def _likelihood(found: Correlation, case: MultipathChannel) -> PeakLikelihood:
    config, scene = BearingConfig(), case.scene
    shared = config.noise.phase_std / math.sqrt(found.curvature)
    return PeakLikelihood.of(found, shared, config.noise.height_std, scene.spacing / scene.sound_speed)


def clouds(seed: int) -> Picture:
    """Shin et al. 2013, fig. 3 and 8."""
    figure, axes = canvas(1, 3, 2.1, sharex=True, sharey=True)
    shown = {0: "before the first ping", 1: "after 1 ping", 10: "after 10 pings"}
    for pings, state in _after("particle", NARROW, seed, max(shown)):
        if pings in shown and isinstance(state, ParticleFilter):
            axis = axes[0, list(shown).index(pings)]
            _cloud(axis, *state.cloud)
            axis.set_title(shown[pings])
    axes[0, 0].set_ylabel("y in the array's frame (m)")
    legend_below(figure, axes[0, 1])
    caption = (
        "Particles of one pinger, 24 to 26 kHz, in the half plane that the node assumes. A ping leaves one ray per "
        "carrier cycle; time settles which (Shin et al. 2013, fig. 3 and 8). Two hydrophones do not observe the range: "
        "where along the ray the particles lie is the prior's range, not a measurement."
    )
    return picture("The particle cloud", caption, figure)


def _cloud(axis: Any, xy: Array, weights: Array) -> None:
    order = np.argsort(weights)
    heavy = weights[order] > weights.max() * 1e-3
    x, y = xy[:, order][:, heavy]
    axis.plot(x, y, ".", color=BLUE, markersize=1.5, alpha=0.5, label="particles")
    reach = 105.0
    axis.plot([0, reach * math.cos(AZIMUTH)], [0, reach * math.sin(AZIMUTH)], color=TRUTH, lw=0.9, label="true bearing")
    axis.plot(*(xy @ weights), "+", color=RED, markersize=11, markeredgewidth=1.8, label="weighted mean")
    axis.plot([-0.3, 0.3], [0, 0], "^", color=TRUTH, markersize=4, label="hydrophones")
    axis.set_aspect("equal")
    axis.set_xlabel("x in the array's frame (m)")


def posteriors(seed: int) -> Picture:
    """Choi et al. 2016, fig. 3."""
    shown = (1, 3, 10)
    figure, axes = canvas(len(shown), 1, 1.5, sharex=True)
    for pings, state in _after("histogram", NARROW, seed, max(shown)):
        if pings in shown and isinstance(state, HistogramFilter):
            axis = axes[shown.index(pings), 0]
            tdoas, p = state._tdoas, state._p[: state._tdoas.size].copy()
            p[1:-1] += state._p[: state._tdoas.size - 1 : -1]  # of the other side, which has the same TDOA
            density = p / np.abs(np.gradient(tdoas * US))
            shown_bins = np.abs(tdoas) < 0.98 * np.abs(tdoas).max()  # those at end-fire have no width
            axis.plot(tdoas[shown_bins] * US, density[shown_bins], color=BLUE, linewidth=0.9, label="posterior")
            axis.axvline(NARROW.scene.tdoa(AZIMUTH) * US, color=RED, linestyle="--", linewidth=0.9, label="true TDOA")
            axis.set_title(f"after {pings} ping{'s' if pings > 1 else ''}")
            axis.set_ylabel("density (1/µs)")
    axes[-1, 0].set_xlabel("TDOA (µs)")
    legend_below(figure, axes[0, 0])
    caption = (
        "Posterior density of the histogram filter for the pinger of 24 to 26 kHz at 10 dB with echoes. The first ping "
        "leaves several carrier cycles of 40 µs; those that follow settle it (Choi et al. 2016, fig. 3 and eq. 5)."
    )
    return picture("Posterior over the TDOA", caption, figure)


def _after(filter_: str, case: MultipathChannel, seed: int, count: int) -> Iterator[tuple[int, object]]:
    """(pings, filter) before the first ping and after each."""
    rng = np.random.default_rng([seed, _FEW_PINGS])
    scene, node = case.scene, trials.estimator(case.scene, filter_, seed)
    yield 0, _state(node)
    for k in range(count):
        for _ in node.process(scene.frame(AZIMUTH, case.snr_db, rng, scene.info.t_ns + k * FRAME_NS)):
            pass
        yield k + 1, _state(node)


def _state(node: BearingEstimator) -> object:
    return node.tracks[0].filter
