"""When a graph is ready: every node answers, and every connection between them is made."""

from __future__ import annotations

import time
from collections.abc import Callable

from ..report import unmatched
from ..sync import SyncClient
from .processes import Log, Processes

_LIMIT_S = 60.0  # a loaded machine takes long to start a dozen interpreters
_ROUND_S = 0.3


class Readiness:
    """Waits for the nodes `names`, which answer `~/sync`; the other processes must only run."""

    def __init__(self, sync: SyncClient, processes: Processes, names: list[str], log: Log) -> None:
        self._sync, self._processes, self._names, self._log = sync, processes, names, log

    def wait(self, stopped: Callable[[], bool], player: str) -> bool:
        """Whether the graph has become ready before the limit, the end of a process or `stopped`.

        A `player` makes sure of the same before it plays, and a short bag may be over before that shows here.
        """
        limit = time.monotonic() + _LIMIT_S
        wrong = ["nothing has started"]
        while wrong and not stopped():
            wrong = self._sync.until(self._names, unmatched, _ROUND_S)
            ended = self._processes.ended()
            if ended.get(player) == 0:
                break
            if ended or (wrong and time.monotonic() > limit):
                sentences = [f"{name} has ended" for name in ended] or wrong
                self._log("launcher", f"not ready: {'; '.join(sentences)}")
                return False
        return not stopped()
