"""A pair of hydrophones that is mounted, spaced and wired otherwise than its driver says, in water without echoes.

Made with none of the package's simulator: pulses are evaluated at each hydrophone's exact time of arrival. Only frames
around pings are written, so that a run of a minute takes a fraction of a second.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from test.known_run import START_NS, t_ns, write_bag
from uw_acoustic_loc.core.geometry import quat_from_rpy, rotation_from_rpy
from uw_acoustic_loc.core.types import HydrophoneInfo, Odometry, Samples

RATE, SOUND_SPEED, FRAME = 200e3, 1500.0, 0.05  # Hz, m/s, s


@dataclass(frozen=True)
class Run:
    """The vehicle turns by `turn` on its way and swings in roll and pitch; `spacing` is the nominal one."""

    seed: int
    delay: float = 0.0  # s, of h0
    scale: float = 1.0
    yaw: float = 0.0  # rad
    invert: bool = False
    spacing: float = 0.1  # m
    band: tuple[float, float] = (26e3, 32e3)  # Hz, swept by each pulse
    pinger: tuple[float, float, float] = (9.0, 4.0, -5.0)  # m
    pulse: float = 4e-3  # s
    snr_db: float = 25.0  # at 10 m, of amplitude over the noise's standard deviation
    turn: float = 3.5  # rad
    speed: float = 0.5  # m/s
    pings: int = 40
    swing: float = 0.05  # rad

    def write(self, folder: Path) -> tuple[Path, Path]:
        """A bag and a graph for it, whose bearing node takes the array for what the driver says."""
        graph, params = folder / "graph.yaml", folder / "params.yaml"
        graph.write_text("nodes: [{executable: bearing, namespace: auv1, params: params.yaml}]\n")
        own = f"source_ids: [a], band_low: [{self.band[0] - 500}], band_high: [{self.band[1] + 500}]"
        own += f", pulse_length: {self.pulse}, threshold: 8.0, min_period: 0.5, range_max: 50.0"
        params.write_text(f"/**/bearing: {{ros__parameters: {{{own}}}}}\n")
        return write_bag(folder / "bag", self.events()), graph

    def events(self) -> Iterator[tuple[int, str, object]]:
        """What the driver and the navigation filter would publish."""
        yield START_NS, "/auv1/hydrophones/info", HydrophoneInfo(START_NS, RATE, self.spacing, SOUND_SPEED, 1.0)
        for time in np.arange(0.0, self.duration, 0.05):
            place, rpy = self.pose(time)
            still = np.zeros(3)
            yield t_ns(time), "/auv1/odometry", Odometry(t_ns(time), place, quat_from_rpy(*rpy), still, still)
        rng = np.random.default_rng([self.seed, 5])
        for k in range(self.pings):
            yield from self._frames(0.2 + 1.5 * k, rng)

    @property
    def duration(self) -> float:
        return 1.5 * self.pings

    def pose(self, time: float) -> tuple[np.ndarray, tuple[float, float, float]]:
        """Of base_link: an arc that bends evenly."""
        rate = self.turn / self.duration
        yaw = 0.3 + rate * time
        if rate:
            along = self.speed / rate * np.array([math.sin(yaw) - math.sin(0.3), math.cos(0.3) - math.cos(yaw)])
        else:
            along = self.speed * time * np.array([math.cos(0.3), math.sin(0.3)])
        swing = self.swing * math.sin(2 * math.pi * time / 3.1), self.swing * math.sin(2 * math.pi * time / 4.3)
        return np.array([*along, -2.0 + 0.3 * math.sin(time / 9.0)]), (*swing, yaw)

    def _frames(self, emission: float, rng: np.random.Generator) -> Iterator[tuple[int, str, Samples]]:
        """Three, with the ping in the second: the node learns its noise from the first."""
        under_way = float(np.linalg.norm(np.subtract(self.pinger, self.pose(emission)[0]))) / SOUND_SPEED
        place, rpy = self.pose(emission + under_way + 0.5 * self.pulse)
        axis = rotation_from_rpy(*rpy) @ np.array([math.cos(self.yaw), math.sin(self.yaw), 0.0])
        arms = [side * self.scale * self.spacing / 2 * axis for side in (-1, 1)]
        times = [emission + float(np.linalg.norm(np.subtract(self.pinger, place + arm))) / SOUND_SPEED for arm in arms]
        times[0] += self.delay
        begin = round((times[1] - 1.3 * FRAME) * RATE) / RATE
        t = begin + np.arange(round(3 * FRAME * RATE)) / RATE
        level = 10 ** (self.snr_db / 20) * 10.0 / ((times[1] - emission) * SOUND_SPEED)
        phase = rng.uniform(0.0, 2 * math.pi)
        sound = [level * self._pulse(t - time, phase) + rng.standard_normal(t.size) for time in times]
        sound[1] *= -1 if self.invert else 1
        for k in range(3):
            part = slice(k * t.size // 3, (k + 1) * t.size // 3)
            stamp = t_ns(t[part][0])
            h0, h1 = (channel[part].astype(np.float32) for channel in sound)
            yield stamp + round(FRAME * 1e9), "/auv1/hydrophones/samples", Samples(stamp, h0, h1)

    def _pulse(self, t: np.ndarray, phase: float) -> np.ndarray:
        low, high = self.band
        inside = np.clip(t / self.pulse, 0.0, 1.0)
        edge = np.sin(0.5 * np.pi * np.minimum(1.0, 10 * np.minimum(inside, 1 - inside))) ** 2
        return edge * np.cos(2 * np.pi * (low + 0.5 * (high - low) * inside) * t + phase)


def drawn(seed: int, **given: object) -> Run:
    """An array and a pinger of any kind."""
    rng = np.random.default_rng([seed, 4])
    angle, far = rng.uniform(0, 2 * math.pi), rng.uniform(6.0, 14.0)
    pinger = (4.0 + far * math.cos(angle), 4.0 + far * math.sin(angle), -2.0 - rng.uniform(0.0, 4.0))
    wrong = {"delay": rng.uniform(-4e-6, 4e-6), "scale": rng.uniform(0.96, 1.04), "yaw": rng.uniform(-0.5, 0.5)}
    kind = {"invert": bool(rng.random() < 0.5), "spacing": float(rng.uniform(0.05, 0.3))}
    return replace(Run(seed, pinger=pinger, **wrong, **kind), **given)
