"""Threads that take ranges of work; kernels release the GIL, so plain threads are enough."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from types import TracebackType

GRAIN = 4096
"""Fewest items that are worth a range of their own."""

_RANGES = 4
"""Ranges for each thread, so that a thread whose items take less time, or that begins sooner, works on more."""


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
        """Call ``work(first, last)`` on ranges that together cover ``0`` to ``count``, and wait for all of them.

        Each thread takes a range when it has done the one before. After an error no further range is begun.
        """
        parts = min(_RANGES * self.threads, count // grain) if self._pool is not None else 1
        if parts <= 1:
            if count > 0:
                work(0, count)
            return
        ranges = deque(pairwise([count * k // parts for k in range(parts + 1)]))

        def work_off() -> None:
            while True:
                try:
                    first, last = ranges.popleft()
                except IndexError:
                    return
                try:
                    work(first, last)
                except BaseException:
                    ranges.clear()
                    raise

        assert self._pool is not None
        futures = [self._pool.submit(work_off) for _ in range(min(self.threads, parts) - 1)]
        try:
            work_off()
        finally:
            ranges.clear()
            errors = [future.exception() for future in futures]
        for error in errors:
            if error is not None:
                raise error
