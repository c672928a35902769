"""Threads that share out ranges of work; kernels release the GIL, so plain threads are enough."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType

GRAIN = 2048
"""Fewest items that are worth a thread of their own."""


class Workers:
    """A pool of threads, or none at all for one thread.

    What is computed never depends on the number of threads: every range writes only its own part of the outputs.
    """

    def __init__(self, threads: int = 1) -> None:
        self.threads = max(int(threads), 1)
        self._pool = ThreadPoolExecutor(self.threads - 1) if self.threads > 1 else None

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def each(self, work: Callable[[int, int], object], count: int, grain: int = GRAIN) -> None:
        """Call ``work(first, last)`` on ranges that together cover ``0`` to ``count``, and wait for all of them."""
        parts = min(self.threads, count // grain) if self._pool is not None else 1
        if parts <= 1:
            if count > 0:
                work(0, count)
            return
        bounds = [count * k // parts for k in range(parts + 1)]
        pool = self._pool
        assert pool is not None
        futures = [pool.submit(work, bounds[k], bounds[k + 1]) for k in range(1, parts)]
        work(bounds[0], bounds[1])
        for future in futures:
            future.result()
