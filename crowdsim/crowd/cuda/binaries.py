"""Compiled threads: for one kind of GPU, with nothing contracted, kept by a digest of all sources.

A product and a sum in one rounding (FMA) would give other bytes than a processor does; on a GPU control gains nothing
from it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba import cuda
from numba.core.serialize import dumps

from crowdsim.core.types import Progress
from crowdsim.crowd.cuda.memory import SIMULATED
from crowdsim.crowd.cuda.threads import BLOCK, THREADS, Work
from crowdsim.jit.cache import VERSIONS
from crowdsim.jit.folders import Folder
from crowdsim.jit.store import DamageError, discard, read_entry, report, write_entry

_loaded: dict[tuple[Any, ...], dict[str, Any]] = {}
"""The threads that this process has loaded, by their argument's type and the kind of GPU."""


def load_threads(work: Work, progress: Progress | None = None) -> dict[str, Any]:
    """Return all threads by name, compiled for the GPU that there is; those that are kept are only loaded.

    Args:
        work: What they are called with.
        progress: Called with what is done, how many threads are ready, and their number.
    """
    if SIMULATED:
        return {thread.__name__: cuda.jit(thread) for thread in THREADS}
    prepare_compiler()
    from numba import typeof

    kind, capability = typeof(work), cuda.get_current_device().compute_capability
    key = (kind, capability)
    if key not in _loaded:
        found = {}
        for done, thread in enumerate(THREADS):
            if progress is not None:
                progress(f"kernels for the GPU (sm_{capability[0]}{capability[1]})", done, len(THREADS))
            found[thread.__name__] = compile_thread(thread, kind, capability)
        _loaded[key] = found
    return _loaded[key]


def launch(thread: Any, work: Work, count: int, block: int = BLOCK) -> None:
    """Run a thread for each of ``count`` items, in whole blocks; those beyond find nothing to do."""
    if count > 0:
        thread[-(-count // block), block](work)


def compile_thread(function: Callable[[Work], None], kind: Any, capability: tuple[int, int]) -> Any:
    """Return a thread that is compiled or loaded for an argument's type, and called with nothing else."""
    thread = cuda.jit(lto=False)(function)
    thread._cache = ThreadCache(function, capability)
    with nothing_contracted():
        thread.compile((kind,))
    # The type of an argument of a hundred arrays is not looked at again at each launch.
    thread.disable_compile()
    thread._specialized = True
    return thread


@contextmanager
def nothing_contracted() -> Iterator[None]:
    """Let NVVM, for which numba has no such option, keep products and sums apart."""
    from numba.cuda.cudadrv import nvvm

    generate = nvvm.compile_ir
    nvvm.compile_ir = lambda code, **options: generate(code, **{**options, "fma": False})
    try:
        yield
    finally:
        nvvm.compile_ir = generate


def prepare_compiler() -> None:
    """Make known to the compiler for GPUs what only processors have."""
    from numba.cuda.extending import overload

    from crowdsim.crowd.kernels.prefetch import prefetch

    if prefetch not in _overloaded:
        _overloaded.append(prefetch)
        # A GPU works on other threads while one waits for memory.
        overload(prefetch)(lambda array, index: lambda array, index: None)


_overloaded: list[Any] = []


class ThreadCache:
    """Where a compiled thread is kept, in the form in which numba asks for it.

    Args:
        function: The thread.
        capability: The kind of GPU.
    """

    def __init__(self, function: Callable[[Work], None], capability: tuple[int, int]) -> None:
        self._name = function.__qualname__
        self._capability = capability
        self._folder = Folder(Path(function.__code__.co_filename))

    def path(self, signature: Any) -> Path:
        """Return the file of a signature, whether it is there or not."""
        from importlib.metadata import version

        text = repr((VERSIONS, version("numba-cuda"), self._capability, [str(kind) for kind in signature]))
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        return self._folder.path / f"{self._name}.sm_{self._capability[0]}{self._capability[1]}.{digest}.nbc"

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return what has been compiled of a signature, or None."""
        import pickle

        from numba.cuda.dispatcher import _Kernel

        path = self.path(signature)
        if problem := self._folder.problem():
            report(problem)
            return None
        try:
            return _Kernel._rebuild(**pickle.loads(read_entry(path)))
        except FileNotFoundError:
            return None
        except (OSError, DamageError, pickle.UnpicklingError, TypeError) as error:
            discard(path)
            report(f"{path}: {error}; the kernel is compiled again")
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep what has been compiled of a signature: its machine code."""
        library = compiled._codelibrary
        # In these the name of the argument's type, of some 15 kB, stands for each of a thousand parameters.
        library._llvm_strs, library._ptx_cache = [], {}
        try:
            self._folder.ensure_cache_path()
            write_entry(self.path(signature), dumps(compiled._reduce_states()))
        except OSError as error:
            report(f"compiled kernels cannot be kept in {self._folder.path}: {error}")
