"""The contract between the layers: what an estimator stage is, and what a simulated sensor is.

Both are free of ROS, files and threads. The `ros` and `bag` layers drive them; that is why a live graph and an offline
run give the same numbers.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

Emission = tuple[str, Any]  # topic, core value
Event = tuple[int, str, Any]  # t_ns at which the value is available, topic, core value


@dataclass(frozen=True)
class Input:
    """A subscribed topic. The handler gets the core type and yields emissions, in stamp order over all inputs."""

    topic: str
    kind: type
    handle: Callable[[Any], Iterable[Emission]]
    frame: str = ""  # the frame the header must name; a prefix such as `auv1/` is allowed; "" = any
    latched: bool = False  # streams wait for it
    rewind: float = 0.0  # s; messages that are late by up to this are handled all the same, when they come
    optional: bool = False  # the stage does without
    upstream: int = 0  # estimators that it comes through, each of which waits for inputs of its own
    until_ns: Callable[[Any], int] | None = None  # its turn among the inputs, if a value reaches beyond its stamp
    merge: Callable[[Any, Any], Any] | None = None  # of a latched message and the next one, where neither says all


@dataclass(frozen=True)
class Output:
    """A published topic."""

    topic: str
    kind: type
    latched: bool = False


@dataclass(frozen=True)
class Status:
    """What diagnostics shows of a stage: level, one sentence, and numbers by name."""

    OK: ClassVar[int] = 0
    WARN: ClassVar[int] = 1
    ERROR: ClassVar[int] = 2
    level: int = 0
    message: str = "running"
    values: Mapping[str, float | int | str] = field(default_factory=dict)


class Stage(Protocol):
    """An estimator, built from its config alone; a new run of the clock builds a new one.

    A class that derives from this one writes a constructor, `Config`, `inputs` and `outputs`, and of the rest what it
    needs. A handler raises ValueError (one sentence) for a message that it cannot use; the message is then counted as
    rejected, and nothing of it is kept.
    """

    Config: ClassVar[type]  # a frozen dataclass of the parameters, see uw_acoustic_loc.config
    any_id: ClassVar[Mapping[str, Any]] = {}  # parameters with which its topics have ANY_ID for every source or mooring

    @abstractmethod
    def __init__(self, config: Any) -> None:
        """ValueError (one sentence) for a config that cannot be, of which no field is out of its range."""

    @property
    @abstractmethod
    def inputs(self) -> tuple[Input, ...]:
        """The subscribed topics; they depend on the config alone."""

    @property
    @abstractmethod
    def outputs(self) -> tuple[Output, ...]:
        """The published topics; they depend on the config alone."""

    def status(self) -> Status:
        """What diagnostics shows."""
        return Status()

    def check(self, config: Any) -> None:
        """ValueError for a changed config that what has been heard so far rules out."""

    def change(self, config: Any) -> None:
        """Takes over a config in which only changeable fields differ."""
        raise NotImplementedError(f"{type(self).__name__} has changeable parameters, it must have `change` too")


ANY_ID = "ANY"


class Source(Protocol):
    """A simulated sensor: `events` yields everything from the scenario's start to its end, latched values first.

    The same scenario gives the same events, bit for bit, each time `events` is called.
    """

    @property
    def outputs(self) -> tuple[Output, ...]: ...

    def events(self) -> Iterator[Event]: ...
