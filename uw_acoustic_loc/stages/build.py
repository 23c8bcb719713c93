"""From an executable's name and parameters to its stage: for the live node, the offline run and `uwloc info`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..config import build, values_of
from ..config import parameters as parameters_of
from ..contract import Stage
from .catalog import stage_class
from .inputs.settings import PREFIX, InputConfig, input_configs
from .runner import RunnerConfig


@dataclass(frozen=True)
class ConfiguredStage:
    """A stage's class and its checked parameters."""

    cls: type[Stage]
    config: Any  # cls.Config
    runner: RunnerConfig
    inputs: Mapping[str, InputConfig]  # by topic

    def make(self) -> Stage:
        """A new stage."""
        return self.cls(self.config)

    @property
    def settings(self) -> dict[str, Any]:
        """All parameters, defaults included; of inputs what is set."""
        of_inputs = {
            f"{PREFIX}{topic}.{name}": value
            for topic, config in self.inputs.items()
            if config != InputConfig()
            for name, value in values_of(config).items()
        }
        return {**values_of(self.config), **values_of(self.runner), **of_inputs}


def configure(executable: str, parameters: Mapping[str, Any], where: str) -> ConfiguredStage:
    """The stage of an executable with these parameters; it has been made once, so that it can be made.

    Raises:
        ValueError: one sentence naming `where`, the key, the value and what is allowed.
    """
    shared = set(parameters_of(RunnerConfig))
    own = {key: value for key, value in parameters.items() if key not in shared and not key.startswith(PREFIX)}
    try:
        cls = stage_class(executable)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
    if taken := shared & set(parameters_of(cls.Config)):
        raise ValueError(f"{where}: {cls.__name__} must not have a parameter {', '.join(taken)}: every stage has it")
    config: Any = build(cls.Config, own, where)
    runner = build(RunnerConfig, {key: value for key, value in parameters.items() if key in shared}, where)
    try:
        stage = cls(config)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    inputs = input_configs(parameters, stage.inputs, where)
    return ConfiguredStage(cls, config, runner, inputs)
