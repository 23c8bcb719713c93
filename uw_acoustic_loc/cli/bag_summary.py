"""A bag's contents, its faults and its uses, for a terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ..bag.reader import Bag
from ..bag.survey import Survey, TopicSurvey
from ..bag.usable import Use


def as_json(bag: Bag, found: Survey, estimators: Sequence[Use]) -> dict[str, Any]:
    """Returns everything as a JSON object."""
    first, last = found.span
    return {
        "path": str(bag.path),
        "files": [str(file) for file in bag.files],
        "start_ns": first,
        "end_ns": last,
        "duration_s": (last - first) * 1e-9,
        "messages": sum(topic.count for topic in found.topics.values()),
        "topics": {name: topic.as_json() for name, topic in found.topics.items()},
        "not_read": {name: topic.encoding for name, topic in bag.refused.items()},
        "damage": bag.damage,
        "metadata": bag.metadata,
        "estimators": [use.as_json() for use in estimators],
    }


def parts(bag: Bag, found: Survey, estimators: Sequence[Use]) -> Iterator[RenderableType]:
    """Yields everything for a terminal."""
    first, last = found.span
    count = sum(topic.count for topic in found.topics.values())
    yield Text(f"{bag.path}: {count} messages in {len(bag.files)} file(s)", style="bold")
    if count:
        yield Text(f"from {_instant(first)} to {_instant(last)}, {(last - first) * 1e-9:.3f} s\n")
    yield _table(found.topics)
    for name, topic in found.topics.items():
        if sentence := "; ".join(_oddities(topic)):
            yield Text(f"{name}: {sentence}")
    for name, refused in bag.refused.items():
        yield Text(f"{name}: encoded as '{refused.encoding}', not cdr: it can be copied and hashed, not decoded")
    for name, record in bag.metadata.items():
        short = ", ".join(f"{key} {_shortened(' '.join(value.split()))}" for key, value in record.items())
        yield Text(f"metadata {name}: {short}")
    yield Text("")
    for use in estimators:
        yield Text(_sentence(use))


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _table(topics: dict[str, TopicSurvey]) -> Table:
    drawn = Table("topic", "type", "count", "Hz", "latched", box=None, padding=(0, 2, 0, 0), header_style="dim")
    for column in drawn.columns[2:4]:
        column.justify = "right"
    for name, topic in topics.items():
        rate = f"{topic.rate_hz:.4g}" if topic.rate_hz else ""
        drawn.add_row(Text(name), Text(topic.msgtype), str(topic.count), rate, "yes" if topic.latched else "")
    return drawn


def _oddities(topic: TopicSurvey) -> Iterator[str]:
    if topic.gaps:
        yield f"{topic.gaps} gap(s), the longest {topic.longest_gap_s:.3g} s"
    if topic.clock_back:
        yield f"the recorder's clock went back {topic.clock_back} time(s)"
    if topic.stamps_back:
        yield f"stamps go back {topic.stamps_back} time(s)"
    if topic.clock_back or topic.stamps_back:
        yield f"by up to {topic.largest_step_back_s:.3g} s"
    if topic.unset_stamps:
        yield f"{topic.unset_stamps} message(s) without a stamp"
    if topic.unset_log_times:
        yield f"{topic.unset_log_times} message(s) of log time 0, left out of the bag's span"
    if topic.other_types:
        yield f"messages of other types, too: {', '.join(topic.other_types)}"


def _sentence(use: Use) -> str:
    if use.ready:
        names = sorted(topic for topics in use.inputs.values() for topic in topics)
        others = "".join(f", and {own} from {other}" for own, other in use.after.items())
        return f"{use.estimator} in {use.namespace} has all its inputs: {', '.join(names)}{others}"
    parts = [f"{topic}: {why}" for topic, why in use.unusable.items()]
    parts += [f"{own} is missing" for own in use.missing]
    hints = [f"perhaps --remap {pair}" for pair in use.remap]
    return f"{use.estimator} in {use.namespace} cannot run as it is: {'; '.join(parts + hints)}"


def _instant(t_ns: int) -> str:
    try:
        return datetime.fromtimestamp(t_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] + " UTC"
    except (ValueError, OverflowError, OSError):
        return f"{t_ns} ns"


_LONGEST = 60  # characters of a metadata entry; --json has all
