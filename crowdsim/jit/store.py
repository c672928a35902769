"""Files of the user's cache, which are read only if they are whole, pass their checksum and are the user's own.

A file begins with the checksum of its name and of what follows. A checksum finds damage, not forgery: files that other
users may write are therefore refused as well.
"""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import shutil
import stat
import warnings
from contextlib import suppress
from pathlib import Path

from crowdsim.jit.environment import foreign_access

MOST = 64 << 20
"""Size of a file at most [bytes]; the largest kernel takes about 1 MB."""
_DIGEST = 32
_reported: list[str] = []
_PLAIN = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


class DamageError(Exception):
    """A file of the cache is not as it was written, or others may have written it."""


def read_entry(path: Path) -> memoryview:
    """Return what was written to a file; never waits for a pipe, and reads no more than ``MOST``.

    Raises:
        DamageError: It is not what ``write_entry`` has written under this name.
        OSError: It is missing, a link, or cannot be read.
    """
    number = os.open(path, os.O_RDONLY | _PLAIN | getattr(os, "O_NONBLOCK", 0))
    try:
        facts = os.fstat(number)
        if not stat.S_ISREG(facts.st_mode):
            raise DamageError("is no regular file")
        if access := foreign_access(facts):
            raise DamageError(access)
        if not _DIGEST < facts.st_size <= MOST:
            raise DamageError(f"has {facts.st_size} bytes, expected more than {_DIGEST} and at most {MOST}")
        whole = memoryview(os.read(number, facts.st_size))
    finally:
        os.close(number)
    checksum, data = whole[:_DIGEST], whole[_DIGEST:]
    if checksum != _checksum(path, data):
        raise DamageError("does not have the checksum that it was written with")
    return data


def write_entry(path: Path, data: bytes) -> int:
    """Write a file, which appears under its name when all of it is on disk; return its size.

    Raises:
        OSError: It cannot be written; what was there stays.
    """
    size = _DIGEST + len(data)
    if size > MOST:
        raise OSError(errno.EFBIG, f"a file of the cache takes {size} bytes, expected at most {MOST}", os.fspath(path))
    fresh = path.with_name(f"{path.name}.{secrets.token_hex(8)}.tmp")
    number = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _PLAIN, 0o644)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(_checksum(path, data))
            file.write(data)
            file.flush()
            os.fsync(number)
        os.replace(fresh, path)
    except BaseException:
        with suppress(OSError):
            fresh.unlink()
        raise
    return size


def discard(path: Path) -> None:
    """Remove whatever has the name of a file, if that can be done; links are not followed."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with suppress(OSError):
        path.unlink()


def report(problem: str) -> None:
    """Warn of a problem with the cache, the first one in this process alone."""
    if not _reported:
        _reported.append(problem)
        warnings.warn(problem, RuntimeWarning, stacklevel=3)


def _checksum(path: Path, data: bytes | memoryview) -> bytes:
    """Return a digest of an entry and of its name, which says what it was made from, for and with."""
    digest = hashlib.blake2b(f"{path.parent.name}/{path.name}\n".encode(), digest_size=_DIGEST)
    digest.update(data)
    return digest.digest()
