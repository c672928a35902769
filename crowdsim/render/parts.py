"""Folders of a video's segments, from which an interrupted video continues; a mark identifies them."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable
from pathlib import Path

from crowdsim.errors import OutputError
from crowdsim.files import entries, exists_plain, make_folder, open_plain, remove_plain, walk, write_plain

_MARK = "mark"
_UNFINISHED = f".{_MARK}.part"
_NAME = re.compile(r"\.video-[0-9a-f]{16}")
_FILES = re.compile(r"mark|\.mark\.part|parts\.txt|\.?\d{8,}-\d{8,}\.mp4(?:\.part)?")


def make_parts(path: Path, mark: str) -> None:
    """Make a folder for the segments of the video with a mark, unless it is there.

    Args:
        path: The folder, whose name ends with the first digits of the mark.
        mark: What all that the pictures depend on is summed up in.

    Raises:
        OutputError: It cannot be made, or something else has its name.
    """
    if os.path.lexists(path) and not is_parts(path):
        raise OutputError(f"{path}: is in the way of a video's segments, and no rendering has made it; move it")
    if _has_mark(path):
        return
    make_folder(path)
    write_plain(path, _MARK, mark)


def is_parts(path: Path) -> bool:
    """Whether a folder was made by ``make_parts``, or holds nothing but what that left when it was killed."""
    return _NAME.fullmatch(path.name) is not None and not path.is_symlink() and (_has_mark(path) or _is_begun(path))


def _has_mark(path: Path) -> bool:
    """Whether a folder holds the mark that its name was made of."""
    try:
        with open_plain(path, _MARK) as file:
            mark = file.read(4096).decode("ascii", "replace")
    except OSError:
        return False
    return len(mark) >= 16 and path.name == f".video-{mark[:16]}"


def _is_begun(path: Path) -> bool:
    """Whether a folder is empty, or holds a mark alone that is not finished."""
    try:
        names = entries(path)
        return names == [] or (names == [_UNFINISHED] and exists_plain(path, _UNFINISHED))
    except OSError:
        return False


def mark_first(paths: Iterable[Path]) -> list[Path]:
    """Sort files of a folder of segments such that wherever moving them ends, what was moved is known as segments."""
    return sorted(paths, key=lambda path: (path.name != _MARK, path.name))


def remove_parts(path: Path) -> None:
    """Remove a folder of segments, as far as it holds nothing else; the mark last."""
    with contextlib.suppress(OSError):
        names = [name for name in walk(path) if _FILES.fullmatch(name)]
        remove_plain(path, sorted(names, key=lambda name: name == _MARK))
        path.rmdir()
