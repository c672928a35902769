"""What a take on disk holds, read and checked."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.errors import TakeError
from crowdsim.files import kind_of
from crowdsim.scenario.names import NAME, NAME_RULE, avatar_name_fault
from crowdsim.take.layout import CAST, EVENTS
from crowdsim.take.take import VARIABLES, Cast, Events, Take


def read_group(folder: Path, group: Any, attributes: dict[str, Any]) -> Take:
    """Return what an open group holds.

    Raises:
        TakeError: Its names are none that a scenario could have.
        KeyError: Something is missing; other values give ``ValueError`` or ``OSError``.
    """
    values: dict[str, Any] = {field: np.asarray(group[name][...]) for name, field in CAST.items()}
    colours = [[np.nan if c is None else c for c in row] for row in attributes["type_colours"]]
    cast = Cast(
        **values,
        type_names=tuple(attributes["type_names"]),
        team_names=tuple(attributes["team_names"]),
        policy_names=tuple(attributes["policy_names"]),
        colours=np.array(colours, float).reshape(-1, 3),
    )
    _check_names(folder, cast)
    events = Events(**{name: np.asarray(group["events"][name][...]) for name in EVENTS})
    frames = group["action"].shape[0]
    return Take(
        **{name: group[name] for name in VARIABLES},
        cast=cast,
        targets=group["target"] if "target" in group else np.zeros((frames, 0, 3), np.float32),
        target_names=tuple(attributes["target_names"]),
        events=events,
        control_rate=float(attributes["control_rate"]),
        scenario=str(attributes["scenario"]),
        seed=int(attributes["seed"]),
        fingerprints=tuple(attributes["policy_fingerprints"]),
        status=str(attributes["status"]),
        # Takes written before this attribute existed have reactions.
        reactions=bool(attributes.get("reactions", True)),
        collision_avoidance=bool(attributes.get("collision_avoidance", True)),
    )


def _check_names(folder: Path, cast: Cast) -> None:
    """Refuse names that a scenario could not have: files are called by avatars, and policies are found by name."""
    fault = avatar_name_fault(list(map(str, cast.names.tolist())))
    if fault:
        raise TakeError(f"{folder}: {fault}")
    for name in cast.policy_names:
        if not re.fullmatch(NAME, str(name)):
            raise TakeError(f"{folder}: a policy is named {name!r}, expected a name of {NAME_RULE}")


def check_files(folder: Path) -> None:
    """Refuse a take that holds anything but files and folders: links lead elsewhere, and reading a pipe never ends."""
    for above, folders, files in os.walk(folder, onerror=_raise):
        for name in (*folders, *files):
            path = os.path.join(above, name)
            mode = os.lstat(path).st_mode
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                raise TakeError(f"{path}: is {kind_of(mode)}, expected a regular file; links are not followed")


def _raise(error: OSError) -> None:
    raise error
