"""The public Python API: estimators on numpy arrays, bags, simulations and scores. It needs no ROS.

These names are stable: `import uw_acoustic_loc as ua` offers them all, and docs/api.md shows each at work. Estimators
take and give the dataclasses of `core.types` (SI units, radians, stamps in integer nanoseconds) and are driven by
stamps alone: the same input and seed give the same output bit for bit, here, offline, and in a live node. What they
cannot use raises ValueError with one sentence.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .bag.definitions import decoded
from .bag.process import OfflineRun
from .bag.reader import Bag
from .bag.simulate import simulate as _simulate
from .config import configured
from .core.bearing.config import BearingConfig
from .core.bearing.estimator import BearingEstimator
from .core.localizer.config import LocalizerConfig
from .core.localizer.localizer import SourceLocalizer
from .core.mooring.estimator import make_filter as mooring_filter
from .core.mooring.model import MooringConfig
from .core.mooring.model import step_of as mooring_step
from .core.multistatic.bound import cramer_rao as sonar_bound
from .core.multistatic.estimator import Noise as SonarNoise
from .core.multistatic.estimator import SonarNet
from .core.multistatic.estimator import locate as locate_target
from .core.slam.config import SlamConfig
from .core.slam.filter import SourceBearing
from .core.slam.relinearise import SlamPasses as SlamEstimator
from .core.toa.config import ToaConfig
from .core.toa.paths import make_net as buoy_net
from .core.toa.tracker import ToaTracker
from .core.types import (
    Arrivals,
    Bearing,
    BodyVelocity,
    Detections,
    HydrophoneInfo,
    Imu,
    NodePositions,
    Odometry,
    Point,
    Position,
    Pressure,
    Samples,
    Scalar,
    Tracks,
)
from .evaluation.recording import load
from .evaluation.score import score as _score
from .graph import load_graph
from .sim.scenario import load_scenario
from .topics import find

__all__ = [
    "Arrivals",
    "Bag",
    "Bearing",
    "BearingConfig",
    "BearingEstimator",
    "BodyVelocity",
    "Detections",
    "HydrophoneInfo",
    "Imu",
    "LocalizerConfig",
    "MooringConfig",
    "NodePositions",
    "Odometry",
    "Point",
    "Position",
    "Pressure",
    "Samples",
    "Scalar",
    "SlamConfig",
    "SlamEstimator",
    "SonarNet",
    "SonarNoise",
    "SourceBearing",
    "SourceLocalizer",
    "ToaConfig",
    "ToaTracker",
    "Tracks",
    "buoy_net",
    "configured",
    "locate_target",
    "mooring_filter",
    "mooring_step",
    "process",
    "read",
    "score",
    "simulate",
    "sonar_bound",
]


def read(bag: Path | str | Bag, topic: str, kind: type | None = None) -> list[Any]:
    """The messages of a topic as core types, in the order of their log times.

    `kind` is one of the types above; for the package's own topic names it is known.

    Raises:
        ValueError: there is no such bag or topic, its kind is not known, or a message cannot be decoded.
    """
    opened = bag if isinstance(bag, Bag) else Bag(Path(bag))
    if topic not in opened.topics:
        raise ValueError(f"bag {opened.path} has no topic {topic}, it has {', '.join(sorted(opened.topics)) or 'none'}")
    row = find(topic)
    kind = kind or (row[0].kind if row else None)
    if kind is None:
        raise ValueError(f"topic {topic} is not one of the package's: give the kind of its messages")
    return [decoded(kind, record) for record in opened.records([topic])]


def simulate(scenario: Path | str, out: Path | str) -> Path:
    """Writes the measurements and the truth of a scenario file into a new bag, without DDS; returns the bag.

    Raises:
        ValueError: the scenario is wrong, or the bag exists.
    """
    _simulate(load_scenario(Path(scenario)), Path(out), lambda t_ns: None)
    return Path(out)


def process(bag: Path | str, graph: Path | str, out: Path | str, keep_inputs: bool = True) -> dict[str, int]:
    """Runs a graph file's estimators on a bag into a new one, without DDS; returns counts of messages per topic.

    Raises:
        ValueError: graph or bag is wrong, or the bag has none of the topics that the graph needs.
    """
    run = OfflineRun(Bag(Path(bag)), load_graph(Path(graph)), lambda node, refusal: None)
    return run.run(Path(out), keep_inputs, lambda t_ns: None)


def score(bag: Path | str) -> Mapping[str, Any]:
    """Errors of a bag's estimates against the truth in it: the sections of `uwloc score --json`.

    Raises:
        ValueError: there is no bag.
    """
    return _score(load(Path(bag)))
