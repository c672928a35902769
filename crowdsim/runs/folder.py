"""The folder of a run: whether its run is finished, interrupted or another one, and what it was made from."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from crowdsim.errors import OutputError, TakeError
from crowdsim.files import exists_plain, read_plain
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.lock import LOCKS, hold_folder
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import RUN, STAGES, read_manifest
from crowdsim.runs.provenance import Origin, origin_difference, scenario_difference
from crowdsim.runs.stage import TAKE, read_note

if TYPE_CHECKING:
    from crowdsim.scenario.scenario import Scenario

RESOLVED = "scenario.resolved.yaml"
_LONGEST = 1 << 24
"""Longest resolved scenario that is read [bytes]."""
_LONGEST_PART = 1 << 22
"""Longest part of it that is read alone [characters], more than a scenario of the most bytes and values becomes."""
_FAST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_OF_OUTPUTS = re.compile(r"^(?:fps|cameras|outputs):.*\n(?:[ -].*\n)*", re.MULTILINE)
"""Keys of a resolved scenario that change no take."""
_CHOICES = "--force replaces it, --out names another folder"
_OTHERS = "expected an empty folder or a run's; --out names another"


def check_folder(folder: Path, resolved: str, force: bool, locked: bool = False) -> bool:
    """Return whether the run of a resolved scenario is finished in a folder; nothing is written.

    Args:
        folder: The run folder.
        resolved: The resolved scenario, as text.
        force: Whether what a run has left there may go.
        locked: Whether this process holds the folder.

    Raises:
        OutputError: The path is a file, cannot be written, holds something that is no run, another run (the message
            then shows how they differ), or an unfinished run.
    """
    above = folder
    try:
        while not above.exists():
            above = above.parent
        if not above.is_dir():
            where = "is a file, expected a folder for the run"
            raise OutputError(
                f"{folder}: {where}" if above == folder else f"{folder}: cannot be made: {above} is a file"
            )
        held = sorted(path.name for path in folder.iterdir()) if above == folder else []
        held = [name for name in held if name not in LOCKS]
        if not os.access(above, os.W_OK | os.X_OK):
            raise OutputError(f"{folder}: cannot be written, expected a folder with write permission")
        if MANIFEST in held:
            return _check_finished(folder, resolved, force)
        begun = read_note(folder / RUN) is not None
        if not begun and any(name not in STAGES for name in held):
            raise OutputError(f"{folder}: holds {held[0]!r}, which is no run's; {_OTHERS}")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read: {error.strerror or error}") from None
    if begun and not force and not locked:
        # It may be unfinished because it is still going.
        with hold_folder(folder):
            pass
    before = read_resolved(folder / RUN) if begun and not force else ""
    if before and before != resolved:
        raise other_run(folder, "an unfinished run of another scenario", scenario_difference(before, resolved))
    return False


def check_begun(folder: Path, origin: Origin) -> None:
    """Refuse an unfinished run in a folder that was made from something else.

    Raises:
        OutputError: It was.
    """
    note = read_note(folder / RUN)
    begun = exists_plain(folder / RUN, CHECKPOINT) and note is not None
    difference = origin_difference(dict(note.get("origin", {})), origin) if begun and note else []
    if difference:
        raise other_run(folder, "an unfinished run that cannot be continued, since something has changed", difference)


def other_run(folder: Path, what: str, difference: list[str]) -> OutputError:
    """Return the error of a folder that holds another run, with the lines in which that one differs."""
    return OutputError("\n".join([f"{folder}: holds {what}; {_CHOICES}", *difference]))


def _check_finished(folder: Path, resolved: str, force: bool) -> bool:
    try:
        document = read_manifest(folder)
    except TakeError as error:
        raise OutputError(f"{error}; {_OTHERS}") from None
    if force:
        return False
    before = read_resolved(folder)
    if before == resolved and document.get("status") == "done":
        return True
    raise other_run(folder, "another run", scenario_difference(before, resolved))


def read_resolved(folder: Path) -> str:
    """Return the resolved scenario of a run; nothing where it cannot be read."""
    try:
        return read_plain(folder, RESOLVED, _LONGEST).decode("utf-8")
    except (OSError, ValueError):
        return ""


def resolved_value(folder: Path, key: str) -> Any:
    """Return what the resolved scenario of a run, or of a stranger, says at one of its top keys.

    Raises:
        ValueError: It says nothing there, or nothing that can be read.
    """
    found = re.search(rf"^{key}:.*\n(?:[ -].*\n)*", read_resolved(folder), re.MULTILINE)
    if found is None or len(found[0]) > _LONGEST_PART:
        raise ValueError(f"has no {key!r}")
    try:
        return yaml.load(found[0], _FAST)[key]
    except (yaml.YAMLError, RecursionError, KeyError, TypeError) as error:
        raise ValueError(f"{key!r} cannot be read: {error}") from None


def has_same_take(folder: Path, scenario: Scenario, resolved: str) -> bool:
    """Whether a folder holds the finished run of a scenario but for what changes no take: cameras and outputs.

    Args:
        folder: The run folder.
        scenario: The scenario, resolved.
        resolved: It as text.
    """
    try:
        if read_manifest(folder).get("status") != "done":
            return False
        before = read_resolved(folder)
        take = (resolved_value(folder, "outputs") or {}).get("take")
    except (TakeError, ValueError, AttributeError):
        return False
    same = take == scenario.outputs.take.model_dump(mode="json", exclude_none=True)
    return same and before != resolved and _OF_OUTPUTS.sub("", before) == _OF_OUTPUTS.sub("", resolved)


def place_of(folder: Path) -> Path:
    """Return where the take of a run is: in its folder, or in that in which an unfinished run is written."""
    unfinished = folder / RUN
    return unfinished if not (folder / TAKE).exists() and read_note(unfinished) is not None else folder
