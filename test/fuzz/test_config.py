"""The config builder makes a config or raises ValueError with one sentence, whatever it is given."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from uw_acoustic_loc.config import build, parameters
from uw_acoustic_loc.graph import GraphFile
from uw_acoustic_loc.sim.scenario import Scenario
from uw_acoustic_loc.stages.catalog import STAGES, stage_class
from uw_acoustic_loc.stages.runner import RunnerConfig

CLASSES = {name: stage_class(name).Config for name in STAGES}
OTHERS = {"graph": GraphFile, "scenario": Scenario, "runner": RunnerConfig}

SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.sampled_from(["a", "ekf", "port", ""])
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=4), inner, max_size=3)),
    max_leaves=6,
)
FEW = st.sampled_from([0, 1, 2, 0.0, 0.5, 1.0, -1.0, 1e-9, 1e9, math.nan, math.inf, ["a"], [1.0], [1.0, 2.0, 3.0], []])


def content(cls: Any) -> st.SearchStrategy[Any]:
    """Mappings with mostly known keys and mostly plausible values."""
    keys = st.one_of(st.sampled_from(list(parameters(cls))), st.text(max_size=4))
    return st.one_of(st.dictionaries(keys, st.one_of(FEW, VALUES), max_size=6), VALUES)


def finite(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple):
        return all(map(finite, value))
    return not dataclasses.is_dataclass(value) or all(finite(getattr(value, f.name)) for f in dataclasses.fields(value))


@pytest.mark.parametrize("name", [*CLASSES, *OTHERS])
@given(data=st.data())
def test_a_config_or_a_sentence(name: str, data: st.DataObject) -> None:
    cls = CLASSES.get(name) or OTHERS[name]
    values = data.draw(content(cls))
    required = {"source_ids": ["a"]} if name in ("bearing_localizer", "bearing_slam") else {}
    if isinstance(values, dict):
        values = required | values
    try:
        config = build(cls, values, "here")
        if name in CLASSES:
            stage_class(name)(config)  # what several values do together
    except ValueError as error:
        assert str(error)
        assert "\n" not in str(error)
        return
    assert finite(config)
