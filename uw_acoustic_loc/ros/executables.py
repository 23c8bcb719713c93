"""The node executables of `ros2 run uw_acoustic_loc <name>`."""

from __future__ import annotations

import sys
import traceback
from pathlib import Path

from ..sim.catalog import SOURCES
from ..stages.catalog import STAGES
from .driver import DriverNode
from .node import StageNode
from .player import PlayerNode
from .recorder import RecorderNode
from .spin import Program, run

BUG = 70  # EX_SOFTWARE of sysexits.h
EXECUTABLES = (*SOURCES, *STAGES, "recorder", "player")


def main(arguments: list[str]) -> int:
    """Runs the executable named first; the rest goes to rclpy."""
    if not arguments or arguments[0] not in EXECUTABLES:
        print(f"usage: uw_acoustic_loc.ros {{{'|'.join(EXECUTABLES)}}} [--ros-args ...]", file=sys.stderr)
        return 2
    executable, *rest = arguments
    try:
        return run(lambda: _program(executable), [executable, *rest])
    except Exception:  # a bug: its traceback, and an exit code that is not the user's error
        traceback.print_exc()
        return BUG


def script() -> int:
    """Entry point of the installed scripts: the script's own name is the executable."""
    return main([Path(sys.argv[0]).name, *sys.argv[1:]])


def _program(executable: str) -> Program:
    if executable in SOURCES:
        return DriverNode(executable)
    if executable == "recorder":
        return RecorderNode(executable)
    if executable == "player":
        return PlayerNode(executable)
    return StageNode(executable)
