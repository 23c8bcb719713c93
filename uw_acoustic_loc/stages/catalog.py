"""Which class each estimator executable runs: the package's own, and those that other packages bring.

Another package names its stages in the entry point group `uw_acoustic_loc.stages`; its `bearing = module:Class` is the
executable `package/bearing`, as ROS 2 writes it. A class is imported only when it is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import cast

from ..contract import Stage

GROUP = "uw_acoustic_loc.stages"
STAGES = {  # in the order of the data flow
    name: EntryPoint(name, f"{__package__}.{name}:{cls}", GROUP)
    for name, cls in {
        "bearing": "BearingStage",
        "bearing_localizer": "BearingLocalizerStage",
        "bearing_slam": "BearingSlamStage",
        "toa_tracker": "ToaTrackerStage",
        "multistatic_fusion": "MultistaticFusionStage",
        "mooring_tracker": "MooringTrackerStage",
    }.items()
}


@cache
def other_stages() -> Mapping[str, EntryPoint]:
    """Those of other packages that are installed, by `package/name`."""
    found = entry_points(group=GROUP)
    return {f"{entry.dist.name.replace('-', '_')}/{entry.name}": entry for entry in found if entry.dist}


def stage_names() -> list[str]:
    """All estimator executables that can run here."""
    return [*STAGES, *other_stages()]


def is_stage(executable: str) -> bool:
    """Whether an executable is an estimator that can run here."""
    return executable in STAGES or ("/" in executable and executable in other_stages())


def stage_class(executable: str) -> type[Stage]:
    """The class of an estimator executable.

    Raises:
        ValueError: another package's class cannot be imported, or is no stage.
    """
    entry = STAGES.get(executable) or other_stages()[executable]
    try:
        found = entry.load()
    except Exception as error:  # whatever another package's code fails with
        raise ValueError(f"stage {executable}: {entry.value} cannot be imported ({error})") from error
    missing = [name for name in _PARTS if not hasattr(found, name)] + sorted(getattr(found, "__abstractmethods__", ()))
    if missing:
        raise ValueError(f"stage {executable}: {entry.value} must be a contract.Stage, it has no {', '.join(missing)}")
    if not is_dataclass(found.Config):
        raise ValueError(f"stage {executable}: Config of {entry.value} must be a dataclass, got {found.Config!r}")
    return cast("type[Stage]", found)


_PARTS = ("Config", "any_id", "inputs", "outputs", "status", "check", "change")
