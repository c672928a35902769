"""What training goes on inside: one process at a time, with errors that name the recipe."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from crowdsim.core.types import Progress
from crowdsim.errors import CrowdsimError, MotionError, PolicyError


@contextmanager
def alone(folder: Path, progress: Progress | None) -> Iterator[bool]:
    """Let one process at a time train a bundle; give whether this one had to wait for another.

    Where files cannot be locked, each trains for itself, and the last one's bundle stays.
    """
    path = folder.with_name(f".{folder.name}.lock")
    lock = FileLock(path)
    waited = False
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            waited = True
            if progress is not None:
                progress("wait for another process that trains it", 0, 1)
            lock.acquire()
    except (OSError, NotImplementedError):
        yield waited
        return
    try:
        yield waited
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)
        lock.release()


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the recipe's file before what is wrong with what it names."""
    try:
        yield
    except (MotionError, PolicyError) as error:
        kind: type[CrowdsimError] = type(error)
        raise kind(f"{path}: {error}") from None
