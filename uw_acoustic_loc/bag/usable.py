"""What of a bag the estimators can use: their inputs by name, and topics of the right kind under other names."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..config import build, parameters
from ..contract import Input, Stage
from ..stages.catalog import STAGES, stage_class
from ..wire.codec import codec
from .rosbags_messages import deserialize
from .survey import Survey

_ANY = "ANY"  # stands for every id in the topics of a stage


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
    listed: list[Use] = []
    made: dict[tuple[str, str], str] = {}  # namespace and topic -> the estimator whose output it is
    for name in STAGES:  # in the order of the data flow
        stage = _stage(name)
        spaces = sorted({space for wanted in stage.inputs for space in _spaces(wanted, found)})
        for space in spaces or ["/"]:
            use = _use(name, space, stage.inputs, kinds, made)
            listed += [use] if use.inputs or use.remap else []
            if use.ready:
                made |= {(space, output.topic): name for output in stage.outputs}
    return listed


class _Kinds:
    """Which topic holds messages of which core type: the first message tells."""

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
            value = form.decode(deserialize(record.data, form.msgtype), record.t_ns)
        except ValueError as error:
            return str(error)
        frame = getattr(value, "frame_id", "")
        if wanted.frame and frame.split("/")[-1] != wanted.frame:
            return f"header.frame_id must be '{wanted.frame}', got '{frame}'"
        return ""

    def others(self, wanted: Input) -> list[str]:
        """Topics that could be this input, and that no estimator or simulator has a name for."""
        return [topic for topic in self.found.topics if not _NAMED.search(topic) and not self.refusal(topic, wanted)]


def _use(name: str, space: str, inputs: Sequence[Input], kinds: _Kinds, made: Mapping[tuple[str, str], str]) -> Use:
    use = Use(name, space, {})
    for wanted in inputs:
        own = wanted.topic.replace(_ANY, "<id>")
        for topic in kinds.found.topics:
            if _fits(topic, space, wanted):
                if why := kinds.refusal(topic, wanted):
                    use.unusable[topic] = why
                else:
                    use.inputs.setdefault(own, []).append(topic)
        if own not in use.inputs and (space, wanted.topic) in made:
            use.after[own] = made[space, wanted.topic]
        elif own not in use.inputs:
            use.missing.append(own)
            use.remap.extend(f"{other}:={space.rstrip('/')}/{own}" for other in kinds.others(wanted))
    return use


def _stage(name: str) -> Stage:
    """An estimator with its default parameters, for any id."""
    cls = stage_class(name)
    fields = parameters(cls.Config)
    ids: dict[str, Any] = {key: [_ANY] for key in ("source_ids", "mooring_ids") if key in fields}
    if "mooring_receivers" in fields:
        del ids["mooring_ids"]  # a mooring's own tracker looks for those; here they are an extra
    bands = {"band_low": [1e3], "band_high": [2e3]} if "band_low" in fields else {}
    config: Any = build(cls.Config, ids | bands, name)
    return cls(config)  # type: ignore[call-arg]


def _pattern(wanted: Input) -> str:
    return re.escape(wanted.topic).replace(_ANY, "[^/]+")


def _fits(topic: str, space: str, wanted: Input) -> bool:
    return re.fullmatch(rf"{re.escape(space.rstrip('/'))}/{_pattern(wanted)}", topic) is not None


def _spaces(wanted: Input, found: Survey) -> set[str]:
    """Namespaces in which the bag has a topic of this name."""
    matches = (re.fullmatch(rf"(?!/truth/)((?:/[^/]+)*)/{_pattern(wanted)}", topic) for topic in found.topics)
    return {match[1] or "/" for match in matches if match and not _ESTIMATED.search(match[1])}


# whose odometry is an estimate, and no vehicle's own
_ESTIMATED = re.compile(r"/(slam|target|mooring/[^/]+)$")
# names with a meaning of their own: never a candidate for another input
_NAMED = re.compile(
    r"^/truth/|/(hydrophones/\w+|sources/[^/]+/\w+|slam/.+|buoys/\w+|target/\w+|sonar/\w+|mooring/[^/]+/\w+|odometry"
    r"|imu/data|dvl/twist)$"
)
