"""Whether the receivers still agree with a track: judged by receiver and by time, whoever of them is in one message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from ..types import AnyArray
from .paths import Epoch


class ReceiverRecord(NamedTuple):
    """The last messages of one receiver and path."""

    rejected: int  # in a row
    since_ns: int  # the first of them
    last_ns: int
    interval_ns: int  # between the last two messages


@dataclass(frozen=True)
class Agreement:
    """Records by receiver and path; of a receiver as a whole (path 0) where arrivals come without a path."""

    records: Mapping[int, ReceiverRecord] = field(default_factory=dict)

    def after(self, epoch: Epoch, used: Epoch, accepted: AnyArray) -> Agreement:
        """With one more epoch, of whose arrivals those of `used` have a path and a verdict, `accepted` (n,)."""
        if used is epoch:
            verdicts = dict(zip((4 * epoch.receiver + epoch.path).tolist(), accepted.tolist(), strict=True))
        else:
            agreeing = set(used.receiver[accepted].tolist())
            verdicts = {4 * receiver: receiver in agreeing for receiver in epoch.receivers}
        return Agreement({**self.records, **{key: self._record(key, epoch.t_ns, ok) for key, ok in verdicts.items()}})

    def lost(self, times: int) -> bool:
        """Whether half of what is heard has been rejected that many `times` in a row.

        What has been silent since the rejections began, and is overdue, is no evidence for the track.
        """
        rejecting = [r for r in self.records.values() if r.rejected >= times]
        if not rejecting:
            return False
        since = min(r.since_ns for r in rejecting)
        now = max(r.last_ns for r in self.records.values())
        heard = [r for r in self.records.values() if r.last_ns >= since or now - r.last_ns <= 2 * r.interval_ns]
        return 2 * len(rejecting) >= len(heard)

    def contested(self, t_ns: int, times: int) -> bool:
        """Whether one has now been rejected `times` in a row, or twice, four times... as often."""
        now = [r.rejected / times for r in self.records.values() if r.last_ns == t_ns and r.rejected >= times]
        return any(ratio.is_integer() and int(ratio).bit_count() == 1 for ratio in now)

    def _record(self, key: int, t_ns: int, accepted: bool) -> ReceiverRecord:
        before = self.records.get(key)
        rejected = 0 if accepted else 1 + (before.rejected if before else 0)
        since_ns = before.since_ns if before and rejected > 1 else t_ns
        return ReceiverRecord(rejected, since_ns, t_ns, t_ns - before.last_ns if before else 0)


def last_rounds(epochs: tuple[Epoch, ...], rounds: int) -> tuple[Epoch, ...]:
    """The latest epochs that make up so many `rounds`: in one round no receiver reports twice."""
    seen: set[int] = set()
    count, kept = 1, 0
    for epoch in reversed(epochs[-_MOST * rounds :]):
        receivers = epoch.receivers
        if not seen.isdisjoint(receivers):
            count, seen = count + 1, set()
        if count > rounds:
            break
        seen |= receivers
        kept += 1
    return epochs[-kept:]


def has_rounds(epochs: tuple[Epoch, ...], rounds: int) -> bool:
    """Whether the epochs are at least so many rounds."""
    return len(epochs) > len(last_rounds(epochs, rounds - 1)) if rounds > 1 else bool(epochs)


_MOST = 20  # epochs of a round
