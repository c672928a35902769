"""The one door to files inside a folder: found, read, written, moved and removed there, never through a link.

A folder that a user names may be a link itself. What is inside it must be regular files and folders, since another
person may have made them; names that lead out of it are refused, and sizes are looked at before anything is read.
"""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, NamedTuple

from crowdsim.errors import OutputError

UNFINISHED = ".run.partial"
"""Folder in a run's in which the run is written until it is whole."""
_KINDS = {
    stat.S_IFREG: "a regular file",
    stat.S_IFDIR: "a folder",
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFBLK: "a device",
    stat.S_IFCHR: "a device",
}


class Writing(NamedTuple):
    """Where a command writes.

    Attributes:
        folder: Where its files go until they are whole.
        done: The files in their places where the same command has written them before, and nothing is to be done.
    """

    folder: Path
    done: tuple[Path, ...] = ()


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


def read_plain(folder: Path, name: str, most: int) -> bytes:
    """Return what a regular file inside a folder holds; its size is looked at before it is read.

    Raises:
        NotPlainError: It is something else, or longer than ``most`` bytes, or a folder above it is a link.
        OSError: It is missing, or cannot be read.
    """
    size = stat_plain(folder, name).st_size
    with open_plain(folder, name) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise NotPlainError(
            errno.EFBIG, f"has {max(size, len(data)):,} bytes, expected at most {most:,}", f"{folder}/{name}"
        )
    return data


def exists_plain(folder: Path, name: str) -> bool:
    """Whether there is a regular file of this name inside a folder."""
    try:
        stat_plain(folder, name)
    except OSError:
        return False
    return True


def is_folder(folder: Path, name: str) -> bool:
    """Whether there is a folder of this name inside a folder; neither it nor one above it is a link."""
    path = os.fspath(folder)
    try:
        for part in name.split("/"):
            path = os.path.join(path, part)
            if not stat.S_ISDIR(os.lstat(path).st_mode):
                return False
    except OSError:
        return False
    return is_inside(name)


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


def entries(folder: Path, name: str = "") -> list[str]:
    """Return the names of what is in a folder, or in one inside it; none where that is a link or missing.

    Raises:
        OSError: It cannot be read.
    """
    if name and not is_folder(folder, name):
        return []
    return sorted(os.listdir(os.path.join(folder, *name.split("/"))))


def make_inside(folder: Path, name: str) -> Path:
    """Make a folder inside a folder, and those between; return its path.

    Raises:
        NotPlainError: One of them is a link or a file.
        OSError: One cannot be made.
    """
    path = folder
    if name and not is_inside(name):
        raise NotPlainError(errno.EINVAL, "leads out of its folder, expected a folder inside", f"{folder}/{name}")
    for part in name.split("/") if name else ():
        path = path / part
        with suppress(FileExistsError):
            os.mkdir(path)
        mode = os.lstat(path).st_mode
        if not stat.S_ISDIR(mode):
            raise NotPlainError(errno.ENOTDIR, f"is {kind_of(mode)}, expected a folder; links are not followed", path)
    return path


@contextmanager
def whole_file(folder: Path, name: str) -> Iterator[Path]:
    """Give the temporary path of a file inside a folder, which has its name when this context ends.

    Args:
        folder: The folder.
        name: Name of the file; folders above it are made.

    Raises:
        OutputError: It cannot be written; nothing is left of it.
    """
    path = Path(folder, *name.split("/"))
    partial = path.with_name(f".{path.name}.part")
    try:
        make_inside(folder, name.rpartition("/")[0])
        partial.unlink(missing_ok=True)
        yield partial
        os.replace(partial, path)
        # Two names of one file both stay.
        partial.unlink(missing_ok=True)
    except BaseException as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
        raise


def write_plain(
    folder: Path,
    name: str,
    data: str | bytes | Iterable[bytes | memoryview],
    lasts: bool = False,
    settle: Callable[[Path], None] | None = None,
) -> None:
    """Write a file inside a folder; arguments and errors not listed here are those of ``whole_file``.

    Args:
        folder: The folder.
        name: Name of the file.
        data: What it holds, or blocks of that.
        lasts: Whether to wait until it is on disk.
        settle: Called with the folder before it has its name.
    """
    blocks = [data.encode("utf-8")] if isinstance(data, str) else [data] if isinstance(data, bytes) else data
    with whole_file(folder, name) as partial:
        with open(partial, "xb") as file:
            for block in blocks:
                file.write(block)
            if lasts:
                # What it says must be on disk before it has its name.
                file.flush()
                os.fsync(file.fileno())
        if settle is not None:
            settle(folder)


def write_text(path: Path, text: str) -> None:
    """Write a small file under a temporary name and rename it.

    Raises:
        OutputError: It cannot be written.
    """
    write_plain(path.parent, path.name, text)


def move_plain(source: Path, name: str, folder: Path, new_name: str = "") -> None:
    """Move a regular file, or a folder, from inside a folder into another one on the same disk.

    A file takes the place of one of its name; a folder needs a name that is free.

    Raises:
        NotPlainError: What is moved, or is in its place, is something else, or a folder above either is a link.
        OSError: It cannot be moved.
    """
    new_name = new_name or name
    if not is_folder(source, name):
        stat_plain(source, name)
        with suppress(FileNotFoundError):
            stat_plain(folder, new_name)
    make_inside(folder, new_name.rpartition("/")[0])
    os.replace(os.path.join(source, *name.split("/")), os.path.join(folder, *new_name.split("/")))


def copy_plain(source: Path, folder: Path, name: str, link: bool = False) -> None:
    """Copy a file into a folder; arguments and errors not listed here are those of ``whole_file``.

    Args:
        source: The file.
        folder: The folder.
        name: Its name there.
        link: Whether it may become a second name of the same file, which is never written again.
    """
    with whole_file(folder, name) as partial:
        if link:
            # Not every file system has links.
            with suppress(OSError):
                os.link(source, partial, follow_symlinks=False)
        if not partial.exists():
            shutil.copyfile(source, partial)


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
    for name in sorted(emptied, key=lambda name: (-name.count("/"), name)):
        # One that holds something that is not ours stays.
        with suppress(OSError):
            os.rmdir(os.path.join(folder, *name.split("/")))


def remove_tree(folder: Path, name: str) -> None:
    """Remove a folder inside a folder with all that is in it, or whatever else has the name; links are not followed.

    Raises:
        NotPlainError: A folder above it is a link.
        OSError: It cannot be removed.
    """
    above, path = name.rpartition("/")[0], os.path.join(folder, *name.split("/"))
    if not is_inside(name) or (above and not is_folder(folder, above)):
        raise NotPlainError(errno.ENOTDIR, "is behind a link, or elsewhere; links are not followed", path)
    if stat.S_ISDIR(os.lstat(path).st_mode):
        shutil.rmtree(path)
    else:
        os.unlink(path)


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
