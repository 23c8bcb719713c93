"""Acoustic localization for AUVs: bearings, positions and tracks from sound, as ROS 2 nodes and on recorded bags.

`import uw_acoustic_loc as ua` offers the names of `uw_acoustic_loc.api`, which is imported when one is first used:
estimators on numpy arrays, bags and scores, without ROS. docs/api.md shows them.
"""

from importlib import import_module
from typing import Any

from .version import __version__ as __version__


def __getattr__(name: str) -> Any:
    if not name.startswith("_"):
        api = import_module(".api", __name__)
        if name in api.__all__:
            return getattr(api, name)
    raise AttributeError(f"module 'uw_acoustic_loc' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*globals(), *import_module(".api", __name__).__all__])
