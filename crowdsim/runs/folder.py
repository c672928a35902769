"""The folder of a run: whether its run is finished, interrupted or another one, and what it was made from."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from textwrap import dedent
from typing import Literal

from crowdsim.errors import OutputError, TakeError
from crowdsim.files import exists_plain, is_folder, read_plain, remove_plain, write_plain
from crowdsim.runs.checkpoint import NAME as CHECKPOINT
from crowdsim.runs.lock import EXTENDING, LOCKS, hold_folder
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import RUN, STAGES, read_manifest
from crowdsim.runs.provenance import Origin, document_difference, scenario_difference
from crowdsim.runs.stage import TAKE, read_note

RESOLVED = "scenario.resolved.yaml"
_LONGEST = 1 << 24
"""Longest resolved scenario that is read [bytes]."""
_OF_OUTPUTS = {"fps", "cameras", "outputs"}
"""Keys of a resolved scenario that change no take."""
_CHOICES = "--force replaces it, --out names another folder"
_OTHERS = "expected an empty folder or a run's; --out names another"


Held = Literal["nothing", "take", "run"]
"""What a folder holds of a run that is asked for.

``nothing``, or the run unfinished; the ``take`` of a finished run, from which it goes on: longer, or with other
outputs; or the ``run``, finished.
"""


def check_folder(
    folder: Path, resolved: str, force: bool, more: tuple[float, bool] | None = None, origin: Origin | None = None
) -> Held:
    """Return what a folder holds of the run of a resolved scenario; nothing is written.

    Args:
        folder: The run folder.
        resolved: The resolved scenario, as text.
        force: Whether what a run has left there may go.
        more: What a finished run is to be extended by, see ``runner.run_to``; its duration does not matter then.
        origin: What the run is made from, where this process holds the folder.

    Raises:
        OutputError: The path is a file, cannot be written, holds something that is no run, another run (the message
            then shows how they differ), or one that is going on; or there is no finished run that could be extended.
    """
    if more is not None and not folder.is_dir():
        raise OutputError(f"{folder}: no such folder, expected a finished run to extend")
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
            return _check_finished(folder, resolved, force, more)
        if more is not None:
            raise OutputError(f"{folder}: holds no finished run to extend")
        begun = read_note(folder / RUN)
        if begun is None and any(name not in STAGES for name in held):
            raise OutputError(f"{folder}: holds {held[0]!r}, which is no run's; {_OTHERS}")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read: {error.strerror or error}") from None
    if not begun or force:
        return "nothing"
    if origin is None:
        # It may be unfinished because it is still going.
        with hold_folder(folder):
            pass
    before = read_resolved(folder / RUN)
    if before and before != resolved:
        raise other_run(folder, "an unfinished run of another scenario", scenario_difference(before, resolved))
    if origin is not None and exists_plain(folder / RUN, CHECKPOINT):
        made_from = begun.get("origin")
        difference = document_difference(made_from if isinstance(made_from, dict) else {}, origin.document())
        if difference:
            what = "an unfinished run that cannot be continued, since something has changed"
            raise other_run(folder, what, difference)
    return "nothing"


def _check_finished(folder: Path, resolved: str, force: bool, more: tuple[float, bool] | None) -> Held:
    try:
        document = read_manifest(folder)
    except TakeError as error:
        raise OutputError(f"{error}; {_OTHERS}") from None
    if force:
        return "nothing"
    before = read_resolved(folder)
    old, now = _parts(before), _parts(resolved)
    if more is not None:
        if _is_extended(folder, more, document.get("control_frames", 0)):
            return "run"
        ended = document.get("outcome")
        if ended is not None:
            what = f"has come to the end of its scenario, {str(ended.get('kind', '')).replace('_', ' ')}"
            raise OutputError(f"{folder}: {what}; it cannot be extended")
        now["duration"] = old.get("duration", "")
    if document.get("status") == "done":
        if old == now:
            return "run" if more is None else "take"
        if more is None and _have_same_take(old, now):
            return "take"
    raise other_run(folder, "another run", scenario_difference(before, "".join(now.values())))


def _have_same_take(old: Mapping[str, str], now: Mapping[str, str]) -> bool:
    """Whether two resolved scenarios differ only in what changes no take, and needs nothing that was not measured."""
    if any(old.get(key) != now.get(key) for key in (old.keys() | now.keys()) - _OF_OUTPUTS):
        return False
    before, after = (_parts(dedent(parts.get("outputs", "").partition("\n")[2])) for parts in (old, now))
    return before.get("take") == after.get("take") and ("profile" in before or "profile" not in after)


def note_extension(folder: Path, more: tuple[float, bool], frames: int) -> None:
    """Note by what a run is extended, and to how many control frames.

    Until the command has reported its end, the same command does not extend the run again.

    Raises:
        OutputError: It cannot be written.
    """
    write_plain(folder, EXTENDING, json.dumps([*more, frames]))


def _is_extended(folder: Path, more: tuple[float, bool], frames: int) -> bool:
    """Whether a run has been extended by this to its number of control frames, and that has not been reported."""
    try:
        return read_plain(folder, EXTENDING, 1 << 10) == json.dumps([*more, frames]).encode()
    except OSError:
        return False


def forget_extension(folder: Path) -> None:
    """Forget what a run was extended by, since its end has been reported; the next extension is another one."""
    with suppress(OSError):
        remove_plain(folder, [EXTENDING])


def other_run(folder: Path, what: str, difference: list[str]) -> OutputError:
    """Return the error of a folder that holds another run, with the lines in which that one differs."""
    return OutputError("\n".join([f"{folder}: holds {what}; {_CHOICES}", *difference]))


def read_resolved(folder: Path) -> str:
    """Return the resolved scenario of a run; nothing where it cannot be read."""
    try:
        return read_plain(folder, RESOLVED, _LONGEST).decode("utf-8")
    except (OSError, ValueError):
        return ""


def _parts(resolved: str) -> dict[str, str]:
    """Return the lines of a resolved scenario, or of one of its mappings, by its top keys."""
    found: dict[str, list[str]] = {}
    key = ""
    for line in resolved.splitlines(keepends=True):
        if line[0] not in " -\n":
            key = line.partition(":")[0]
        found.setdefault(key, []).append(line)
    return {key: "".join(lines) for key, lines in found.items()}


def place_of(folder: Path) -> Path:
    """Return where the take of a run is: in its folder, or in that in which an unfinished run is written."""
    unfinished = folder / RUN
    return unfinished if not is_folder(folder, TAKE) and read_note(unfinished) is not None else folder
