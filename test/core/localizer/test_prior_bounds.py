"""No estimate leaves what the prior allows: near passes, silences, moving sources, random courses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from uw_acoustic_loc.config import build
from uw_acoustic_loc.core.localizer.config import LocalizerConfig
from uw_acoustic_loc.core.localizer.localizer import SourceLocalizer


class Dive:
    """A vehicle that turns now and then, often past a source within a metre, and is deaf for 10 to 300 s at times."""

    def __init__(self, seed: int, *, moving: bool, **options: object) -> None:
        self.rng = rng = np.random.default_rng([61, seed, moving])
        self.range_max, self.std = float(rng.choice([200.0, 2000.0])), math.radians(rng.choice([0.3, 1.0, 3.0, 8.0]))
        self.speed_std = float(rng.uniform(0.1, 1.0)) if moving else 0.0
        values = {"source_ids": ("a",), "range_max": self.range_max, "source_speed_std": self.speed_std}
        values |= {"mirror": False, "bearing_correlation_time": 0.0} | options
        self.localizer = SourceLocalizer(build(LocalizerConfig, values, "test"), 0)
        self.vehicle, self.yaw, self.speed = 0j, rng.uniform(-3, 3), rng.uniform(0.5, 2.5)
        aside = rng.normal(0, 1.0) * rng.choice([0.1, 1.0, 5.0])
        ahead = complex(math.cos(self.yaw), math.sin(self.yaw))
        self.source = complex(rng.uniform(5, 60), aside) * ahead
        self.velocity = complex(*rng.normal(0, self.speed_std, 2)) if moving else 0j
        self.nees = math.nan

    def run(self, seconds: int) -> Dive:
        rng, quiet, turn = self.rng, 0.0, self.rng.uniform(30, 100)
        for t in range(1, seconds):
            self.vehicle += self.speed * complex(math.cos(self.yaw), math.sin(self.yaw))
            self.source += self.velocity
            if t > turn:
                self.yaw, turn = self.yaw + rng.uniform(-2.5, 2.5), t + rng.uniform(20, 100)
            if t > quiet and rng.random() < 0.02:
                quiet = t + rng.uniform(10, 300)
            if t >= quiet:
                self.hear(t)
        return self

    def hear(self, t: int) -> None:
        line = self.source - self.vehicle
        bearing = math.remainder(math.atan2(line.imag, line.real) - self.yaw + self.rng.normal(0, self.std), math.tau)
        at = self.vehicle.real, self.vehicle.imag, self.yaw
        self.localizer.update(t * 10**9, *at, bearing, self.std**2)
        for side in self.localizer.sides:
            if side.fix is not None:
                self.check(*side.fix, side._start, t)

    def check(self, mean: np.ndarray, cov: np.ndarray, start: np.ndarray, t: int) -> None:
        """Within range_max of where the source was first heard, 4 standard deviations of its own motion beside."""
        reach = self.range_max + 4 * (self.speed_std * t + 0.1 * math.sqrt(t))
        assert np.isfinite(mean).all() and math.dist(mean, start) <= reach
        least, largest = np.linalg.eigvalsh(cov)
        assert 0 < least <= largest <= reach**2
        off = mean - (self.source.real, self.source.imag)
        self.nees = float(off @ np.linalg.solve(cov, off)) / 2


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("noise", ["mixture", "gaussian", "student_t"])
def test_no_ekf_leaves_its_prior(moving, noise):
    """Half of the runs are honest in the sense of a median; tails are what docs/localizer.md says of near passes."""
    dives = [Dive(seed, moving=moving, bearing_noise=noise).run(400) for seed in range(8)]
    nees = [dive.nees for dive in dives if not math.isnan(dive.nees)]
    assert np.median(nees) < 2.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("options", [{"method": "particle_filter", "particles": 300}, {"method": "triangulation"}])
def test_no_other_method_leaves_its_prior(options):
    for seed in range(5):
        Dive(seed, moving=False, **options).run(300)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("mirror", [False, True])
def test_no_ekf_leaves_its_prior_in_hundreds_of_dives(moving, mirror):
    for seed in range(1000, 1150):
        Dive(seed, moving=moving, mirror=mirror).run(600)


def test_a_source_that_leaves_its_prior_restarts_and_says_so():
    """A promise of range_max that is not kept: the source is three times as far."""
    values = {"source_ids": ("a",), "range_max": 20.0, "mirror": False, "bearing_correlation_time": 0.0}
    localizer = SourceLocalizer(build(LocalizerConfig, values | {"process_noise": 0.0}, "test"), 0)
    for k in range(400):
        x, y = 0.15 * k, 0.0
        localizer.update((k + 1) * 10**8, x, y, 0.0, math.atan2(60.0 - y, 10.0 - x), 4e-4)
        side = localizer.sides[0]
        assert side.fix is None or math.dist(side.fix.mean, side._start) <= 20.0
    assert localizer.restarts >= 1 and "range_max" in localizer.restart_reason
