"""Which class each estimator executable runs; imported only when it is asked for."""

from __future__ import annotations

from importlib import import_module

from ..contract import Stage

STAGES = {
    "bearing": ("bearing", "BearingStage"),
    "bearing_localizer": ("bearing_localizer", "BearingLocalizerStage"),
    "bearing_slam": ("bearing_slam", "BearingSlamStage"),
    "toa_tracker": ("toa_tracker", "ToaTrackerStage"),
    "multistatic_fusion": ("multistatic_fusion", "MultistaticFusionStage"),
    "mooring_tracker": ("mooring_tracker", "MooringTrackerStage"),
}


def stage_class(executable: str) -> type[Stage]:
    """The stage class of an estimator executable."""
    module, name = STAGES[executable]
    found: type[Stage] = getattr(import_module(f"{__package__}.{module}"), name)
    return found
