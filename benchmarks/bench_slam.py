"""EKF-SLAM: an inertial prediction and three bearings with 5 to 200 pingers, ours against the textbook's dense form.

Both have 15 states of the vehicle and 2 for each pinger, take the same readings, and must end with the same mean and
covariance: the textbook is Thrun, Burgard, Fox 2005, table 10.1 without data association, with the strapdown motion of
`core.inertial`. A pass over P is the least that a scalar update written in numpy does: P -= outer(g, g).
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from timing import Row, in_turn, report

from uw_acoustic_loc.core.localizer.triangulation import PlanarFix
from uw_acoustic_loc.core.slam.inertial import GYRO_BIAS, SIZE, VELOCITY, YAW, moved
from uw_acoustic_loc.core.slam.joint import Joint, Slot

GOALS = {5: 0.0, 50: 10.0, 100: 30.0, 200: 50.0}  # times faster, by number of pingers
PASSES = 2.5  # over P that ours may take with 200
DT, GYRO, ACCELEROMETER, BEARING = 0.01, 0.01**2, 0.1**2, math.radians(5) ** 2
RATES, FORCE, OFFSET = np.array([0.0, 0.0, 0.02]), np.array([0.0, 0.0, 9.81]), np.zeros(2)
START = np.diag([0.01] * 3 + [1e-4] * 3 + [1e-4] * 3 + [4e-6] * 3 + [2.5e-5] * 3)
ERROR = 1e-3  # rad, every innovation
SECONDS = 4.0
Step = Callable[[int], None]  # to hear the pingers k, k + 1, k + 2


def pingers(count: int) -> np.ndarray:
    """(count, 2) 50 to 100 m away."""
    rng = np.random.default_rng(1)
    angle, distance = rng.uniform(-math.pi, math.pi, count), rng.uniform(50, 100, count)
    return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)


def start() -> np.ndarray:
    mean = np.zeros(SIZE)
    mean[VELOCITY.start] = 0.5
    return mean


class Ours:
    def __init__(self, places: np.ndarray) -> None:
        mean = start()
        self.joint = Joint(mean, np.diag(START))
        self.slots: list[Slot] = []
        for x, y in places:
            J = np.zeros((2, SIZE))
            J[0, 0] = J[1, 1] = 1.0
            J[:, YAW] = -y, x
            self.slots.append(self.joint.add(PlanarFix(np.array([x, y]), np.eye(2)), J))

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.joint.mean, self.joint.cov

    def __call__(self, k: int) -> None:
        joint = self.joint
        joint.move(*moved(joint.mean, RATES, FORCE, DT), _DRIVING, _ADDED)
        for i in range(k, k + 3):
            prediction = joint.bearing(self.slots[i % len(self.slots)], OFFSET)
            joint.correct(prediction, ERROR, BEARING)


class Textbook:
    """Dense: F P F' + Q and (I - K H) P with matrices of the whole state, one bearing after the other."""

    def __init__(self, ours: Ours) -> None:
        self.mean, self.P = (part.copy() for part in ours.state)

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.mean, self.P

    def __call__(self, k: int) -> None:
        self.predict()
        count = (self.mean.size - SIZE) // 2
        for i in range(k, k + 3):
            self.correct(SIZE + 2 * (i % count))

    def predict(self) -> None:
        n = self.mean.size
        F, Q = np.eye(n), np.zeros((n, n))
        self.mean[:9], F[:9, :12] = moved(self.mean, RATES, FORCE, DT)
        Q[:9, :9] = process_noise(F[:9, :12])
        self.P = F @ self.P @ F.T + Q

    def correct(self, s: int) -> None:
        n = self.mean.size
        dx, dy = self.mean[s : s + 2] - self.mean[:2]
        squared = dx * dx + dy * dy
        H = np.zeros((1, n))
        H[0, [0, 1, YAW, s, s + 1]] = dy / squared, -dx / squared, -1.0, -dy / squared, dx / squared
        S = H @ self.P @ H.T + BEARING
        K = self.P @ H.T @ np.linalg.inv(S)
        self.mean += K[:, 0] * ERROR
        self.P = (np.eye(n) - K @ H) @ self.P


def process_noise(F: np.ndarray) -> np.ndarray:
    turning = F[:, GYRO_BIAS]
    Q = turning @ turning.T * GYRO
    Q[_VELOCITIES, _VELOCITIES] += ACCELEROMETER * DT**2
    return Q


def endless(step: Step) -> Callable[[], None]:
    k = 0

    def call() -> None:
        nonlocal k
        k += 3
        step(k)

    return call


def plain_pass(P: np.ndarray) -> Callable[[], None]:
    g = np.full(len(P), 1e-9)

    def call() -> None:
        nonlocal P
        P -= np.outer(g, g)

    return call


def difference(count: int) -> str:
    """Ours against the textbook after 20 steps, in standard deviations of the mean and as a share of the variances."""
    ours = Ours(pingers(count))
    book = Textbook(ours)
    for k in range(0, 60, 3):
        ours(k)
        book(k)
    std = np.sqrt(np.diag(book.P))
    off = np.abs(ours.joint.mean - book.mean) / std
    spread = np.abs(ours.joint.cov - book.P) / np.outer(std, std)
    return f"mean {off.max():.0e} sigma, P {spread.max():.0e}"


def compare(count: int) -> int:
    ours = Ours(pingers(count))
    calls = {
        "ours": endless(ours),
        "textbook": endless(Textbook(Ours(pingers(count)))),
        "a pass over P": plain_pass(ours.joint.cov.copy()),
    }
    medians = in_turn(calls, SECONDS)
    rows = [
        Row("a pass over P", medians["a pass over P"], ours_within=PASSES if count == 200 else 0.0),
        Row("ours", medians["ours"], difference(count)),
        Row("textbook", medians["textbook"], at_least=GOALS[count]),
    ]
    return report(f"EKF-SLAM with {count} pingers: prediction and 3 bearings", "ours", rows)


def main() -> int:
    return max([compare(count) for count in GOALS])


_VELOCITIES = np.arange(VELOCITY.start, VELOCITY.stop)
_DRIVING, _ADDED = np.zeros(12), np.zeros(9)
_DRIVING[GYRO_BIAS], _ADDED[VELOCITY] = GYRO, ACCELEROMETER * DT**2

if __name__ == "__main__":
    sys.exit(main())
