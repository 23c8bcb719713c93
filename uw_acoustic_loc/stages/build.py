"""From an executable's name and parameters to its stage: for the live node, the offline run and `uwloc info`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..config import build, values_of
from ..config import parameters as parameters_of
from ..contract import Stage
from .catalog import stage_class
from .runner import RunnerConfig


@dataclass(frozen=True)
class ConfiguredStage:
    """A stage's class and its checked parameters."""

    cls: type[Stage]
    config: Any  # cls.Config
    runner: RunnerConfig

    def make(self) -> Stage:
        """A new stage."""
        return self.cls(self.config)

    @property
    def settings(self) -> dict[str, Any]:
        """All parameters, defaults included."""
        return {**values_of(self.config), **values_of(self.runner)}


def configure(executable: str, parameters: Mapping[str, Any], where: str) -> ConfiguredStage:
    """The stage of an executable with these parameters; it has been made once, so that it can be made.

    Raises:
        ValueError: one sentence naming `where`, the key, the value and what is allowed.
    """
    shared = set(parameters_of(RunnerConfig))
    own = {key: value for key, value in parameters.items() if key not in shared}
    try:
        cls = stage_class(executable)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    if taken := shared & set(parameters_of(cls.Config)):
        raise ValueError(f"{where}: {cls.__name__} must not have a parameter {', '.join(taken)}: every stage has it")
    config: Any = build(cls.Config, own, where)
    runner = build(RunnerConfig, {key: value for key, value in parameters.items() if key in shared}, where)
    configured = ConfiguredStage(cls, config, runner)
    try:
        _check_topics(configured.make())
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    return configured


def _check_topics(stage: Stage) -> None:
    """Refuses what ROS would: parameters are parts of the names."""
    for name in [*(i.topic for i in stage.inputs), *(o.topic for o in stage.outputs)]:
        if not _TOPIC.fullmatch(name):
            raise ValueError(
                f"topic '{name}', as the parameters make it, must have letters, digits and underscores between"
                " slashes, and no digit after a slash"
            )


_TOPIC = re.compile(r"(~?/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
