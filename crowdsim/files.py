"""Folders of outputs, and regular files inside a folder: named, found, opened and removed without following links."""

from __future__ import annotations

import ctypes
import errno
import os
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

from crowdsim.errors import OutputError

_KINDS = {
    stat.S_IFREG: "a regular file",
    stat.S_IFDIR: "a folder",
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFBLK: "a device",
    stat.S_IFCHR: "a device",
}


class NotPlainError(OSError):
    """A path is no regular file, or lies behind a link."""


def kind_of(mode: int) -> str:
    """Return what a path is by its mode, such as ``a named pipe``."""
    return _KINDS.get(stat.S_IFMT(mode), "a special file")


def is_inside(name: object) -> bool:
    """Whether a name is that of a file inside a folder: relative, parts with ``/`` between, none of them ``..``."""
    if not isinstance(name, str) or "\0" in name or (os.sep != "/" and os.sep in name):
        return False
    try:
        os.fsencode(name)
    except UnicodeEncodeError:
        return False
    return not os.path.splitdrive(name)[0] and all(part not in ("", ".", "..") for part in name.split("/"))


def stat_plain(folder: Path, name: str) -> os.stat_result:
    """Return the facts of a regular file inside a folder; neither it nor a folder above it may be a link.

    Raises:
        NotPlainError: It is something else, or a folder above it is.
        OSError: It is missing, or cannot be looked at.
    """
    if not is_inside(name):
        raise NotPlainError(errno.EINVAL, "leads out of its folder, expected a file inside", f"{folder}/{name}")
    path = os.fspath(folder)
    parts = name.split("/")
    for part in parts[:-1]:
        path = os.path.join(path, part)
        mode = os.lstat(path).st_mode
        if not stat.S_ISDIR(mode):
            raise NotPlainError(errno.ENOTDIR, f"is {kind_of(mode)}, expected a folder; links are not followed", path)
    path = os.path.join(path, parts[-1])
    found = os.lstat(path)
    if not stat.S_ISREG(found.st_mode):
        what = f"is {kind_of(found.st_mode)}, expected a regular file; links are not followed"
        raise NotPlainError(errno.EINVAL, what, path)
    return found


def open_plain(folder: Path, name: str) -> BinaryIO:
    """Open a regular file inside a folder for reading; never waits for a pipe.

    Raises:
        NotPlainError: It is something else, or a folder above it is.
        OSError: It is missing, or cannot be read.
    """
    stat_plain(folder, name)
    path = os.path.join(folder, *name.split("/"))
    # It may have been exchanged since it was looked at.
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise NotPlainError(errno.EINVAL, "is no regular file any more", path)
    return os.fdopen(number, "rb")


def exists_plain(folder: Path, name: str) -> bool:
    """Whether there is a regular file of this name inside a folder."""
    try:
        stat_plain(folder, name)
    except OSError:
        return False
    return True


def walk(folder: Path, below: str = "") -> Iterator[str]:
    """Yield the names of all that is no folder inside a folder, or in one of the folders in it; links are not followed.

    Raises:
        OSError: A folder cannot be read.
    """
    with os.scandir(os.path.join(folder, below)) as entries:
        found = sorted(entries, key=lambda entry: entry.name)
    for entry in found:
        name = f"{below}/{entry.name}" if below else entry.name
        if entry.is_dir(follow_symlinks=False):
            yield from walk(folder, name)
        else:
            yield name


def remove_plain(folder: Path, names: Iterable[str]) -> None:
    """Remove regular files inside a folder, and the folders in it that are empty then; missing ones are passed over.

    Raises:
        NotPlainError: One is something else, or a folder above it is.
        OSError: One cannot be removed.
    """
    emptied: set[str] = set()
    for name in names:
        try:
            stat_plain(folder, name)
        except FileNotFoundError:
            continue
        os.unlink(os.path.join(folder, *name.split("/")))
        parts = name.split("/")[:-1]
        emptied.update("/".join(parts[:depth]) for depth in range(1, len(parts) + 1))
    remove_empty(folder, emptied)


def remove_empty(folder: Path, names: Iterable[str]) -> None:
    """Remove those of some folders inside a folder that are empty, the inner ones first."""
    for name in sorted(names, key=lambda name: (-name.count("/"), name)):
        try:
            os.rmdir(os.path.join(folder, *name.split("/")))
        except OSError:
            # It holds something that is not ours, or is a link.
            continue


def make_folder(folder: Path) -> None:
    """Make a folder for outputs, and those above it.

    Raises:
        OutputError: It cannot be made, or is a file.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise OutputError(f"{folder}: is a file, expected a folder to write into") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror or error}") from None


def sync_disk(folder: Path) -> None:
    """Wait until all that has been written to a folder's file system is on disk.

    One call for any number of files costs about what one file alone does (``syncfs``; ``sync`` where there is none).

    Raises:
        OSError: The disk has failed.
    """
    number = os.open(folder, os.O_RDONLY)
    try:
        sync = getattr(ctypes.CDLL(None, use_errno=True), "syncfs", None)
        if sync is None:
            os.sync()
        elif sync(number) != 0:
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code), os.fspath(folder))
    finally:
        os.close(number)


def sync_folder(folder: Path) -> None:
    """Wait until the names of the files in a folder are on disk.

    Raises:
        OSError: The disk has failed.
    """
    number = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)


def replace_folder(fresh: Path, folder: Path, old: Path) -> None:
    """Put a folder in the place of another one, which is called ``old`` then; at no moment is there none.

    That is so on Linux with most file systems. Elsewhere there is none between two renamings, and ``restore_folder``
    brings the old one back should the process end there.

    Raises:
        OSError: It cannot be renamed; what was there stays.
    """
    if folder.exists():
        if _exchange(fresh, folder):
            os.replace(fresh, old)
            return
        os.replace(folder, old)
    try:
        os.replace(fresh, folder)
    except OSError:
        if old.exists():
            os.replace(old, folder)
        raise


def restore_folder(folder: Path, old: Path) -> bool:
    """Bring back a folder whose replacement was broken off; return whether that was necessary.

    Raises:
        OSError: It cannot be renamed.
    """
    if folder.exists() or not old.exists():
        return False
    os.replace(old, folder)
    return True


def _exchange(one: Path, other: Path) -> bool:
    """Exchange the names of two folders at once; return whether the system could."""
    try:
        rename = ctypes.CDLL(None, use_errno=True).renameat2
    except (AttributeError, OSError, TypeError):
        return False
    return rename(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0


_HERE, _EXCHANGE = -100, 2
"""Linux's AT_FDCWD and RENAME_EXCHANGE."""
