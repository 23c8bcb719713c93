"""How far apart the inputs of a node may be for its results not to depend on who was faster."""

from __future__ import annotations

from collections.abc import Sequence

from ...resolved_graph import ResolvedNode, ResolvedStage

_LONGEST_S = 0.25  # of a window: progress and diagnostics stay smooth
_PART = 0.5  # of the lateness: the other half is for what the stamps of a chain lie apart


def window_s(wirings: Sequence[ResolvedNode]) -> float:
    """Seconds of the clock that may pass before everybody has taken what was sent.

    A sequencer lets nobody wait longer than its `lateness`: inputs that are closer together than the smallest of the
    graph come into their order, whoever is delivered first. 0 where some lateness is 0: message by message.
    """
    latenesses = [w.lateness for w in wirings if isinstance(w, ResolvedStage) and _streams(w) > 1]
    return min(_LONGEST_S, _PART * min(latenesses, default=_LONGEST_S / _PART))


def ordered_nodes(wirings: Sequence[ResolvedNode]) -> set[str]:
    """Nodes with several streams to put in order, and all that are upstream of them."""
    found = [w for w in wirings if _streams(w) > 1]
    while upstream := [w for w in wirings if w not in found and any(set(w.outputs) & set(f.inputs) for f in found)]:
        found += upstream
    return {wiring.node.full_name for wiring in found}


def _streams(wiring: ResolvedNode) -> int:
    return sum(not wanted.latched for wanted in wiring.inputs.values())
