"""Finds the package's data (msg_defs, config, bags): in the checkout, or under share/ of the install prefix."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def resource(name: str) -> Path:
    """Returns the path of the file or folder `name`, for example ``msg_defs/Track.msg`` or ``config/harbour``.

    Raises:
        FileNotFoundError: the installation is incomplete.
    """
    for parent in _PACKAGE.parents:  # <checkout>/, or <prefix>/ above lib/python3.x/site-packages/
        for place in (parent / name, parent / "share" / _PACKAGE.name / name):
            if (parent == _PACKAGE.parent or "share" in place.parts) and place.exists():
                return place
    raise FileNotFoundError(f"{name} of {_PACKAGE.name} is not installed (looked above {_PACKAGE})")
