"""Shin et al.'s two geometries and their bearings, and every estimator's answers.

Everything is in the frame that moves with the source: it stays, and the vehicle moves to the right. Points are complex
numbers x + iy in m; bearings and answers are arrays (runs, SAMPLES).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry import wrap_angles
from ...core.localizer.bearing_ekf import BearingEkf, range_bank
from ...core.localizer.log_polar import LogPolar, corrected, seen_from
from ...core.localizer.particles import BearingParticles
from ...core.localizer.triangulation import Ray, Triangulation
from ...core.types import Array
from .grid import BearingGrid

Points = NDArray[np.complex128]
StudiedEstimator = BearingParticles | BearingGrid | BearingEkf | Triangulation

SAMPLES = 21
HALF_WIDTH = math.radians(10.0)  # of the uniform errors
STD = HALF_WIDTH / math.sqrt(3)
NEAR, FAR = 1.0, 140.0  # m, the prior: uniform in area along the first bearing
PARTICLES = 2000
START, START_STD = 50 + 50j, 50.0  # m, of the paper's EKF; the paper gives no spread


@dataclass(frozen=True)
class SimulatedCourse:
    """The source begins at (x, y) and moves `step` m to the left per sample, the vehicle being at (0, 0)."""

    title: str
    x: float
    y: float
    step: float

    @property
    def source(self) -> complex:
        return complex(self.x, self.y)

    @property
    def vehicle(self) -> Points:
        """(SAMPLES,) where the vehicle is, seen from the source's frame."""
        return (self.step * np.arange(SAMPLES)).astype(np.complex128)

    @property
    def truth(self) -> Array:
        """(SAMPLES,) bearings in rad."""
        return np.angle(self.source - self.vehicle)


COURSES = {
    "simulation": SimulatedCourse("Simulation: from (10, 53) m, 1 m per sample", 10.0, 53.0, 1.0),
    "sea_trial": SimulatedCourse(
        "Sea trial: from 70 to 110 degrees, 1.5 m apart", 15.0, 15.0 / math.tan(math.radians(20)), 1.5
    ),
}
BATCHED: dict[str, Callable[[SimulatedCourse, Array, np.random.Generator], Points]] = {
    "triangulation": lambda course, heard, _: two_lines(course, heard),
    "ekf": lambda course, heard, _: paper_ekf(course, heard, START),
    "ekf_repeated_reference": lambda course, heard, _: paper_ekf(course, heard, START, repeated=True),
    "ekf_drawn_start": lambda course, heard, rng: paper_ekf(course, heard, drawn_starts(heard, rng)),
    "ekf_log_polar": lambda course, heard, _: log_polar_ekf(course, heard),
}
ONE_BY_ONE = ("particle_filter", "bayes_grid", "particle_filter_gaussian", "ekf_bank", "least_squares")


def bearings(course: SimulatedCourse, runs: int, rng: np.random.Generator) -> Array:
    """Measured bearings in rad."""
    return course.truth + rng.uniform(-HALF_WIDTH, HALF_WIDTH, (runs, SAMPLES))


def answers(key: str, course: SimulatedCourse, runs: int, seed: int) -> Iterator[tuple[str, Points]]:
    """Every estimator's name and answers, the same bearings for all; `key` is the course's name."""
    base = [seed, list(COURSES).index(key)]
    heard = bearings(course, runs, np.random.default_rng(base))
    for name, estimator in BATCHED.items():
        yield name, estimator(course, heard, np.random.default_rng([*base, runs]))
    for name in ONE_BY_ONE:
        rows = (one_run(name, course, row, np.random.default_rng([*base, k])) for k, row in enumerate(heard))
        yield name, np.array(list(rows))


def two_lines(course: SimulatedCourse, heard: Array) -> Points:
    """The first line with the present one (Shin et al. eq. 1-2); the prior's mean before there is a second."""
    x = course.vehicle.real
    with np.errstate(divide="ignore", invalid="ignore"):
        y = (x - x[0]) / (np.tan(math.pi / 2 - heard[:, :1]) - np.tan(math.pi / 2 - heard))
        points = x + y / np.tan(heard) + 1j * y
    points[:, 0] = prior_mean(heard[:, 0])
    return np.asarray(points)


def paper_ekf(course: SimulatedCourse, heard: Array, start: complex | Points, *, repeated: bool = False) -> Points:
    """The EKF in x and y (eq. 3-12); the travelled distance is known here, so it is no state.

    `repeated` takes the reference bearing again at every sample, as eq. 6 and 8 have it, as if its error were new.
    """
    at = np.broadcast_to(start, heard.shape[:1])
    P = tuple(np.full(heard.shape[0], variance) for variance in (START_STD**2, 0.0, START_STD**2))
    found = []
    for k, vehicle in enumerate(course.vehicle):
        if k and repeated:
            at, P = _corrected_xy(at, P, course.vehicle[0], heard[:, 0])
        at, P = _corrected_xy(at, P, vehicle, heard[:, k])
        found.append(at)
    return np.stack(found, axis=1)


def _corrected_xy(
    at: Points, P: tuple[Array, ...], vehicle: complex, bearing: Array
) -> tuple[Points, tuple[Array, ...]]:
    """Eq. 8-12 for one bearing: H = [-y, x] / r^2; P holds the variances of x and y, their covariance in between."""
    line = at - vehicle
    r2 = np.square(np.abs(line))
    hx, hy = -line.imag / r2, line.real / r2
    xx, xy, yy = P
    kx, ky = xx * hx + xy * hy, xy * hx + yy * hy
    S = hx * kx + hy * ky + STD**2
    error = wrap_angles(bearing - np.angle(line)) / S
    return at + (kx + 1j * ky) * error, (xx - kx * kx / S, xy - kx * ky / S, yy - ky * ky / S)


def log_polar_ekf(course: SimulatedCourse, heard: Array) -> Points:
    """Our EKF with the paper's start, all runs at once."""
    at, spread = np.full(heard.shape[0], START), np.full(heard.shape[0], 2 * (START_STD / abs(START)) ** 2)
    state = LogPolar(at, spread, 0j * at)
    found = []
    for k, shift in enumerate(-np.diff(course.vehicle, prepend=0)):
        state = corrected(seen_from(state, shift), np.exp(1j * heard[:, k]), STD**2).state
        found.append(course.vehicle[k] + state.line * np.exp(state.q / 2))  # E exp(zeta)
    return np.stack(found, axis=1)


def drawn_starts(heard: Array, rng: np.random.Generator) -> Points:
    """(runs,) starts from the prior of the particle filter, instead of the paper's lucky guess."""
    ranges = np.sqrt(rng.uniform(NEAR**2, FAR**2, heard.shape[0]))
    return np.asarray(ranges * np.exp(1j * (heard[:, 0] + rng.uniform(-HALF_WIDTH, HALF_WIDTH, heard.shape[0]))))


def prior_mean(first: Array) -> Points:
    """(runs,) the prior's mean range along first bearings."""
    return np.asarray(2 / 3 * (FAR**3 - NEAR**3) / (FAR**2 - NEAR**2) * np.exp(1j * first))


def one_run(name: str, course: SimulatedCourse, heard: Array, rng: np.random.Generator) -> Points:
    """(SAMPLES,) answers of an estimator of the node, or of the grid; the last one holds while there is none."""
    lines = rays(course, heard)
    state, answer, found = begun(name, lines[0], rng), prior_mean(heard[:1])[0], []
    for k, ray in enumerate(lines):
        if k:
            state.update(ray)
        fix = state.estimate()
        answer = answer if fix is None else complex(*fix.mean)
        found.append(answer)
    return np.array(found)


def rays(course: SimulatedCourse, heard: Array) -> list[Ray]:
    """The bearing lines of one run."""
    return [Ray(v.real, v.imag, float(b), STD) for v, b in zip(course.vehicle, heard, strict=True)]


def begun(name: str, ray: Ray, rng: np.random.Generator) -> StudiedEstimator:
    """An estimator of one run after its first bearing."""
    makers: dict[str, Callable[[], StudiedEstimator]] = {
        "particle_filter": lambda: particles(ray, "uniform", rng),
        "particle_filter_gaussian": lambda: particles(ray, "gaussian", rng),
        "bayes_grid": lambda: BearingGrid(ray, NEAR, FAR, noise="uniform", cells=64),
        "ekf_bank": lambda: range_bank(ray, NEAR, FAR),
        "least_squares": lambda: Triangulation(ray, 2 * SAMPLES),
    }
    return makers[name]()


def particles(ray: Ray, noise: str, rng: np.random.Generator) -> BearingParticles:
    """The node's particle filter."""
    return BearingParticles(ray, NEAR, FAR, particles=PARTICLES, noise=noise, rng=rng)
