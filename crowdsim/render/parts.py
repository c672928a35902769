"""Folders of a video's segments, from which an interrupted video continues; a mark identifies them."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path

from crowdsim.errors import OutputError
from crowdsim.files import make_folder, open_plain, remove_plain, walk

_MARK = "mark"
_FILES = re.compile(r"mark|\.mark\.part|parts\.txt|\.?\d{8,}-\d{8,}\.mp4(?:\.part)?")


def make_parts(path: Path, mark: str) -> None:
    """Make a folder for the segments of the video with a mark, unless it is there.

    Args:
        path: The folder, whose name ends with the first digits of the mark.
        mark: What all that the pictures depend on is summed up in.

    Raises:
        OutputError: It cannot be made, or something else has its name.
    """
    if is_parts(path):
        return
    if os.path.lexists(path) and not (path.is_dir() and not path.is_symlink() and not any(path.iterdir())):
        raise OutputError(f"{path}: is in the way of a video's segments, and no rendering has made it; move it")
    make_folder(path)
    part = path / f".{_MARK}.part"
    try:
        part.write_text(mark, encoding="ascii")
        os.replace(part, path / _MARK)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error


def is_parts(path: Path) -> bool:
    """Whether a folder was made by ``make_parts``."""
    if path.is_symlink():
        return False
    try:
        with open_plain(path, _MARK) as file:
            mark = file.read(4096).decode("ascii", "replace")
    except OSError:
        return False
    return len(mark) >= 16 and path.name == f".video-{mark[:16]}"


def remove_parts(path: Path) -> None:
    """Remove a folder of segments, as far as it holds nothing else; the mark last."""
    with contextlib.suppress(OSError):
        names = [name for name in walk(path) if _FILES.fullmatch(name)]
        remove_plain(path, sorted(names, key=lambda name: name == _MARK))
        path.rmdir()
