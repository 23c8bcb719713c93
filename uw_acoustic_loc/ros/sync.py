"""Asks nodes, over their `~/sync` services, what they have taken and sent."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.client import Client
from rclpy.executors import Executor
from rclpy.node import Node
from std_srvs.srv import SetBool

from ..contract import Status


class SyncClient:
    """Calls `~/sync` of several nodes at once; used by whoever waits for them."""

    def __init__(self, node: Node, executor: Executor, names: list[str]) -> None:
        self._executor = executor
        self._clients = {name: node.create_client(SetBool, f"{name}/sync") for name in names}

    def waiting_for(self) -> list[str]:
        """Nodes whose service has not been discovered."""
        return [name for name, client in self._clients.items() if not client.service_is_ready()]

    def ask(self, names: list[str], finish: bool, timeout_s: float) -> dict[str, dict[str, Any]]:
        """Reports of the nodes that answered within the limit, by name."""
        clients = {name: self._clients[name] for name in names}
        answers = call(clients, SetBool.Request(data=finish), self._executor, timeout_s)
        return {name: json.loads(answer.message) for name, answer in answers.items()}

    def until(
        self, names: list[str], good: Callable[[dict[str, dict[str, Any]]], list[str]], timeout_s: float
    ) -> list[str]:
        """Asks again and again until `good` finds nothing wrong; returns what was still wrong at the limit."""
        limit = time.monotonic() + timeout_s
        while True:
            silent = [name for name in names if not self._clients[name].service_is_ready()]
            wrong = [f"{name} does not answer" for name in silent]
            if not silent:
                reports = self.ask(names, finish=False, timeout_s=max(0.1, limit - time.monotonic()))
                wrong = [f"{name} does not answer" for name in names if name not in reports] or good(reports)
            if not wrong or time.monotonic() > limit:
                return wrong
            self._executor.spin_once(timeout_sec=0.005)


def call(clients: Mapping[str, Client], request: Any, executor: Executor, timeout_s: float) -> dict[str, Any]:
    """Calls a service of several nodes at once; the answers that came within the limit.

    Who is silent is asked again: a node that has not discovered the client yet neither gets its request nor says so.
    """
    futures: dict[str, list[Any]] = {name: [] for name in clients}
    answers: dict[str, Any] = {}
    limit, again = time.monotonic() + timeout_s, 0.0
    while len(answers) < len(clients) and (now := time.monotonic()) < limit:
        silent = [name for name in clients if name not in answers]
        if now >= again:
            again = now + _AGAIN_S
            for name in silent:
                futures[name].append(clients[name].call_async(request))
        executor.spin_once(timeout_sec=0.05)
        answers.update((name, f.result()) for name in silent for f in futures[name] if f.done())
    for name, asked in futures.items():
        for future in asked:
            clients[name].remove_pending_request(future)
    return answers


class PlayerWatch:
    """How far a player has come, and whether it still lives: it answers between any two windows of messages."""

    def __init__(self, node: Node, executor: Executor, name: str) -> None:
        self._client, self._name = SyncClient(node, executor, [name]), name
        self._asked = self._heard = time.monotonic()
        self.played_s = 0.0

    def look(self) -> str:
        """Asks once in a while; what is wrong, or nothing."""
        now = time.monotonic()
        if now - self._asked > _ASK_S and not self._client.waiting_for():
            answer = self._client.ask([self._name], finish=False, timeout_s=0.2).get(self._name)
            self._asked = time.monotonic()
            if answer is not None:
                self._heard, self.played_s = self._asked, answer["played_s"]
        return f"{self._name} has not answered for {_DEAD_S:g} s" if now - self._heard > _DEAD_S else ""


class BooksWatch:
    """Names who has not taken what was sent to it some seconds ago: it is that far behind, or has lost it."""

    def __init__(self, client: SyncClient) -> None:
        self._client, self._asked = client, time.monotonic()
        self._before: Reports = {}
        self._overdue: dict[tuple[str, str], int] = {}

    def look(self, names: list[str]) -> list[str]:
        """Asks once in a while; sentences on what is overdue and was not the last time."""
        if time.monotonic() - self._asked < _OVERDUE_S:
            return []
        reports, told = self._client.ask(names, finish=False, timeout_s=1.0), self._overdue
        self._overdue = missed(reports, self._before)
        self._before, self._asked = reports, time.monotonic()
        late = {key: count for key, count in self._overdue.items() if count > told.get(key, 0)}
        return [f"{name} has not taken {n} messages on {topic}" for (name, topic), n in late.items()]

    def status(self) -> Status:
        """For diagnostics."""
        values = {f"{name} {topic} late or lost": count for (name, topic), count in self._overdue.items()}
        if not values:
            return Status()
        return Status(Status.WARN, f"{sum(self._overdue.values())} messages are late by seconds, or lost", values)


_AGAIN_S = 1.0
_OVERDUE_S = 5.0
_ASK_S = 0.5
_DEAD_S = 180.0  # it waits a minute for nodes that do not follow, and then says so itself

Reports = Mapping[str, Mapping[str, Any]]
_NONE: Mapping[tuple[str, str], int] = {}


def unmatched(reports: Reports, writers: Mapping[str, int]) -> list[str]:
    """Connections between the reporting nodes (and others that write `writers`) that are not made yet."""
    expected = Counter(writers)
    for report in reports.values():
        expected.update(report["out"].keys())
    readers = Counter(topic for report in reports.values() for topic in report["in"])
    wrong = [
        f"{name} hears {seen['writers']} of {expected[topic]} writers of {topic}"
        for name, report in reports.items()
        for topic, seen in report["in"].items()
        if seen["writers"] < expected[topic]
    ]
    return wrong + [
        f"{name} reaches {out['readers']} of {readers[topic]} readers of {topic}"
        for name, report in reports.items()
        for topic, out in report["out"].items()
        if out["readers"] < readers[topic]
    ]


def outstanding(reports: Reports, sent: Mapping[str, int], lost: Mapping[tuple[str, str], int] = _NONE) -> list[str]:
    """Inputs of the reporting nodes that have not taken all that they, and others (`sent`), have published, but for
    what is known to be `lost` by node and topic.
    """
    return [
        f"{name} took {taken} of {due} on {topic}"
        for (name, topic), (taken, due) in _short(reports, _published(reports, sent)).items()
        if taken + lost.get((name, topic), 0) < due
    ]


def missed(reports: Reports, before: Reports | None = None) -> dict[tuple[str, str], int]:
    """How many messages that the reporting nodes have sent (or had, when they reported `before`) each has not taken,
    by node and topic.
    """
    published = _published(reports if before is None else before, {})
    return {key: due - taken for key, (taken, due) in _short(reports, published).items()}


def _short(reports: Reports, published: Mapping[str, int]) -> dict[tuple[str, str], tuple[int, int]]:
    """What each reporting node has taken, and what was published, by node and topic, where that is more."""
    return {
        (name, topic): (seen["taken"], published[topic])
        for name, report in reports.items()
        for topic, seen in report["in"].items()
        if seen["taken"] < published[topic]
    }


def _published(reports: Reports, sent: Mapping[str, int]) -> Counter[str]:
    expected = Counter(sent)
    for report in reports.values():
        expected.update({topic: out["sent"] for topic, out in report["out"].items()})
    return expected


def behind(reports: Reports, t_ns: int) -> list[str]:
    """Drivers that have not published everything up to an instant of the clock."""
    return [f"{name} is behind the clock" for name, report in reports.items() if report.get("reached_ns", t_ns) < t_ns]
