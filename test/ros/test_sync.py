"""Who has not taken what was sent to it some time ago is named, once, and stays in the diagnostics until it has."""

import signal
import subprocess
import sys
from typing import Any

import pytest

from test.ros.conftest import LIMIT_S, Bench
from uw_acoustic_loc.contract import Status
from uw_acoustic_loc.ros.orchestrator import pacing
from uw_acoustic_loc.ros.orchestrator.pacing import Overdue
from uw_acoustic_loc.ros.report import Deliveries, NodeReport, Reports, Sent, Taken, unmatched


def reports(sent: int, taken: int) -> Reports:
    return {"/imu": NodeReport(sent={"/x": Sent(sent)}), "/slam": NodeReport(taken={"/x": Taken(taken)})}


class Answers:
    """In place of the nodes' services."""

    def __init__(self, *answers: Reports) -> None:
        self._answers = list(answers)

    def ask(self, _names: list[str], **_: Any) -> Reports:
        return self._answers.pop(0)


def test_what_is_overdue_is_named_and_forgotten_when_it_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pacing, "_OVERDUE_S", 0.0)
    watch = Overdue(Answers(reports(100, 90), reports(600, 40), reports(700, 40), reports(800, 780)))  # type: ignore[arg-type]
    assert watch.look([]) == [], "nothing was sent before the first look"
    assert watch.look([]) == ["/slam has not taken 60 messages on /x"]
    assert watch.status().level == Status.WARN
    assert watch.status().values == {"/slam /x late or lost": 60}
    assert watch.look([]) == ["/slam has not taken 560 messages on /x"]
    assert watch.look([]) == []
    assert watch.status() == Status()


def test_what_is_known_to_be_lost_is_not_waited_for() -> None:
    deliveries = Deliveries()
    assert deliveries.outstanding(reports(100, 90)) == ["/slam took 90 of 100 on /x"]
    deliveries.give_up()
    assert deliveries.lost == ["/slam missed 10 on /x"]
    assert deliveries.outstanding(reports(110, 100)) == []
    assert deliveries.outstanding(reports(111, 100)) == ["/slam took 100 of 111 on /x"]


def test_what_comes_after_all_was_not_lost() -> None:
    deliveries = Deliveries()
    deliveries.outstanding(reports(100, 90))
    deliveries.give_up()
    assert deliveries.outstanding(reports(100, 97)) == []
    assert deliveries.lost == ["/slam missed 3 on /x"]
    assert deliveries.outstanding(reports(110, 105)) == ["/slam took 105 of 110 on /x"]
    assert deliveries.outstanding(reports(110, 110)) == []
    assert deliveries.lost == []


def test_connections_are_known_by_the_names_of_their_nodes() -> None:
    stranger = Sent(0, readers=("/a", "/b", "/c"))
    found: Reports = {"/imu": NodeReport(sent={"/x": stranger}), "/slam": NodeReport(taken={"/x": Taken(0, ("/imu",))})}
    assert unmatched(found) == ["/imu does not reach /slam on /x"]
    assert unmatched({"/slam": found["/slam"]}, {"/x": "/player"}) == ["/slam does not hear /player on /x"]


def test_a_report_survives_its_way_through_a_service() -> None:
    report = NodeReport(
        sent={"/x": Sent(3, ("/b",))}, taken={"/y": Taken(2, ("/c", "/d"))}, counts={"y": {"used": 2}}, reached_ns=7
    )
    assert NodeReport.from_json(report.to_json()) == report


def test_a_question_that_nobody_got_is_asked_again(bench: Bench) -> None:
    name = bench.start("toa_tracker")
    bench.stop(name, signal.SIGKILL)
    assert bench.sync.waiting_for() == [], "DDS believes for 20 s that it is there"
    command = [sys.executable, "-m", "uw_acoustic_loc.ros", "toa_tracker"]
    bench.processes[name] = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert name in bench.sync.ask([name], finish=False, timeout_s=LIMIT_S)
