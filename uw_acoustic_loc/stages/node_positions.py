"""Where the nodes of a net are, put together from messages that hold all of them or some."""

from __future__ import annotations

import numpy as np

from ..core.types import Array, NodePositions

_ROLES = (NodePositions.RECEIVER, NodePositions.TRANSMITTER, NodePositions.REMOVED)


def merged(known: NodePositions | None, news: NodePositions) -> NodePositions:
    """The nodes `known` so far with what a message says of some: new ones, moved ones, and removed ones, which go.

    Raises:
        ValueError: a node is there twice or has an unknown role or a position that is not finite.
    """
    _check(news)
    rows = {} if known is None else _rows(known)
    for (name, role), position in _rows(news).items():
        if role == NodePositions.REMOVED:
            rows = {key: row for key, row in rows.items() if key[0] != name}
        else:
            rows[name, role] = position
    ids, roles = [name for name, _ in rows], [role for _, role in rows]
    x, y, z = np.array([*rows.values()], dtype=float).reshape(-1, 3).T
    return NodePositions(
        news.t_ns, np.array(ids, np.uint16), np.array(roles, np.uint8), x, y, z, frame_id=news.frame_id
    )


def of_role(nodes: NodePositions, role: int) -> tuple[list[int], Array]:
    """Ids and positions (M, 3) of the nodes of one role."""
    chosen = np.asarray(nodes.role) == role
    return np.asarray(nodes.id)[chosen].tolist(), nodes.positions[chosen]


def _rows(nodes: NodePositions) -> dict[tuple[int, int], Array]:
    keys = zip(np.asarray(nodes.id).tolist(), np.asarray(nodes.role).tolist(), strict=True)
    return dict(zip(keys, nodes.positions, strict=True))


def _check(nodes: NodePositions) -> None:
    ids, roles = np.asarray(nodes.id).tolist(), np.asarray(nodes.role).tolist()
    if unknown := sorted(set(roles) - set(_ROLES)):
        raise ValueError(f"role must be 0 (receiver), 1 (transmitter) or 2 (removed), got {unknown[0]}")
    if len(set(zip(ids, roles, strict=True))) < len(ids):
        raise ValueError(f"a message must hold each node once, with different ids, got {ids}")
    here = nodes.positions[np.asarray(roles) != NodePositions.REMOVED]
    if not np.isfinite(here).all():
        raise ValueError(f"positions must be finite, got {here.tolist()}")
