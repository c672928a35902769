"""Work on ranges, shared out among threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

_LEAST = 16
"""Fewer items than this are not divided among threads, since starting those takes longer."""


def share(threads: int, count: int, work: Callable[[int, int], None]) -> None:
    """Call ``work(low, high)`` on ranges that together cover ``0`` to ``count``, a thread each."""
    parts = min(threads, count // _LEAST + 1)
    if parts <= 1:
        work(0, count)
        return
    edges = [count * part // parts for part in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))
