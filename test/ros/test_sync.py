"""Who has not taken what was sent to it some time ago is named, once, and stays in the diagnostics until it has."""

import signal
import subprocess
import sys
from typing import Any

import pytest

from test.ros.conftest import LIMIT_S, Bench
from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.ros import sync
from uw_acoustic_loc.ros.sync import BooksWatch, missed, outstanding


def reports(sent: int, taken: int) -> dict[str, Any]:
    return {"/imu": {"out": {"/x": {"sent": sent}}, "in": {}}, "/slam": {"out": {}, "in": {"/x": {"taken": taken}}}}


class Answers:
    """In place of the nodes' services."""

    def __init__(self, *answers: dict[str, Any]) -> None:
        self._answers = list(answers)

    def ask(self, _names: list[str], **_: Any) -> dict[str, Any]:
        return self._answers.pop(0)


def test_what_is_overdue_is_named_and_forgotten_when_it_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sync, "_OVERDUE_S", 0.0)
    watch = BooksWatch(Answers(reports(100, 90), reports(600, 40), reports(700, 40), reports(800, 780)))  # type: ignore[arg-type]
    assert watch.look([]) == [], "nothing was sent before the first look"
    assert watch.look([]) == ["/slam has not taken 60 messages on /x"]
    assert watch.status().level == Status.WARN
    assert watch.status().values == {"/slam /x late or lost": 60}
    assert watch.look([]) == ["/slam has not taken 560 messages on /x"]
    assert watch.look([]) == []
    assert watch.status() == Status()


def test_what_is_known_to_be_lost_is_not_waited_for() -> None:
    lost = missed(reports(100, 90))
    assert lost == {("/slam", "/x"): 10}
    assert outstanding(reports(100, 90), {}) == ["/slam took 90 of 100 on /x"]
    assert outstanding(reports(110, 100), {}, lost) == []
    assert outstanding(reports(111, 100), {}, lost) == ["/slam took 100 of 111 on /x"]


def test_a_question_that_nobody_got_is_asked_again(bench: Bench) -> None:
    name = bench.start("toa_tracker")
    bench.stop(name, signal.SIGKILL)
    assert bench.sync.waiting_for() == [], "DDS believes for 20 s that it is there"
    command = [sys.executable, "-m", "uw_acoustic_loc.ros", "toa_tracker"]
    bench.processes[name] = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert name in bench.sync.ask([name], finish=False, timeout_s=LIMIT_S)
