"""Checks of a take on disk before it is read."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path

from crowdsim.errors import TakeError
from crowdsim.files import kind_of
from crowdsim.scenario.names import NAME, NAME_RULE, avatar_name_fault
from crowdsim.take.take import Cast


def check_names(folder: Path, cast: Cast) -> None:
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
