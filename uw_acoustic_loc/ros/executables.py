"""The node executables of `ros2 run uw_acoustic_loc <name>`; each imports its own alone, so that it is up soon."""
# ruff: noqa: PLC0415

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from ..graph import check_params_file
from ..sim.catalog import SOURCES
from ..stages.catalog import STAGES, is_stage, other_stages
from .spin import Program, run

BUG = 70  # EX_SOFTWARE of sysexits.h
EXECUTABLES = (*SOURCES, *STAGES, "recorder", "player")


def main(arguments: list[str]) -> int:
    """Runs the executable named first; the rest goes to rclpy."""
    if not arguments or not (arguments[0] in EXECUTABLES or is_stage(arguments[0])):
        print(
            f"usage: uw_acoustic_loc.ros {{{'|'.join([*EXECUTABLES, *other_stages()])}}} [--ros-args ...]",
            file=sys.stderr,
        )
        return 2
    executable, *rest = arguments
    try:
        _check_params_files(rest)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    try:
        return run(lambda: _program(executable), [executable, *rest])
    except Exception:  # a bug: its traceback, and an exit code that is not the user's error
        traceback.print_exc()
        return BUG


def script() -> int:
    """Entry point of the installed scripts, of other packages' stages too: the script's own name is the executable.

    That of another package is `package/name`; its ROS 2 installation says which, by lib/<package>/<name>.
    """
    path = Path(sys.argv[0])
    others = [name for name in other_stages() if name.endswith(f"/{path.name}")]
    known = (
        name for name in (f"{path.parent.name}/{path.name}", path.name, *others) if name in (*EXECUTABLES, *others)
    )
    return main([next(known, path.name), *sys.argv[1:]])


def _check_params_files(arguments: Sequence[str]) -> None:
    """Refuses with the sentence of the offline programs what rcl would refuse with one of its own."""
    for option, value in pairwise(arguments):
        if option == "--params-file":
            check_params_file(Path(value))


def _program(executable: str) -> Program:
    if executable in SOURCES:
        from .driver import DriverNode

        return DriverNode(executable)
    if executable == "recorder":
        from .recorder import RecorderNode

        return RecorderNode(executable)
    if executable == "player":
        from .player import PlayerNode

        return PlayerNode(executable)
    from .node import StageNode

    return StageNode(executable)
