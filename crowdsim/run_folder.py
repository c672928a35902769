"""The folder of a run: made ready, found finished or unfinished, and cleared, without touching what is no run's."""

from __future__ import annotations

import difflib
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from crowdsim.errors import OutputError, TakeError
from crowdsim.manifest import NAME as MANIFEST
from crowdsim.manifest import read_manifest

RESOLVED = "scenario.resolved.yaml"
TAKE = "take.zarr"
OUTPUTS = (MANIFEST, RESOLVED, TAKE, "bvh", "ply", "pcd", "frames", "video.mp4", "contact_sheet.png", "profile.csv",
           "profile.png")  # fmt: skip
"""What a run writes into its folder, beside the files that its scenario reads."""
_DIFFERENCE_LINES = 40


def check_folder(folder: Path, resolved: str, force: bool) -> bool:
    """Say whether the run of a resolved scenario is finished in a folder; nothing is written.

    Raises:
        OutputError: The path is a file, cannot be written, holds something that is no run, or holds another run; the
            message then shows how they differ.
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
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read: {error.strerror or error}") from None
    if not os.access(above, os.W_OK | os.X_OK):
        raise OutputError(f"{folder}: cannot be written, expected a folder with write permission")
    if held and not _is_run(held):
        raise OutputError(f"{folder}: holds {held[0]!r}, which is no run's; expected an empty folder or a run's")
    if MANIFEST not in held or force:
        return False
    before = _read(folder / RESOLVED)
    if before == resolved and read_manifest(folder).get("status") == "done":
        return True
    lines = difflib.unified_diff(before.splitlines(), resolved.splitlines(), "run there", "asked for", "", "", 0, "")
    change = "\n".join(list(lines)[:_DIFFERENCE_LINES])
    raise OutputError(f"{folder}: holds another run; --force replaces it, --out names another folder\n{change}")


@contextmanager
def hold_folder(folder: Path) -> Iterator[None]:
    """Make a folder and keep other runs out of it; nothing of that stays, however this process ends.

    Raises:
        OutputError: It cannot be made, or another process holds it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror or error}") from None
    try:
        import fcntl
    except ImportError:
        yield
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(f"{folder}: is in use by another run; wait for it, or name another with --out") from None
        except OSError:
            # Some network file systems lock no folders.
            pass
        yield
    finally:
        os.close(number)


def clear_folder(folder: Path) -> list[str]:
    """Empty a folder that ``check_folder`` has seen of an earlier run; say what was found unfinished.

    Raises:
        OutputError: Something in it cannot be removed.
    """
    try:
        held = sorted(path.name for path in folder.iterdir())
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read: {error.strerror or error}") from None
    finished = MANIFEST in held
    try:
        listed = {name.split("/")[0] for name in read_manifest(folder)["files"]} if finished else set()
    except TakeError:
        listed = set()
    old = [name for name in held if name in OUTPUTS or name in listed or _is_partial(name)]
    _remove(folder, old)
    if finished or not old:
        return []
    return [f"{folder}: an unfinished run was found ({', '.join(old)}); starting clean"]


def _is_run(held: Sequence[str]) -> bool:
    """Whether a folder is a run's; every run begins with its resolved scenario."""
    return MANIFEST in held or RESOLVED in held or all(_is_partial(name) for name in held)


def _is_partial(name: str) -> bool:
    return name.endswith((".partial", ".part")) or name.startswith(".video-")


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return ""


def _remove(folder: Path, names: Sequence[str]) -> None:
    """Remove what an earlier run left, its manifest first so that it is never taken for done, and its name last."""
    order = {MANIFEST: 0, RESOLVED: 2}
    for name in sorted(names, key=lambda name: order.get(name, 1)):
        path = folder / name
        try:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
        except OSError as error:
            raise OutputError(f"{path}: cannot be replaced: {error.strerror or error}") from None


def write_text(path: Path, text: str) -> None:
    """Write a small file under a temporary name and rename it.

    Raises:
        OutputError: It cannot be written.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


def copy_file(source: Path, path: Path) -> None:
    """Copy a file under a temporary name and rename it; folders above it are made.

    Raises:
        OutputError: It cannot be copied.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, partial)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


def describe_run(folder: Path) -> dict[str, Any]:
    """Return what became of a run: its ``state``, and of a finished one ``avatars``, ``control_frames``, ``seconds``.

    The state is ``done``, ``interrupted``, ``unfinished`` (killed, failed or still going), ``damaged``, or ``none``
    where the folder is no run's.
    """
    from crowdsim.take.store import open_take

    try:
        held = [path.name for path in folder.iterdir()]
        if MANIFEST in held:
            told = read_manifest(folder)
            numbers = {name: told[name] for name in ("avatars", "control_frames")}
            return {"state": "done", **numbers, "seconds": told["seconds"]["total"]}
        if TAKE in held:
            take = open_take(folder)
            state = "interrupted" if take.status == "interrupted" else "unfinished"
            return {"state": state, "avatars": take.avatar_count, "control_frames": take.frame_count}
    except (TakeError, OSError) as error:
        return {"state": "damaged", "why": str(error)}
    return {"state": "unfinished" if RESOLVED in held else "none"}
