"""The orchestrator: starts a graph's nodes, waits until all are connected, drives /clock, stops all in order."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from ..graph import Graph, GraphNode
from ..resolved_graph import ResolvedDriver, ResolvedNode, resolve_node, upstream_first
from ..sim.catalog import SOURCES
from ..stages.catalog import is_stage
from .command_line import command_line, recorder_node
from .diagnostics import Diagnostics
from .processes import USER_ERROR, NodeProcess, SharedMemory
from .rclpy_messages import clock_message
from .sync import BooksWatch, PlayerWatch, Reports, SyncClient, behind, missed, outstanding, unmatched

_READY_S = 60.0  # a loaded machine takes long to start a dozen interpreters
_DRAIN_S = 30.0
_TICK_S = 0.02  # real time between two /clock messages
_LOOK_S = 0.1  # between two looks at the processes where there is no /clock
_WINDOW_S = 0.25  # of the clock, after which it waits for the slowest node: half of what inputs wait for each other
_CATCH_UP_S = 2.0
_ALL_EVERY = 8  # windows between two checks of the nodes that have a single input, and so no order to lose
_BOOKS_S = 5.0


@dataclass(frozen=True)
class Run:
    """How a graph is run. Times in s; `duration` 0 = until SIGINT or SIGTERM."""

    record: Path | None = None
    duration: float = 0.0
    player: GraphNode | None = None  # started with the graph's own nodes, and gives them /clock
    progress: Callable[[float], None] | None = None  # gets simulated seconds since the start


class Launcher:
    """Checks the whole graph before anything is started.

    Raises:
        ValueError: one sentence for an unknown executable, a bad parameter, a missing file.
    """

    def __init__(self, graph: Graph, run: Run, log: Callable[[str, str], None]) -> None:
        self._graph, self._run, self._log = graph, run, log
        if run.record and run.record.exists():
            raise ValueError(f"bag {run.record} exists already: choose another name or remove it")
        wirings = [resolve_node(node) for node in graph.nodes]
        self._wirings = upstream_first(wirings)
        self._ordered = _ordered(self._wirings)
        self._sim_time = graph.clock_rate > 0 or run.player is not None
        self._start_ns = _start_ns(wirings)
        self._recorder = recorder_node(run.record, self._wirings) if run.record else None
        everything = [node for node in (self._recorder, *graph.nodes, run.player) if node]
        drivers = {w.node.full_name: w for w in wirings if isinstance(w, ResolvedDriver)}
        self._commands = {
            node.full_name: command_line(node, graph.path, self._sim_time, drivers.get(node.full_name))
            for node in everything
        }
        self._ours = [
            n.full_name for n in everything if n.executable in (*SOURCES, "recorder") or is_stage(n.executable)
        ]
        self._processes: dict[str, NodeProcess] = {}
        # its end is the run's
        self._player = next((node.full_name for node in everything if node.executable == "player"), "")
        self._stopped = False
        self._lost: dict[tuple[str, str], int] = {}  # messages by reader and topic, said and not waited for again
        self.books: Reports = {}  # what each node had taken and sent at the end

    def run(self) -> int:
        """Runs the graph to its end; returns the exit code: 0 when no node failed."""
        memory = SharedMemory()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)
        rclpy.init(args=["launcher"], signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(f"uwloc_launcher_{os.getpid()}")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._clock: Any = (
            self._node.create_publisher(Clock, "/clock", 10) if self._sim_time and not self._run.player else None
        )
        try:
            for name, command in self._commands.items():
                self._processes[name] = NodeProcess(name, command, self._log)
            self._sync = SyncClient(self._node, self._executor, self._ours)
            return self._go()
        finally:
            for process in self._processes.values():  # what an error left running
                process.stop()
            self._executor.shutdown()
            self._node.destroy_node()
            rclpy.try_shutdown()
            memory.clean()

    # --- phases ---

    def _go(self) -> int:
        if not self._wait_ready():
            return 0 if self._stopped else 1
        code = self._drive()
        return max(code, self._stop_in_order())

    def _wait_ready(self) -> bool:
        """Every node answers, and every connection between them is made.

        A player makes sure of the same before it plays, and a short bag may be over before that shows here.
        """
        limit = time.monotonic() + _READY_S
        wrong = ["nothing has started"]
        while wrong and not self._stopped:
            wrong = self._sync.until(self._ours, lambda reports: unmatched(reports, {}), timeout_s=0.3)
            codes = {name: process.exit_code() for name, process in self._processes.items()}
            if codes.get(self._player) == 0:
                break
            ended = [f"{name} has ended" for name, code in codes.items() if code is not None]
            if ended or (wrong and time.monotonic() > limit):
                self._log("launcher", f"not ready: {'; '.join(ended or wrong)}")
                return False
        if not self._stopped:
            self._log("launcher", f"{len(self._processes)} nodes are ready")
        return not self._stopped

    def _drive(self) -> int:
        """Advances /clock (if it is ours) and watches the nodes until the end."""
        rate = self._graph.clock_rate if self._clock else 1.0
        begun, checked = time.monotonic(), 0.0
        player = PlayerWatch(self._node, self._executor, self._player) if self._player else None
        books = None if self._sim_time else BooksWatch(self._sync)  # a clock waits for the books
        if books:
            Diagnostics(self._node, books.status)
        while not self._stopped:
            now = (time.monotonic() - begun) * rate
            if self._clock and now >= checked + _WINDOW_S:
                checked = now = checked + _WINDOW_S
                self._tick(now)
                self._wait_for_books(now)
                # a clock that had to wait catches up, but not more than this
                begun = max(begun, time.monotonic() - (now + _CATCH_UP_S) / rate)
            elif self._clock:
                self._tick(now)
            if books and (late := books.look(self._steady())):
                self._log("launcher", "; ".join(late))
            if player and (stuck := player.look()):
                self._log("launcher", f"{stuck}: stopping")
                return 1
            if self._run.progress:
                self._run.progress(player.played_s if player else now)
            if (ended := self._watch()) is not None:
                return ended
            if self._run.duration and now >= self._run.duration:
                break
            self._executor.spin_once(timeout_sec=0.0)
            if not self._clock or (time.monotonic() - begun) * rate < checked + _WINDOW_S:
                time.sleep(_TICK_S if self._clock else _LOOK_S)
        return 0

    def _tick(self, now: float) -> None:
        now = min(now, self._run.duration) if self._run.duration else now
        self._clock.publish(clock_message(self._start_ns + round(now * 1e9)))

    def _wait_for_books(self, now: float) -> None:
        """Until the drivers have published up to `now` and everybody has taken what was sent: inputs of a node are
        never further apart than a window, however slow a node is, so the speed of a run cannot change its result.
        """
        t_ns = self._start_ns + round(now * 1e9)
        everybody = round(now / _WINDOW_S) % _ALL_EVERY == 0
        limit, wrong = time.monotonic() + _BOOKS_S, ["not asked yet"]
        while wrong and time.monotonic() < limit and not self._stopped:  # in short turns: a node may die meanwhile
            names = [name for name in self._steady() if everybody or name in self._ordered]
            wrong = self._sync.until(names, lambda r: behind(r, t_ns) + outstanding(r, {}), timeout_s=0.2)
        if wrong and not self._stopped:
            self._log("launcher", f"the clock did not wait any longer: {'; '.join(wrong)}")

    def _watch(self) -> int | None:
        """The exit code when the run is over because a node ended for good."""
        for name, process in self._processes.items():
            code = process.watch()
            if code == 0 and name == self._player:
                return 0
            if code == USER_ERROR:
                self._log("launcher", f"{name} has given up: stopping")
                return 1
            if code == 0:
                self._log("launcher", f"{name} has ended: stopping")
                return 0
        return None

    def _stop_in_order(self) -> int:
        """Drivers first, then estimators down the data flow, each after it has had all its input; recorder last."""
        code = 0
        drivers = [n.full_name for n in self._graph.nodes if n.executable in SOURCES]
        estimators = [w.node.full_name for w in self._wirings if is_stage(w.node.executable)]
        if not self._sim_time:  # a clock that stands still has ended them already
            self._sync.ask(drivers, finish=True, timeout_s=5.0)
        self._drain()
        for name in estimators:
            self._sync.ask([name], finish=True, timeout_s=5.0)
            self._drain()
        self.books = self._sync.ask(self._steady(), finish=False, timeout_s=5.0)
        others = [name for name in self._processes if name not in (*drivers, *estimators)]
        recorder = [self._recorder.full_name] if self._recorder else []
        for name in (*drivers, *estimators, *[n for n in others if n not in recorder], *recorder):
            ended = self._processes[name].stop()
            if ended not in (0, -signal.SIGINT, -signal.SIGTERM):
                self._log("launcher", f"{name} ended with exit code {ended}")
                code = 1
        restarted = {name: p.restarts for name, p in self._processes.items() if p.restarts}
        for name, count in restarted.items():
            self._log("launcher", f"{name} had to be started again {count} times")
        return 1 if restarted else code

    def _drain(self) -> None:
        """Waits until everything that was published has been taken by whoever subscribed all the time."""
        wrong = self._sync.until(self._steady(), lambda reports: outstanding(reports, {}, self._lost), _DRAIN_S)
        if wrong:
            self._log("launcher", f"lost on the way: {'; '.join(wrong)}")
            self._lost = missed(self._sync.ask(self._steady(), finish=False, timeout_s=5.0))

    def _steady(self) -> list[str]:
        """Nodes that have run since the start: the books of the others are not complete."""
        return [n for n in self._ours if self._processes[n].exit_code() is None and not self._processes[n].restarts]

    def _on_signal(self, _number: int, _frame: Any) -> None:
        self._stopped = True


def _ordered(wirings: Sequence[ResolvedNode]) -> set[str]:
    """Nodes with several streams to put in order, and all that are upstream of them."""
    found = [w for w in wirings if sum(not wanted.latched for wanted in w.inputs.values()) > 1]
    while upstream := [w for w in wirings if w not in found and any(set(w.outputs) & set(f.inputs) for f in found)]:
        found += upstream
    return {wiring.node.full_name for wiring in found}


def _start_ns(wirings: Sequence[ResolvedNode]) -> int:
    starts = {wiring.scenario.start_ns for wiring in wirings if isinstance(wiring, ResolvedDriver)}
    return min(starts) if starts else time.time_ns()
