"""Parts of the resolved scenario of a run, which was written by ``scenario.dump_scenario``, or by a stranger."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from crowdsim.runs.folder import read_resolved

_LONGEST = 4096
"""Longest part that is read [characters]: a whole scenario of a stranger may take minutes."""


def resolved_value(folder: Path, key: str) -> Any:
    """Return what the resolved scenario of a run says at one of its top keys.

    Raises:
        ValueError: It says nothing there, or nothing that can be read.
    """
    found = re.search(rf"^{key}:.*\n(?:[ -].*\n)*", read_resolved(folder), re.MULTILINE)
    if found is None or len(found[0]) > _LONGEST:
        raise ValueError(f"has no {key!r}")
    try:
        return yaml.safe_load(found[0])[key]
    except (yaml.YAMLError, RecursionError, KeyError, TypeError) as error:
        raise ValueError(f"{key!r} cannot be read: {error}") from None
