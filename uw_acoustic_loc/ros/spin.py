"""The main() of every process: signals set a flag, the loop ends, everything is torn down in order."""

from __future__ import annotations

import gc
import os
import re
import signal
import sys
from collections.abc import Callable
from typing import Protocol

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

try:  # a quarter of the processor time per message; older rclpy 7.1 does not have it
    from rclpy.experimental import EventsExecutor
except ImportError:
    EventsExecutor = SingleThreadedExecutor

LAUNCHER = "UWLOC_LAUNCHER"  # environment: process id of the launcher that a node must not outlive


class Stop(Exception):
    """Ends the process from within: exit code, and one sentence for stderr."""

    def __init__(self, code: int, sentence: str = "") -> None:
        super().__init__(sentence)
        self.code = code


def one_line(error: Exception) -> str:
    """An error of rclpy's without its places in C code."""
    return re.sub(r", at /\S+?:\d+", "", " ".join(str(error).split()))


class Program(Protocol):
    """What runs in a process: a node, work between its callbacks, and an orderly end."""

    @property
    def node(self) -> Node: ...

    def idle(self) -> float:
        """Called after every wake-up; returns how long the next wait may be, in s."""

    def close(self) -> None: ...


def run(make_program: Callable[[], Program], args: list[str]) -> int:
    """Spins a program until SIGINT, SIGTERM, Stop, or the death of its launcher; returns the exit code."""
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda signum, _frame: signals.append(signum))
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # rclpy's, of several kinds: it has had nothing but the arguments
        print(f"{args[0]}: {one_line(error)}", file=sys.stderr)
        return 1
    try:
        _spin(make_program(), signals)
    except Stop as stop:
        if str(stop):
            print(stop, file=sys.stderr)
        return stop.code
    finally:
        rclpy.try_shutdown()
    return 0


def _spin(program: Program, signals: list[int]) -> None:
    executor = EventsExecutor()
    executor.add_node(program.node)
    gc.freeze()  # what stays for ever; to look through it takes 70 ms each time
    try:
        while not signals and not _orphaned():
            executor.spin_once(timeout_sec=program.idle())
    except ExternalShutdownException:
        pass
    finally:
        program.close()
        executor.shutdown()
        program.node.destroy_node()


def _orphaned() -> bool:
    launcher = os.environ.get(LAUNCHER)
    return launcher is not None and os.getppid() != int(launcher)
