"""A params-file for the bearing node: what the graph gives it, with what was calibrated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import yaml


def params_text(node: str, params: Mapping[str, Any], calibrated: Mapping[str, Any], comments: Iterable[str]) -> str:
    """The file's content for the node of that full name; a graph may name it as the node's `params` as it is."""
    content = {node: {"ros__parameters": {**params, **calibrated}}}
    head = "".join(f"# {line}\n" for line in comments)
    return head + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)
