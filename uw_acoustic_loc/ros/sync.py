"""The service `~/sync` (std_srvs/SetBool): a node's report of what it has taken and sent, and whoever asks for it.

Whoever feeds nodes can wait until everything that was sent has been processed: delivery acknowledged by DDS does not
say that a callback has run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.client import Client
from rclpy.executors import Executor
from rclpy.node import Node
from std_srvs.srv import SetBool

from .report import NodeReport

_AGAIN_S = 1.0


class SyncService:
    """Answers with the node's report; data=true first ends the node's input."""

    def __init__(self, node: Node, report: Callable[[], NodeReport], finish: Callable[[], None]) -> None:
        self._report, self._finish = report, finish
        node.create_service(SetBool, "~/sync", self._answer)

    def _answer(self, request: Any, response: Any) -> Any:
        if request.data:
            self._finish()
        response.success = True
        response.message = self._report().to_json()
        return response


class SyncClient:
    """Calls `~/sync` of several nodes at once."""

    def __init__(self, node: Node, executor: Executor, names: list[str]) -> None:
        self._executor = executor
        self._clients = {name: node.create_client(SetBool, f"{name}/sync") for name in names}

    def waiting_for(self) -> list[str]:
        """Nodes whose service has not been discovered."""
        return [name for name, client in self._clients.items() if not client.service_is_ready()]

    def ask(self, names: list[str], finish: bool, timeout_s: float) -> dict[str, NodeReport]:
        """Reports of the nodes that answered within the limit, by name."""
        clients = {name: self._clients[name] for name in names}
        answers = call(clients, SetBool.Request(data=finish), self._executor, timeout_s)
        return {name: NodeReport.from_json(answer.message) for name, answer in answers.items()}

    def until(
        self, names: list[str], wrong_of: Callable[[dict[str, NodeReport]], list[str]], timeout_s: float
    ) -> list[str]:
        """Asks again and again until `wrong_of` finds nothing; returns what was still wrong at the limit."""
        limit = time.monotonic() + timeout_s
        while True:
            silent = [name for name in names if not self._clients[name].service_is_ready()]
            wrong = [f"{name} does not answer" for name in silent]
            if not silent:
                reports = self.ask(names, finish=False, timeout_s=max(0.1, limit - time.monotonic()))
                wrong = [f"{name} does not answer" for name in names if name not in reports] or wrong_of(reports)
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
