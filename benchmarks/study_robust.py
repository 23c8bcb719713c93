"""Does a likelihood of the noise beat a gate? Buoy tracker and bearing EKF under alpha-stable impulses.

The buoy tracker is used as it is: a weight per arrival (core/robust.py) is worked out from its own prediction and
divides the arrival's variance. So is the localizer, with its own options. Impulses are those of table 1 of Lee et al.
2013 in units of the Gaussian noise.

    python benchmarks/study_robust.py [RUNS] [SEED]
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np

from uw_acoustic_loc.config import configured
from uw_acoustic_loc.core.geometry import wrap_angle
from uw_acoustic_loc.core.impulsive import AlphaStable, ImpulsiveNoise, mixture_weights, student_t_weights
from uw_acoustic_loc.core.localizer.config import LocalizerConfig
from uw_acoustic_loc.core.localizer.localizer import SourceLocalizer
from uw_acoustic_loc.core.localizer.triangulation import Ray
from uw_acoustic_loc.core.toa.config import ToaConfig
from uw_acoustic_loc.core.toa.model import arrival_times, predict
from uw_acoustic_loc.core.toa.paths import make_net
from uw_acoustic_loc.core.toa.tracker import ToaTracker
from uw_acoustic_loc.core.types import Array, Arrivals

RUNS = int(sys.argv[1]) if len(sys.argv) > 1 else 40
SEED = int(sys.argv[2]) if len(sys.argv) > 2 else 1
CASES = ((0.0, 10.0), (0.1, 10.0), (0.3, 10.0), (0.3, 3.0))  # fraction of impulses; their scale
EPOCHS, SETTLED = 60, 10  # of the buoy tracker, 1 s apart
BUOYS = np.array([[100.0 * math.cos(a), 100.0 * math.sin(a), 0.0] for a in 2 * np.pi / 5 * np.arange(5)])
TOA_STD, SPEED = 1e-3, 1500.0
BEARINGS, BEARING_STD = 120, math.radians(2.0)  # 1 s apart
PINGER = np.array([20.0, 15.0])
WIDE_OPEN = 1e6  # sigma
LOST = 20.0  # m of error at any time: the run counts as lost, and in no other number
WANDER = 0.02  # m per sqrt(s)
Weigh = Callable[[Array, Array, ImpulsiveNoise], Array]  # innovations, predicted variances, noise -> weights


@lru_cache
def impulse(scale: float) -> AlphaStable:
    return AlphaStable(1.8, 1.0, scale, -0.3 * scale)


def everything(innovations: Array, predicted_var: Array, noise: ImpulsiveNoise) -> Array:
    return np.ones(len(innovations))


def gated(sigma: float, innovations: Array, predicted_var: Array, noise: ImpulsiveNoise) -> Array:
    inside = np.square(innovations) <= sigma**2 * (predicted_var + noise.std**2)
    return np.where(inside, 1.0, 1e-9)


def student_t(dof: float, innovations: Array, predicted_var: Array, noise: ImpulsiveNoise) -> Array:
    return student_t_weights(innovations, predicted_var, noise.std, dof)


def mixture_told(innovations: Array, predicted_var: Array, noise: ImpulsiveNoise) -> Array:
    """A user who knows the Gaussian part only, and takes table 1's impulses in every fifth measurement."""
    return mixture_weights(innovations, predicted_var, ImpulsiveNoise(noise.std, 0.2, impulse(10.0)))


POLICIES: dict[str, Weigh] = {
    "no gate": everything,
    "gate 3 sigma": partial(gated, 3.0),
    "gate 5 sigma": partial(gated, 5.0),
    "Student-t, 4 dof": partial(student_t, 4.0),
    "Student-t, 2 dof": partial(student_t, 2.0),
    "mixture, known": mixture_weights,
    "mixture, e = 0.2, scale 10": mixture_told,
}


def toa_run(weigh: Weigh | str, noise: ImpulsiveNoise, seed: int) -> tuple[Array, Array]:
    """Errors (n, 3) in m and NEES (n,) of the settled epochs; `weigh` may be the node's own `noise`."""
    net, rng = make_net(range(5), BUOYS, 0.0), np.random.default_rng([seed, 1])
    start = (60.0, 0.0, -15.0)
    own = {"noise": weigh, "impulse_fraction": noise.fraction, "impulse_scale": noise.impulse.scale}
    own |= {"impulse_location": noise.impulse.location}
    gate = own if isinstance(weigh, str) else {"gate_sigma": WIDE_OPEN, "lost_epochs": 10_000}
    known = {"initial_position": start, "initial_position_std": (2.0, 2.0, 2.0), "initial_velocity": (0.0, 1.5, 0.0)}
    config = configured(ToaConfig, cold_start=False, start_epochs=1, **known, **gate)  # type: ignore[arg-type]
    tracker, estimate, errors, nees = ToaTracker(config, net), None, [], []
    receiver, path = np.arange(5, dtype=np.uint16), np.full(5, Arrivals.DIRECT, np.uint8)
    for k in range(EPOCHS):
        turn = 1.5 / 60.0 * k  # a circle of 60 m at 1.5 m/s
        truth = np.array([60 * math.cos(turn), 60 * math.sin(turn), -15.0])
        time = np.linalg.norm(truth - BUOYS, axis=1) / SPEED + noise.draw(rng, 5)
        std = np.full(5, noise.std)
        if callable(weigh):
            mean, cov = _predicted(config, estimate)
            times, H = arrival_times(mean, net.images[path, receiver])
            spread = np.einsum("ni,ij,nj->n", H, cov, H)
            std /= np.sqrt(weigh(time - times, spread, noise))
        row = Arrivals((k + 1) * 10**9, receiver, path, time, std.astype(np.float32), np.full(5, 20.0, np.float32))
        found = tracker.update(row)
        estimate = found or estimate
        if k >= SETTLED and found:
            off = found.mean[:3] - truth
            errors.append(off)
            nees.append(float(off @ np.linalg.solve(found.cov[:3, :3], off)) / 3)
    return np.array(errors), np.array(nees)


def _predicted(config: ToaConfig, estimate: object) -> tuple[Array, Array]:
    if estimate is None:
        std = [*config.start.initial_position_std, *config.start.initial_velocity_std, config.water.sound_speed_std]
        mean = [*config.start.initial_position, *config.start.initial_velocity, config.water.sound_speed]
        return np.array(mean), np.diag(np.square(std))
    return predict(estimate.mean, estimate.cov, 1.0, config)  # type: ignore[attr-defined]


def localizer_run(options: Mapping[str, object], noise: ImpulsiveNoise, seed: int) -> tuple[Array, Array]:
    """Error (1, 2) in m of the localizer's last position and its NEES."""
    config = LocalizerConfig(("a",), bearing_correlation_time=0.0, process_noise=WANDER, mirror=False, **options)  # type: ignore[arg-type]
    localizer = SourceLocalizer(config, 0)
    for k, ray in enumerate(bearings(noise, seed)):
        localizer.update((k + 1) * 10**9, ray.x, ray.y, 0.0, ray.bearing, noise.std**2)
    fix = localizer.sides[0].fix
    assert fix is not None
    return _fix_error(fix.mean, fix.cov)


def bearings(noise: ImpulsiveNoise, seed: int) -> Iterator[Ray]:
    """Once round the pinger; the first bearing is no impulse, since a start is not for a weight."""
    rng = np.random.default_rng([seed, 2])
    for k in range(BEARINGS):
        turn = 2 * np.pi * k / BEARINGS
        x, y = 40 * math.cos(turn), 40 * math.sin(turn)
        error = float(noise.draw(rng, 1)[0]) if k else noise.std * rng.standard_normal()
        yield Ray(x, y, wrap_angle(math.atan2(PINGER[1] - y, PINGER[0] - x) + error), noise.std)


def _fix_error(mean: Array, cov: Array) -> tuple[Array, Array]:
    off = mean - PINGER
    return off[None], np.array([float(off @ np.linalg.solve(cov, off)) / 2])


LOCALIZERS: dict[str, Mapping[str, object]] = {
    "ekf, gaussian": {"bearing_noise": "gaussian"},
    "ekf, gaussian, gate 3 sigma": {"bearing_noise": "gaussian", "gate_sigma": 3.0},
    "ekf, student_t": {"bearing_noise": "student_t"},
    "ekf, mixture": {"bearing_noise": "mixture"},
    **{
        f"particle_filter, {noise}": {"method": "particle_filter", "bearing_noise": noise, "gate_sigma": 100.0}
        for noise in ("gaussian", "student_t", "mixture")
    },
}


def row(name: str, run: Callable[..., tuple[Array, Array]], weigh: object, std: float) -> str:
    cells = []
    for fraction, scale in CASES:
        noise = ImpulsiveNoise(std, fraction, impulse(scale))
        found = [run(weigh, noise, 1000 * SEED + k) for k in range(RUNS)]
        norms = [np.sqrt(np.square(errors).sum(axis=1)) for errors, _ in found]
        kept = [k for k, values in enumerate(norms) if values.max() < LOST]
        rmse = math.sqrt(np.mean(np.square(np.concatenate([norms[k] for k in kept])))) if kept else math.nan
        nees = float(np.mean([found[k][1].mean() for k in kept])) if kept else math.nan
        cells.append(f"{rmse:.2f} | {RUNS - len(kept)} | {nees:.2f}")
    return f"| {name} | " + " | ".join(cells) + " |"


def table(title: str, run: Callable[..., tuple[Array, Array]], policies: Mapping[str, object], std: float) -> None:
    heads = " | ".join(f"e = {e:g}, scale {s:g}: RMSE m | lost | NEES" for e, s in CASES)
    print(f"## {title}\n\n| | {heads} |\n|{'---|' * (1 + 3 * len(CASES))}")
    for name, weigh in policies.items():
        print(row(name, run, weigh, std), flush=True)
    print()


if __name__ == "__main__":
    nodes = {f"the node, noise: {noise}": noise for noise in ("gaussian", "mixture")}
    table("Buoy tracker, 5 buoys, 1 ms", toa_run, {**nodes, **POLICIES}, TOA_STD)
    table("Localizer as it is, 120 bearings of 2 degrees", localizer_run, LOCALIZERS, BEARING_STD)
