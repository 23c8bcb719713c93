"""What of a bag the estimators can use: their inputs by name, and topics of the right kind under other names."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..contract import ANY_ID, Input
from ..graph import GraphNode
from ..resolved_graph import ResolvedStage, resolve_stage, upstream_first
from ..stages.catalog import STAGES, stage_class, stage_names
from ..topics import KnownTopic, find
from ..wire.codec import codec
from .definitions import decoded
from .survey import Survey


@dataclass(frozen=True)
class Use:
    """One estimator in one namespace. `remap` has `from:=to` pairs, the bag's name and the estimator's."""

    estimator: str
    namespace: str
    inputs: dict[str, list[str]]  # the stage's own name of each input -> topics of the bag
    after: dict[str, str] = field(default_factory=dict)  # inputs that another estimator makes of this bag
    missing: list[str] = field(default_factory=list)
    remap: list[str] = field(default_factory=list)
    unusable: dict[str, str] = field(default_factory=dict)  # topics of the right name, and why they cannot be used

    @property
    def ready(self) -> bool:
        """Whether everything that it needs is there, or made of it, under its own name."""
        return not self.missing and not self.unusable

    def as_json(self) -> dict[str, Any]:
        """As a dictionary, with the verdict."""
        return {**dataclasses.asdict(self), "ready": self.ready}


def uses(found: Survey) -> list[Use]:
    """The estimators of which the bag has an input, by name or by kind."""
    kinds = _Kinds(found)
    stages, listed = _stages()
    made: dict[tuple[str, str], str] = {}  # namespace and topic -> the estimator whose output it is
    for stage in upstream_first(stages):
        name, inputs = stage.node.executable, [*stage.inputs.values()]
        spaces = sorted({space for i in inputs for topic in found.topics if (space := _space(i, topic))})
        for space in spaces or ["/"]:
            use = _use(name, space, inputs, kinds, made)
            listed += [use] if use.inputs or use.remap else []
            if use.ready:
                made |= {(space, output.topic): name for output in stage.outputs.values()}
    names = stage_names()
    return sorted(listed, key=lambda use: names.index(use.estimator))


def _stages() -> tuple[list[ResolvedStage], list[Use]]:
    """All estimators with their default parameters, for any id; and those of other packages that have none."""
    stages: list[ResolvedStage] = []
    failed: list[Use] = []
    for name in stage_names():
        try:
            node = GraphNode(name, name.rpartition("/")[2], "/", None, {}, stage_class(name).any_id)
            stages.append(resolve_stage(node))
        except Exception as error:
            if name in STAGES and not isinstance(error, ValueError):
                raise
            words = str(error) if isinstance(error, ValueError) else f"{type(error).__name__} {error}"
            failed.append(Use(name, "/", {}, unusable={"with default parameters": words}))
    return stages, failed


class _Kinds:
    """Which topic holds messages of which core type, by its first message."""

    def __init__(self, found: Survey) -> None:
        self.found = found

    def refusal(self, topic: str, wanted: Input) -> str:
        """Why a topic cannot be this input; empty when it can."""
        form, record = codec(wanted.kind), self.found.first.get(topic)
        if self.found.topics[topic].msgtype != form.msgtype:
            return f"type must be {form.msgtype}, got {self.found.topics[topic].msgtype}"
        if record is None:
            return "it has no messages"
        try:
            value = decoded(wanted.kind, record)
        except ValueError as error:
            return str(error)
        frame = getattr(value, "frame_id", "")
        if wanted.frame and frame.split("/")[-1] != wanted.frame:
            return f"header.frame_id must be '{wanted.frame}', got '{frame}'"
        return ""

    def others(self, wanted: Input) -> list[str]:
        """Topics that could be this input, and that no estimator or simulator has a name for."""
        return [topic for topic in self.found.topics if not _named(topic) and not self.refusal(topic, wanted)]


def _use(name: str, space: str, inputs: Sequence[Input], kinds: _Kinds, made: Mapping[tuple[str, str], str]) -> Use:
    use = Use(name, space, {})
    for wanted in inputs:
        own = _general(wanted)
        for topic in kinds.found.topics:
            if _space(wanted, topic) == space:
                if why := kinds.refusal(topic, wanted):
                    use.unusable[topic] = why
                else:
                    use.inputs.setdefault(own, []).append(topic)
        if own not in use.inputs and (space, wanted.topic) in made:
            use.after[own] = made[space, wanted.topic]
        elif own not in use.inputs and not wanted.optional:
            use.missing.append(own)
            use.remap.extend(f"{other}:={space.rstrip('/')}/{own}" for other in kinds.others(wanted))
    return use


def _named(topic: str) -> bool:
    """Whether a name has a meaning of its own: then it is never a candidate for another input."""
    return topic.startswith("/truth/") or find(topic) is not None


def _space(wanted: Input, topic: str) -> str | None:
    """The namespace in which a topic has the name of an input; None when the name is another's."""
    own = KnownTopic(_general(wanted), wanted.kind)
    row = find(topic)
    place = own.place(topic) if row is None or row[0].name == own.name else None
    return (place.space or "/") if place else None


def _general(wanted: Input) -> str:
    """The input's name for any id."""
    return wanted.topic.replace(ANY_ID, "<id>")
