"""The estimator node: frames of four hydrophones in, a bearing per ping out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from uw_acoustic_loc.contract import ANY_ID, Emission, Input, Output, Stage
from uw_acoustic_loc.topics import known

from .bearing import FourBearingConfig, FourSamples, bearing_of

BEARING = known("sources/<id>/bearing")


class FourBearingStage(Stage):
    """One bearing for each frame with a ping."""

    Config: ClassVar[type] = FourBearingConfig
    any_id: ClassVar[Mapping[str, Any]] = {"source_id": ANY_ID, "sound_speed": 1500.0}

    def __init__(self, config: FourBearingConfig) -> None:
        self._config = config

    @property
    def inputs(self) -> tuple[Input, ...]:
        return (Input("hydrophones/four", FourSamples, self._on_samples, frame="base_link"),)

    @property
    def outputs(self) -> tuple[Output, ...]:
        return (BEARING.output(self._config.source_id),)

    def change(self, config: FourBearingConfig) -> None:
        self._config = config

    def _on_samples(self, frame: FourSamples) -> Iterator[Emission]:
        if bearing := bearing_of(frame, self._config):
            yield BEARING.named(self._config.source_id), bearing
