"""Ranges of work, shared out among threads; kernels release the GIL, so plain threads are enough."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from itertools import pairwise

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""Cores that this process may use."""

_LEAST = 8
"""Items that a range has at least: a shorter one takes longer to hand to a thread than to work on."""
_RANGES = 4
"""Ranges for each thread, so that threads whose items take less time work on more of them."""

_threads: ContextVar[int] = ContextVar("threads", default=CORES)


@contextmanager
def limited(threads: int) -> Iterator[None]:
    """Let ``share`` use so many threads where it is given no number, and no more than there are cores."""
    before = _threads.set(max(1, min(threads, CORES)))
    try:
        yield
    finally:
        _threads.reset(before)


def share(
    count: int, work: Callable[..., object], *arguments: object, threads: int | None = None, least: int = _LEAST
) -> None:
    """Call ``work(low, high, *arguments)`` on ranges that together cover ``0`` to ``count``, in several threads.

    Returns when all ranges are done. Threads are kept for the next call.

    Args:
        count: Number of items.
        work: Works on the items of a range, and writes nothing that another range reads or writes.
        arguments: What it is called with.
        threads: Number of threads, the calling one included; by default one for each core, or as ``limited`` says.
        least: Items that a range has at least.

    Raises:
        Exception: What ``work`` raised; ranges that are not begun by then are left out.
    """
    parts = max(count // least, 1)
    threads = min(_threads.get() if threads is None else threads, parts)
    if threads <= 1:
        work(0, count, *arguments)
        return
    parts = min(parts, _RANGES * threads)
    ranges = deque(pairwise([count * part // parts for part in range(parts + 1)]))

    def work_off() -> None:
        for low, high in _taken(ranges):
            work(low, high, *arguments)

    pool = _pool(threads - 1)
    helpers = [pool.submit(work_off) for _ in range(threads - 1)]
    try:
        work_off()
    finally:
        ranges.clear()
        # A helper that has not begun is not needed, and might wait for this very thread.
        errors = [helper.exception() for helper in helpers if not helper.cancel()]
    for error in errors:
        if error is not None:
            raise error


def _taken(ranges: deque[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Take ranges off a list that other threads take from as well, until there are none."""
    while True:
        try:
            taken = ranges.popleft()
        except IndexError:
            return
        yield taken


@cache
def _pool(helpers: int) -> ThreadPoolExecutor:
    """Return threads that wait for work."""
    return ThreadPoolExecutor(helpers, thread_name_prefix="crowdsim")


if hasattr(os, "register_at_fork"):
    # Threads do not survive a fork.
    os.register_at_fork(after_in_child=_pool.cache_clear)
