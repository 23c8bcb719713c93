"""What makes the time of a run go on: a clock of our own, a player's, or real time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from ...contract import Status
from ..rclpy_messages import clock_message
from ..report import Deliveries, Missing, Reports, behind, missing, published
from ..sync import SyncClient
from .processes import Log, Processes

_SHORTEST_S = 0.01  # of a window: with no lateness at all no clock can keep an order
_TICK_S = 0.02  # real time between two /clock messages
_LOOK_S = 0.1  # between two looks at the processes where there is no /clock
_CATCH_UP_S = 2.0
_ALL_EVERY = 8  # windows between two checks of the nodes that have a single input, and so no order to lose
_DELIVERY_S = 5.0
_OVERDUE_S = 5.0
_ASK_S = 0.5
_DEAD_S = 180.0  # a player waits a minute for nodes that do not follow, and then says so itself


class Stuck(Exception):
    """The run cannot go on; the message says why."""


class Pacing(Protocol):
    """`advance` returns the seconds since `begin`; `rest` waits until there may be more to do."""

    def begin(self) -> None: ...

    def advance(self) -> float: ...

    def rest(self) -> None: ...

    def status(self) -> Status: ...


class ClockPacing:
    """Publishes /clock at `rate` times real time, and waits after each window of it for the slowest node.

    Drivers have then published everything up to the window's end, and everybody has taken what was sent: inputs of a
    node are never further apart than a window, however slow a node is, so the speed of a run cannot change its result.
    `ordered` are the nodes with an order of inputs to lose, and all upstream of them.
    """

    def __init__(
        self,
        node: Node,
        sync: SyncClient,
        processes: Processes,
        deliveries: Deliveries,
        log: Log,
        *,
        start_ns: int,
        rate: float,
        window_s: float,
        duration: float,
        ordered: set[str],
        stopped: Callable[[], bool],
    ) -> None:
        self._sync, self._processes, self._deliveries, self._log = sync, processes, deliveries, log
        self._publisher = node.create_publisher(Clock, "/clock", 10)
        self._start_ns, self._rate, self._duration = start_ns, rate, duration
        self._window_s = max(window_s, _SHORTEST_S)
        self._ordered, self._stopped = ordered, stopped
        self._begun, self._windows = 0.0, 0

    def begin(self) -> None:
        """The clock starts."""
        self._begun = time.monotonic()

    def advance(self) -> float:
        """One tick, at most to the end of the window."""
        now = (time.monotonic() - self._begun) * self._rate
        end = (self._windows + 1) * self._window_s
        self._tick(min(now, end))
        if now < end:
            return now
        self._windows += 1
        self._wait_for_deliveries(end)
        # a clock that had to wait catches up, but not more than this
        self._begun = max(self._begun, time.monotonic() - (end + _CATCH_UP_S) / self._rate)
        return end

    def rest(self) -> None:
        """Until the next tick, if it is not due."""
        if (time.monotonic() - self._begun) * self._rate < (self._windows + 1) * self._window_s:
            time.sleep(_TICK_S)

    def status(self) -> Status:
        """For diagnostics: what is given up."""
        lost = self._deliveries.lost
        return Status(Status.WARN, f"lost on the way: {'; '.join(lost)}") if lost else Status()

    def _tick(self, now: float) -> None:
        now = min(now, self._duration) if self._duration else now
        self._publisher.publish(clock_message(self._start_ns + round(now * 1e9)))

    def _wait_for_deliveries(self, now: float) -> None:
        t_ns = self._start_ns + round(now * 1e9)
        everybody = self._windows % _ALL_EVERY == 0
        limit, wrong = time.monotonic() + _DELIVERY_S, ["not asked yet"]
        while wrong and time.monotonic() < limit and not self._stopped():  # in short turns: a node may die meanwhile
            names = [name for name in self._processes.steady() if everybody or name in self._ordered]
            wrong = self._sync.until(
                names, lambda reports: behind(reports, t_ns) + self._deliveries.outstanding(reports), timeout_s=0.2
            )
        if wrong and not self._stopped():
            self._deliveries.give_up()
            self._log("launcher", f"the clock did not wait any longer: {'; '.join(wrong)}")


class PlayerPacing:
    """Follows a player, which publishes /clock itself, and answers between any two windows of messages."""

    def __init__(self, sync: SyncClient, player: str) -> None:
        self._sync, self._player = sync, player
        self._asked = self._heard = self._played_s = 0.0

    def begin(self) -> None:
        """From now on it must answer."""
        self._asked = self._heard = time.monotonic()

    def advance(self) -> float:
        """Seconds of the bag that have been played, asked for once in a while.

        Raises:
            Stuck: the player has not answered for long.
        """
        now = time.monotonic()
        if now - self._asked > _ASK_S and self._player not in self._sync.waiting_for():
            report = self._sync.ask([self._player], finish=False, timeout_s=0.2).get(self._player)
            self._asked = time.monotonic()
            if report is not None:
                self._heard, self._played_s = self._asked, report.played_s
        if now - self._heard > _DEAD_S:
            raise Stuck(f"{self._player} has not answered for {_DEAD_S:g} s")
        return self._played_s

    def rest(self) -> None:
        """Until it may have gone on."""
        time.sleep(_LOOK_S)

    def status(self) -> Status:
        """For diagnostics."""
        return Status()


class RealTimePacing:
    """Real time; names in the log and in diagnostics who has not taken what was sent to it."""

    def __init__(self, sync: SyncClient, processes: Processes, log: Log) -> None:
        self._processes, self._log = processes, log
        self._overdue = Overdue(sync)
        self._begun = 0.0

    def begin(self) -> None:
        """Time counts from now on."""
        self._begun = time.monotonic()

    def advance(self) -> float:
        """Seconds since the start."""
        if late := self._overdue.look(self._processes.steady()):
            self._log("launcher", "; ".join(late))
        return time.monotonic() - self._begun

    def rest(self) -> None:
        """Until the next look at the processes."""
        time.sleep(_LOOK_S)

    def status(self) -> Status:
        """For diagnostics: what is overdue."""
        return self._overdue.status()


class Overdue:
    """Who has not taken what was sent to it some seconds ago: it is that far behind, or has lost it."""

    def __init__(self, sync: SyncClient) -> None:
        self._sync, self._asked = sync, time.monotonic()
        self._before: Reports = {}
        self._overdue: Missing = {}

    def look(self, names: list[str]) -> list[str]:
        """Asks once in a while; sentences on what is overdue and was not the last time."""
        if time.monotonic() - self._asked < _OVERDUE_S:
            return []
        reports, known = self._sync.ask(names, finish=False, timeout_s=1.0), self._overdue
        self._overdue = missing(reports, published(self._before))
        self._before, self._asked = reports, time.monotonic()
        late = {key: count for key, count in self._overdue.items() if count > known.get(key, 0)}
        return [f"{name} has not taken {n} messages on {topic}" for (name, topic), n in late.items()]

    def status(self) -> Status:
        """For diagnostics."""
        values = {f"{name} {topic} late or lost": count for (name, topic), count in self._overdue.items()}
        if not values:
            return Status()
        return Status(Status.WARN, f"{sum(self._overdue.values())} messages are late by seconds, or lost", values)
