"""One operating system process per node: started, its log prefixed, restarted when it crashes, stopped in order."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from enum import Enum

from ..spin import LAUNCHER

Log = Callable[[str, str], None]  # who, line

_BACKOFF_S = (0.0, 0.5, 1.0, 2.0, 5.0)  # before another start: of what had run well, and of crashes in a row
_STABLE_S = 10.0  # what has run for so long had not failed to start
_RECENT_S = 10.0  # for diagnostics, which many look at once in a while
_PATIENCE_S = 5.0  # for each of SIGINT, SIGTERM
USER_ERROR = 1  # the exit code of a node that has said in one sentence what is wrong: starting it again cannot help


class Restart(Enum):
    """Which end of a process is followed by another start."""

    NEVER = "never"
    AFTER_A_CRASH = "after a crash"
    AFTER_ANY_FAILURE = "after any failure"  # a user's error too: a full disk may be emptied


_FINAL = {Restart.AFTER_A_CRASH: (0, USER_ERROR), Restart.AFTER_ANY_FAILURE: (0,)}


class Processes:
    """The processes of a graph by their nodes' full names; those of `ours` answer `~/sync`."""

    def __init__(self, ours: list[str], log: Log) -> None:
        self.ours, self._log = ours, log
        self._processes: dict[str, NodeProcess] = {}

    @property
    def names(self) -> list[str]:
        """In the order of their start."""
        return list(self._processes)

    def start(self, name: str, command: list[str], restart: Restart) -> None:
        """Starts a node."""
        self._processes[name] = NodeProcess(name, command, self._log, restart)

    def ended(self) -> dict[str, int]:
        """Exit codes of those that do not run."""
        codes = {name: process.exit_code() for name, process in self._processes.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def watch(self) -> dict[str, int]:
        """Restarts what has crashed; exit codes of what has ended and stays ended."""
        codes = {name: process.watch() for name, process in self._processes.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def steady(self) -> list[str]:
        """Those of `ours` that have run since the start: the delivery counts of the others are not complete."""
        ended, restarted = self.ended(), self.restarts()
        return [name for name in self.ours if name not in ended and name not in restarted]

    def restarts(self) -> dict[str, int]:
        """How often each that had to be was started again."""
        return {name: process.restarts for name, process in self._processes.items() if process.restarts}

    def failures(self) -> list[str]:
        """Sentences on those that have failed within the last seconds, whether they run again or not."""
        recent = time.monotonic() - _RECENT_S
        return [f"{name} {p.failure}" for name, p in self._processes.items() if p.failed_at > recent]

    def stop(self, name: str) -> int:
        """Stops a node; its exit code."""
        return self._processes[name].stop()

    def stop_all(self) -> None:
        """Stops whatever still runs, in any order."""
        for name in self._processes:
            self.stop(name)


class NodeProcess:
    """A node's process; `log` gets its lines."""

    def __init__(self, name: str, command: list[str], log: Log, restart: Restart) -> None:
        self.name, self._command, self._log, self._restart = name, command, log, restart
        self.restarts, self._in_a_row = 0, -1
        self._restart_at = 0.0
        self.failure, self.failed_at = "", -1e9  # the latest, and when it was noticed
        self._start()

    def _start(self) -> None:
        self._process = subprocess.Popen(
            self._command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
            env=_environment(self._command),
            start_new_session=True,  # Ctrl-C in the terminal reaches the launcher alone, which stops nodes in order
        )
        self._pump = threading.Thread(target=self._read, args=(self._process,), daemon=True)
        self._pump.start()
        self._begun = time.monotonic()

    def _read(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            self._log(self.name, line.rstrip())

    @property
    def pid(self) -> int:
        """Of the process that runs now."""
        return self._process.pid

    def exit_code(self) -> int | None:
        """None while it runs; negative for a signal."""
        return self._process.poll()

    def watch(self) -> int | None:
        """Restarts a failed process after a back-off. Returns the exit code when it ended and stays ended."""
        code = self.exit_code()
        if code is None or self._restart is Restart.NEVER or code in _FINAL[self._restart]:
            return code
        now = time.monotonic()
        if not self._restart_at:
            self._in_a_row = 0 if now - self._begun > _STABLE_S else self._in_a_row + 1
            wait = _BACKOFF_S[min(self._in_a_row, len(_BACKOFF_S) - 1)]
            self.failure, self.failed_at = ended_how(code), now
            self._log(self.name, f"{self.failure}, starting it again in {wait:g} s")
            self._restart_at = now + wait
        elif now >= self._restart_at:
            self.restarts, self._restart_at = self.restarts + 1, 0.0
            self._start()
        return None

    def stop(self) -> int:
        """SIGTERM, then SIGINT, then SIGKILL; returns the exit code.

        A Python process that is not up yet ends on SIGTERM without a word, on SIGINT with a traceback.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            if self._process.poll() is None:
                self._process.send_signal(number)
                try:
                    self._process.wait(_PATIENCE_S)
                except subprocess.TimeoutExpired:
                    self._log(self.name, f"does not stop on {number.name}")
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._pump.join(1.0)
        return self._process.returncode


def ended_how(code: int) -> str:
    """For example `was ended by SIGKILL`."""
    return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"crashed with exit code {code}"


def _environment(command: list[str]) -> dict[str, str]:
    """One thread per node for linear algebra: many small matrices, many nodes on few cores."""
    environment = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1", **os.environ}
    environment[LAUNCHER] = str(os.getpid())
    if command[0] != sys.executable:  # the wheels' start-up guard belongs to this interpreter
        environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    return environment
