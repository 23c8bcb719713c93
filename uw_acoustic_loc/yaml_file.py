"""Reads YAML files: graphs, parameters, scenarios, expectations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

YAML_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's where there is one, which is ten times as fast


def load_yaml(path: Path, what: str) -> Any:
    """Returns the content of a YAML file; ValueError with one sentence when it cannot be read."""
    try:
        return yaml.load(path.read_text(), YAML_LOADER)
    except OSError as error:
        raise ValueError(f"{what} {path} cannot be read: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{what} {path} is not valid YAML: {' '.join(str(error).split())}") from None
