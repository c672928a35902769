"""The cache of compiled kernels: a file for each kernel and signature, which can be removed at any time.

A file that cannot be used, for whatever reason, is removed and its kernel compiled again; a process reports the first.
"""

from __future__ import annotations

import hashlib
import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from filelock import FileLock, Timeout
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.environment import Environment, lookup_environment
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from crowdsim.jit.compilers import pack_part, unpack_part
from crowdsim.jit.folders import Folder, tidy
from crowdsim.jit.signatures import digest, encode
from crowdsim.jit.store import DamageError, discard, read_entry, report, write_entry

PATIENCE = 300.0
"""How long to wait for another process that compiles a kernel [s], which may have been stopped."""
VERSIONS = (numba.__version__, llvmlite.__version__, np.__version__, sys.implementation.cache_tag)


class _Cache:
    """The whole cache, as this process knows it.

    Attributes:
        room: How much more may be written before it must be tidied [bytes].
    """

    room = 0


class KernelCache(FunctionCache):  # type: ignore[misc]
    """What has been compiled of a kernel, by its signature.

    Args:
        function: The function.
        part: Whether it is kept as a part of other kernels, uncompiled, and not to be called from Python.
    """

    _impl_class = None

    def __init__(self, function: Any, part: bool) -> None:
        self._part = part
        self._impl_class = _Parts if part else _Results
        super().__init__(function)

    def _index_key(self, sig: Any, codegen: Any) -> str:
        text = repr((VERSIONS, [_describe(kind) for kind in sig], codegen.magic_tuple()))
        kind = "part" if self._part else _arguments_digest(sig)
        return f"{self._py_func.__qualname__}.{kind}.{hashlib.sha256(text.encode()).hexdigest()[:16]}"

    def path(self, signature: tuple[Any, ...], codegen: Any) -> Path:
        """Return the file of a signature, whether it is there or not."""
        return Path(self.cache_path) / f"{self._index_key(signature, codegen)}.nbc"

    @contextmanager
    def hold(self, signature: tuple[Any, ...], codegen: Any, wait: bool = True) -> Iterator[bool]:
        """Keep other processes from compiling a signature meanwhile; they load what this one has compiled.

        Yields:
            Whether it is this process that compiles; without ``wait``, False where another one does. True as well where
            files cannot be locked, or the other one takes longer than ``PATIENCE``: then each compiles for itself.
        """
        path = self.path(signature, codegen)
        lock = FileLock(path.with_suffix(".lock"), timeout=PATIENCE if wait else 0)
        try:
            self._impl.locator.ensure_cache_path()
            lock.acquire()
        except Timeout:
            yield wait
            return
        except (OSError, NotImplementedError):
            # The folder cannot be written, or its file system has no locks.
            yield True
            return
        try:
            yield True
        finally:
            # A process that waits for it finds the compiled kernel.
            with suppress(OSError):
                path.with_suffix(".lock").unlink(missing_ok=True)
            lock.release()

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Return what has been compiled of a signature, or None."""
        # Compiled code needs numba's runtime. Compilers load its declarations too, which takes most of a second.
        rtsys.initialize(context)
        problem = self._impl.locator.problem()
        if problem:
            report(problem)
            return None
        path = self.path(signature, context.codegen())
        try:
            data = read_entry(path)
        except FileNotFoundError:
            return None
        except (OSError, DamageError) as error:
            problem = str(getattr(error, "strerror", error))
        else:
            try:
                return self._impl.rebuild(context, _unpack(data))
            except Exception as error:
                problem = f"{type(error).__name__}: {error}"
        discard(path)
        report(f"{path}: {problem}; the kernel is compiled again")
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep what has been compiled of a signature."""
        if not self._impl.check_cachable(result):
            return
        try:
            self._impl.locator.ensure_cache_path()
            size = write_entry(self.path(signature, result.codegen), dumps(self._impl.reduce(result)))
        except OSError as error:
            report(f"compiled kernels cannot be kept in {self.cache_path}: {error}")
            return
        _Cache.room -= size
        if _Cache.room < 0:
            _Cache.room = tidy()


_REBUILT = ("numba.core.environment", "_rebuild_env")
"""What numba packs environments as."""


def _unpack(data: bytes | memoryview) -> Any:
    """Return compiled code, without the modules that its environments name: it uses no name of theirs."""
    import pickle

    class Unpickler(pickle.Unpickler):
        def find_class(self, module: str, name: str) -> Any:
            return _environment if (module, name) == _REBUILT else super().find_class(module, name)

    return Unpickler(io.BytesIO(data)).load()


def _environment(module: str, constants: list[Any], name: str) -> Any:
    """Return an environment of compiled code: the one that is there, or one of its constants alone."""
    found = lookup_environment(name)
    if found is None:
        found = Environment._memo[name] = Environment({"__name__": module})
        found.consts[:] = constants
        found.env_name = name
    return found


def _describe(kind: Any) -> str:
    """Return the name of a numba type, with modules and fields of named tuples, which their names leave out."""
    if not hasattr(kind, "types"):
        return str(kind)
    module = getattr(getattr(kind, "instance_class", None), "__module__", "")
    return f"{module}.{kind}[{' '.join(getattr(kind, 'fields', ()))}]({', '.join(map(_describe, kind.types))})"


def _arguments_digest(signature: tuple[Any, ...]) -> str:
    """Return the digest by which files can be found without numba; another where arguments cannot be listed."""
    try:
        return digest([encode(kind) for kind in signature])
    except (AttributeError, TypeError):
        return digest([_describe(kind) for kind in signature])


class _Results(CompileResultCacheImpl):  # type: ignore[misc]
    """Machine code, as numba keeps it."""

    def __init__(self, function: Any) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = Folder(Path(function.__code__.co_filename))
        self._filename_base = function.__qualname__


class _Parts(_Results):
    """Code of a kernel for those that call it, not yet optimised."""

    def reduce(self, result: Any) -> Any:
        return pack_part(result)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        return unpack_part(target_context, payload)
