"""How an input's messages come: which clock, which frames, where the sensor sits, which axes. One rule for all inputs.

A node's parameter `inputs.<topic>.<name>` belongs to one input, by the estimator's own name of the topic.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ...config import build, param
from ...contract import Input
from ...core.types import Bearing, BodyVelocity, Imu, Odometry, Point, Position

PREFIX = "inputs."


@dataclass(frozen=True)
class InputConfig:
    """Parameters of one input."""

    stamp_offset: float = param(0.0, unit="s", low=-1e10, high=1e10, doc="added to every stamp: of a clock that is off")
    accept_frames: tuple[str, ...] = param((), doc="frames that stand for the expected one; '' = an empty frame_id")
    translation: tuple[float, ...] = param((), unit="m", length=3, doc="of the sensor in base_link; empty = zero")
    rotation: tuple[float, ...] = param((), unit="rad", length=3, doc="roll, pitch, yaw of the sensor's axes")
    convention: str = param("", choices=("", "enu", "ned"), doc="ned: north, east, down; forward, right, down")

    @property
    def mounted(self) -> bool:
        """Whether values have to be turned or moved."""
        return any(self.translation) or any(self.rotation) or self.convention == "ned"


def input_configs(values: Mapping[str, Any], inputs: Iterable[Input], where: str) -> dict[str, InputConfig]:
    """The config of every input by topic; values that belong to none are left to others.

    Raises:
        ValueError: one sentence with an unknown topic or parameter, or a value that is not allowed.
    """
    kinds = {wanted.topic: wanted.kind for wanted in inputs}
    given: dict[str, dict[str, Any]] = {topic: {} for topic in kinds}
    own_values = [(key, value) for key, value in values.items() if key.startswith(PREFIX)]
    for key, value in own_values:
        topic, _, name = key.removeprefix(PREFIX).rpartition(".")
        if topic not in given:
            raise ValueError(f"{where}: {key} must name one of the inputs {', '.join(kinds)}, got '{topic}'")
        given[topic][name] = value
    configs = {topic: build(InputConfig, own, f"{where}: {PREFIX}{topic}") for topic, own in given.items()}
    for topic, config in configs.items():
        if config.mounted and kinds[topic] not in _PLACED:
            raise ValueError(f"{where}: {PREFIX}{topic}: a {kinds[topic].__name__} can be neither turned nor moved")
    return configs


class Frames:
    """Whether a message is in a frame that an input accepts."""

    def __init__(self, wanted: Input, config: InputConfig) -> None:
        self._wanted, self._accepted = wanted, config.accept_frames
        self._convention = config.convention
        self._first: str | None = None

    def check(self, value: Any) -> None:
        """ValueError for another frame; where any will do, it must stay the same."""
        frame = getattr(value, "frame_id", None)
        if frame is None:
            return
        if self._wanted.frame:
            self._check_named(frame)
        else:
            self._check_constant(frame)
        if not self._convention and (axes := _ned([frame, getattr(value, "child_frame_id", "")])):
            setting = f"{PREFIX}{self._wanted.topic}.convention"
            raise ValueError(f"frame '{axes}' looks like north, east, down: set {setting} to ned or enu")

    def _check_named(self, frame: str) -> None:
        names = (self._wanted.frame, *self._accepted)
        if frame not in names and not any(name and frame.endswith("/" + name) for name in names):
            raise ValueError(
                f"header.frame_id must be '{self._wanted.frame}', got '{frame}': if that is right, set"
                f" {PREFIX}{self._wanted.topic}.accept_frames, and where the sensor sits"
            )

    def _check_constant(self, frame: str) -> None:
        if self._first is None:
            self._first = frame
        if frame != self._first and frame not in self._accepted:
            raise ValueError(f"header.frame_id must stay '{self._first}', got '{frame}'")


def restamped(value: Any, offset_ns: int) -> Any:
    """The value with another stamp."""
    return dataclasses.replace(value, t_ns=value.t_ns + offset_ns) if offset_ns else value


def _ned(frames: Collection[str]) -> str:
    """The first frame whose name says that its axes are not REP-103's."""
    named = (frame for frame in frames if {"ned", "frd"} & set(frame.lower().replace("/", "_").split("_")))
    return next(named, "")


_PLACED = (Imu, BodyVelocity, Odometry, Bearing, Point, Position)
