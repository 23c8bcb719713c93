"""Figures of merit of the buoy tracker's trials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.types import AnyArray, Array

SETTLED, JUDGED, LATEST = 10, 5, 20  # pings before RMSE, maximum and loss are taken
LOST = 30.0  # m


@dataclass(frozen=True, eq=False)
class Result:
    """Of all runs of a variant; NaN where there was no estimate."""

    truth: Array  # (runs, PINGS, 7)
    mean: Array  # (runs, PINGS, 7)
    cov: Array  # (runs, PINGS, 7, 7)
    bound: Array  # (PINGS, 7, 7)

    @property
    def error(self) -> Array:
        """(runs, PINGS, 7)."""
        return self.mean - self.truth

    @property
    def nees(self) -> Array:
        """(runs, PINGS) over 7."""
        error, known = self.error, np.isfinite(self.mean[..., 0])
        nees = np.full(known.shape, np.nan)
        solved = np.linalg.solve(self.cov[known], error[known][..., None])[..., 0]
        nees[known] = (error[known] * solved).sum(axis=-1) / 7
        return nees

    @property
    def distance(self) -> Array:
        """(runs, PINGS) error of the position in m."""
        return np.asarray(np.linalg.norm(self.error[..., :3], axis=2))

    @property
    def lost(self) -> AnyArray:
        """(runs,) whether a run was ever off after its start."""
        late = np.nan_to_num(self.distance[:, LATEST:], nan=np.inf)
        return np.asarray(late.max(axis=1) > LOST)

    @property
    def numbers(self) -> dict[str, float | int]:
        """The figures of merit."""
        settled = self.bound[SETTLED:]
        return {
            "mean_m": float(np.nanmean(self.distance)),
            "rmse_m": rms(self.distance),
            "rmse_after_10_m": rms(self.distance[:, SETTLED:]),
            "pcrb_after_10_m": float(np.sqrt(np.mean(np.trace(settled[:, :3, :3], axis1=1, axis2=2)))),
            "p95_max_m": float(np.nanpercentile(np.nanmax(self.distance[:, JUDGED:], axis=1), 95)),
            "sound_speed_rmse": rms(self.error[..., 6]),
            "nees_mean": float(np.nanmean(self.nees)),
            "lost_runs": int(self.lost.sum()),
        }

    @property
    def split(self) -> tuple[float, float]:
        """Horizontal and vertical RMSE after the settling, in m."""
        error = self.error[:, SETTLED:]
        return rms(np.hypot(error[..., 0], error[..., 1])), rms(error[..., 2])

    @property
    def nees_band(self) -> float:
        """Half width of the 95 % interval of the mean NEES, from the spread of the runs: pings are not independent."""
        runs = np.nanmean(self.nees, axis=1)
        return float(1.96 * runs.std() / np.sqrt(len(runs)))


def rms(values: Array) -> float:
    """Root mean square of what there is."""
    return float(np.sqrt(np.nanmean(np.square(values))))
