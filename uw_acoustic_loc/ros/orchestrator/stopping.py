"""The end of a run: drivers first, then estimators down the data flow, the recorder last."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from dataclasses import dataclass

from ..report import Deliveries, Reports
from ..sync import SyncClient
from .processes import Log, Processes

_DRAIN_S = 30.0
_ANSWER_S = 5.0


@dataclass(frozen=True)
class StopOrder:
    """Full names, in the order of the data flow; what is in none of them stops between estimators and recorder."""

    drivers: Sequence[str]
    estimators: Sequence[str]
    recorder: Sequence[str]

    def of(self, names: Sequence[str]) -> list[str]:
        """All of `names` in order."""
        known = (*self.drivers, *self.estimators, *self.recorder)
        others = [name for name in names if name not in known]
        return [*self.drivers, *self.estimators, *others, *self.recorder]


class OrderedStop:
    """Ends each node after it has had all its input, so that nothing that was published is missing downstream."""

    def __init__(
        self, sync: SyncClient, processes: Processes, deliveries: Deliveries, order: StopOrder, log: Log
    ) -> None:
        self._sync, self._processes, self._deliveries, self._order, self._log = sync, processes, deliveries, order, log
        self.reports: Reports = {}  # of the nodes at the end of their input

    def drain(self, finish_drivers: bool) -> int:
        """Ends the input of one node after the other; 1 when something was lost on the way."""
        if finish_drivers:
            self._sync.ask(list(self._order.drivers), finish=True, timeout_s=_ANSWER_S)
        self._wait_for_deliveries()
        for name in self._order.estimators:
            self._sync.ask([name], finish=True, timeout_s=_ANSWER_S)
            self._wait_for_deliveries()
        self.reports = self._sync.ask(self._processes.steady(), finish=False, timeout_s=_ANSWER_S)
        self._deliveries.outstanding(self.reports)
        if self._deliveries.lost:
            self._log("launcher", f"lost on the way: {'; '.join(self._deliveries.lost)}")
        return int(bool(self._deliveries.lost))

    def end(self) -> int:
        """Stops the processes; 1 when one of them failed or had to be restarted."""
        code = 0
        for name in self._order.of(self._processes.names):
            ended = self._processes.stop(name)
            if ended not in (0, -signal.SIGINT, -signal.SIGTERM):
                self._log("launcher", f"{name} ended with exit code {ended}")
                code = 1
        for name, count in self._processes.restarts().items():
            self._log("launcher", f"{name} had to be started again {count} times")
            code = 1
        return code

    def _wait_for_deliveries(self) -> None:
        """Until everything that was published has been taken by whoever subscribed all the time."""
        if self._sync.until(self._processes.steady(), self._deliveries.outstanding, _DRAIN_S):
            self._deliveries.give_up()
