"""The time that kernels take to compile or to load, kept apart from the time that work takes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager
from time import perf_counter
from typing import Any

ANNOUNCEMENT = "compiling kernels, which can take minutes; they are kept, and later runs start at once"


class Compilation:
    """What compilation took so far, measured by numba's own events in all threads.

    Attributes:
        count: Kernels that were compiled; those that were only loaded do not count.
    """

    def __init__(self, announce: Callable[[str], None] | None = None, text: str = ANNOUNCEMENT) -> None:
        self.count = 0
        self._text = text
        self._announce = announce
        self._spent = 0.0
        self._depth = 0
        self._since = 0.0
        self._lock = threading.Lock()

    @property
    def seconds(self) -> float:
        """Time that compiling and loading has taken so far [s]."""
        with self._lock:
            return self._spent + (perf_counter() - self._since if self._depth else 0.0)

    def begin(self) -> None:
        """Note that a thread begins to compile or to load."""
        with self._lock:
            if self._depth == 0:
                self._since = perf_counter()
            self._depth += 1

    def end(self) -> None:
        """Note that a thread has ended it."""
        with self._lock:
            self._depth -= 1
            if self._depth == 0:
                self._spent += perf_counter() - self._since

    def compile(self) -> None:
        """Note that a kernel must be compiled, and announce the first one."""
        self.count += 1
        if self.count == 1 and self._announce is not None:
            self._announce(self._text)


@contextmanager
def watch_compilation(
    announce: Callable[[str], None] | None = None, uses: Collection[str] = (), workers: int = 0
) -> Iterator[Compilation]:
    """Measure what kernels take to compile or to load while this is open.

    Args:
        announce: Called once, when the first kernel must be compiled.
        uses: What kernels will be needed for; those are compiled ahead (``jit.ahead``).
        workers: Processes that compile ahead.
    """
    from numba.core import event

    from crowdsim.jit.ahead import compile_ahead

    class Listener(event.Listener):  # type: ignore[misc]
        def __init__(self, start: Callable[[], None], end: Callable[[], None]) -> None:
            self.start, self.end = start, end

        def on_start(self, event: Any) -> None:
            self.start()

        def on_end(self, event: Any) -> None:
            self.end()

    with ExitStack() as stack:
        missing = stack.enter_context(compile_ahead(uses, workers)) if uses else ""
        compilation = Compilation(announce, missing or ANNOUNCEMENT)
        listener = Listener(compilation.begin, compilation.end)
        stack.enter_context(event.install_listener("numba:compiler_lock", listener))
        stack.enter_context(event.install_listener("numba:compile", Listener(compilation.compile, lambda: None)))
        yield compilation
