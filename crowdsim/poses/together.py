"""Independent pieces of posing, worked on by several threads at once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class _Inside(threading.local):
    """Whether this thread works on a piece."""

    now = False


_inside = _Inside()


def threads_left(threads: int) -> int:
    """Return how many of some threads work may use here: one within a piece, since others have the rest."""
    return 1 if _inside.now else threads


def each(work: Callable[[Item], Result], items: Sequence[Item], threads: int) -> list[Result]:
    """Return what work makes of every item, in order; within a piece one after the other.

    Args:
        work: Writes nothing that it reads for another item.
        items: The pieces.
        threads: Threads that share them.
    """
    threads = min(threads_left(threads), len(items))
    if threads <= 1:
        return [work(item) for item in items]
    with ThreadPoolExecutor(threads, initializer=_enter) as pool:
        return list(pool.map(work, items))


def _enter() -> None:
    _inside.now = True
