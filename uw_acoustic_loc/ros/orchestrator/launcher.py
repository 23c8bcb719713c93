"""The orchestrator: starts a graph's nodes, waits until all are connected, drives /clock, stops all in order."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from ...contract import Status
from ...graph import Graph, GraphNode
from ...resolved_graph import ResolvedDriver, ResolvedNode, resolve_node, upstream_first
from ...sim.catalog import SOURCES
from ...stages.catalog import is_stage
from ..diagnostics import Diagnostics
from ..qos import check_overrides
from ..report import Deliveries, Reports
from ..sync import SyncClient
from .command_line import RECORDER, command_line, is_ours, parameters, recorder_node
from .pacing import ClockPacing, Pacing, PlayerPacing, RealTimePacing, Stuck
from .processes import USER_ERROR, Log, Processes, Restart, ended_how
from .readiness import Readiness
from .shared_memory import SharedMemory
from .stopping import OrderedStop, StopOrder
from .window import ordered_nodes, window_s


@dataclass(frozen=True)
class LaunchOptions:
    """How a graph is run. Times in s; `duration` 0 = until SIGINT or SIGTERM."""

    bag: Path | None = None  # to be recorded
    bag_is_vital: bool = False  # without a recorder the run fails; otherwise it goes on, and so does the bag
    duration: float = 0.0
    player: GraphNode | None = None  # started with the graph's own nodes, and gives them /clock
    progress: Callable[[float], None] | None = None  # gets simulated seconds since the start


class Launcher:
    """Checks the whole graph before anything is started.

    Raises:
        ValueError: one sentence for an unknown executable, a bad parameter, a missing file.
    """

    def __init__(self, graph: Graph, options: LaunchOptions, log: Log) -> None:
        self._graph, self._options, self._log = graph, options, log
        if options.bag and options.bag.exists():
            raise ValueError(f"bag {options.bag} exists already: choose another name or remove it")
        wirings = [resolve_node(node) for node in graph.nodes]
        self._wirings = upstream_first(wirings)
        for resolved in wirings:
            _check_overrides(resolved)
        self._sim_time = graph.clock_rate > 0 or options.player is not None
        self._recorder = recorder_node(options.bag, self._wirings, not options.bag_is_vital) if options.bag else None
        everything = [*(ResolvedNode(node) for node in (self._recorder, options.player) if node), *wirings]
        self._folder = TemporaryDirectory(prefix="uwloc_")  # of parameter files, which a restart reads again
        self._commands = {
            resolved.node.full_name: command_line(
                resolved.node, graph.path, parameters(resolved, self._sim_time, Path(self._folder.name))
            )
            for resolved in everything
        }
        names = {resolved.node.full_name: resolved.node.executable for resolved in everything}
        ours = [name for name, executable in names.items() if is_ours(executable) and executable != "player"]
        self._processes = Processes(ours, log)
        self._player = options.player.full_name if options.player else ""
        self._stopped = False
        self._deliveries = Deliveries()
        self.reports: Reports = {}  # of the nodes at the end of their input

    def run(self) -> int:
        """Runs the graph to its end; returns the exit code: 0 when no node failed and nothing was lost."""
        memory = SharedMemory()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        rclpy.init(args=["launcher"], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(f"uwloc_launcher_{os.getpid()}")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        try:
            for name, command in self._commands.items():
                self._processes.start(name, command, self._restart(name))
            return self._go()
        finally:
            self._processes.stop_all()  # what an error left running
            self._executor.shutdown()
            self._node.destroy_node()
            rclpy.try_shutdown()
            memory.clean()
            self._folder.cleanup()

    def _go(self) -> int:
        self._sync = SyncClient(self._node, self._executor, [*self._processes.ours, *filter(None, [self._player])])
        self._pacing = self._make_pacing()
        if not self._player:
            Diagnostics(self._node, self._status)
        readiness = Readiness(self._sync, self._processes, self._processes.ours, self._log)
        if not readiness.wait(self._is_stopped, self._player):
            return 0 if self._stopped else 1
        self._log("launcher", f"{len(self._commands)} nodes are ready")
        code = self._drive()
        return max(code, self._stop_in_order())

    def _make_pacing(self) -> Pacing:
        if self._player:
            return PlayerPacing(self._sync, self._player)
        if not self._sim_time:
            return RealTimePacing(self._sync, self._processes, self._log)
        return ClockPacing(
            self._node,
            self._sync,
            self._processes,
            self._deliveries,
            self._log,
            start_ns=_start_ns(self._wirings),
            rate=self._graph.clock_rate,
            window_s=window_s(self._wirings),
            duration=self._options.duration,
            ordered=ordered_nodes(self._wirings),
            stopped=self._is_stopped,
        )

    def _drive(self) -> int:
        """Lets the time go on and watches the nodes until the end."""
        self._pacing.begin()
        while not self._stopped:
            try:
                now = self._pacing.advance()
            except Stuck as stuck:
                self._log("launcher", f"{stuck}: stopping")
                return 1
            if self._options.progress:
                self._options.progress(now)
            if (ended := self._watch()) is not None:
                return ended
            if self._options.duration and now >= self._options.duration:
                break
            self._executor.spin_once(timeout_sec=0.0)
            self._pacing.rest()
        return 0

    def _watch(self) -> int | None:
        """The exit code when the run is over because a node ended for good."""
        for name, code in self._processes.watch().items():
            if code == 0 and name == self._player:
                return 0
            if code == USER_ERROR:
                self._log("launcher", f"{name} has given up: stopping")
                return 1
            if code:
                self._log("launcher", f"{name} {ended_how(code)}: stopping")
                return 1
            self._log("launcher", f"{name} has ended: stopping")
            return 0
        return None

    def _stop_in_order(self) -> int:
        order = StopOrder(
            drivers=[n.full_name for n in self._graph.nodes if n.executable in SOURCES],
            estimators=[w.node.full_name for w in self._wirings if is_stage(w.node.executable)],
            recorder=[self._recorder.full_name] if self._recorder else [],
        )
        stop = OrderedStop(self._sync, self._processes, self._deliveries, order, self._log)
        lost = stop.drain(finish_drivers=not self._sim_time)  # a clock that stands still has ended them already
        self.reports = stop.reports
        return max(lost, stop.end())

    def _restart(self, name: str) -> Restart:
        if name != RECORDER:
            return Restart.AFTER_A_CRASH
        return Restart.NEVER if self._options.bag_is_vital else Restart.AFTER_ANY_FAILURE

    def _status(self) -> Status:
        """For diagnostics: what does not run, or has not all the time."""
        failures, restarts = self._processes.failures(), self._processes.restarts()
        values = {f"{name} restarts": count for name, count in restarts.items()}
        if failures:
            return Status(Status.ERROR, "; ".join(failures), values)
        if restarts:
            return Status(Status.WARN, f"started again: {', '.join(restarts)}", values)
        return self._pacing.status()

    def _is_stopped(self) -> bool:
        return self._stopped

    def _on_signal(self, _number: int, _frame: Any) -> None:
        self._stopped = True


def _check_overrides(resolved: ResolvedNode) -> None:
    """Of a node of this package: what it publishes and subscribes to is known."""
    if is_ours(resolved.node.executable):
        own = [resolved.node.resolve("markers"), "/diagnostics", "/clock", "/tf", "/parameter_events", "/rosout"]
        topics = {*resolved.inputs, *resolved.outputs, *own}
        check_overrides(resolved.node.params, topics, f"node {resolved.node.full_name}")


def _start_ns(wirings: Sequence[ResolvedNode]) -> int:
    starts = {wiring.scenario.start_ns for wiring in wirings if isinstance(wiring, ResolvedDriver)}
    return min(starts) if starts else time.time_ns()
