"""Fast DDS's files in shared memory: a killed process leaves its own behind, and the orchestrator removes them."""

from __future__ import annotations

import os
import re
from pathlib import Path


class SharedMemory:
    """Fast DDS's files in /dev/shm: a killed process leaves its own behind."""

    _FOLDER = Path("/dev/shm")

    def __init__(self) -> None:
        self._before = self._files()

    def abandoned(self) -> set[str]:
        """What appeared since, is ours, and no process maps any more."""
        left = self._files() - self._before
        mapped = "".join(_text(path) for path in Path("/proc").glob("[0-9]*/maps")) if left else ""
        # a segment's lock and semaphore live as long as the segment does
        return {name for name in left if re.sub(r"^sem\.|_mutex$|_el$", "", name) not in mapped}

    def clean(self) -> None:
        """Removes what is abandoned."""
        for name in self.abandoned():
            (self._FOLDER / name).unlink(missing_ok=True)

    def _files(self) -> set[str]:
        if not self._FOLDER.is_dir():
            return set()
        files = [path for path in self._FOLDER.iterdir() if "fastrtps_" in path.name or "fastdds_" in path.name]
        return {path.name for path in files if _owned(path)}


def _owned(path: Path) -> bool:
    try:
        return path.stat().st_uid == os.getuid()
    except FileNotFoundError:  # gone in the meantime
        return False


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:  # the process has ended, or belongs to someone else
        return ""
