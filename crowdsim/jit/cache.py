"""The cache of compiled kernels: a folder for each source file, named by a digest of all that its kernels depend on."""

from __future__ import annotations

import hashlib
import re
import shutil
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from filelock import FileLock, Timeout
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

from crowdsim.jit.compilers import pack_part, unpack_part
from crowdsim.jit.signatures import digest, encode

PACKAGE = Path(__file__).resolve().parent.parent
_IMPORT = re.compile(rf"^(?:from|import)\s+({PACKAGE.name}(?:\.\w+)*)", re.MULTILINE)
_DECORATOR = f"{PACKAGE.name}.jit"


@cache
def source_digest(path: Path) -> str:
    """Return a digest of a source file and of all files of this package that it depends on.

    Raises:
        ImportError: It imports a name from a package instead of from the module that defines it.
    """
    source = path.read_bytes()
    digest = hashlib.sha256(source)
    for name in sorted(set(_IMPORT.findall(source.decode("utf-8"))) - {_DECORATOR}):
        imported = PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py")
        if not imported.is_file():
            raise ImportError(f"{path}: kernels import from modules, and {name} is a package", path=str(path))
        digest.update(source_digest(imported).encode())
    return digest.hexdigest()


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
        self._cache_file = _Files(self.cache_path, function.__qualname__, self._impl.locator.get_source_stamp())

    def _index_key(self, sig: Any, codegen: Any) -> str:
        versions = (numba.__version__, sys.implementation.cache_tag)
        text = repr((versions, [_describe(kind) for kind in sig], codegen.magic_tuple()))
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
            files cannot be locked: then each process compiles for itself.
        """
        path = self.path(signature, codegen)
        lock = FileLock(path.with_suffix(".lock"), timeout=-1 if wait else 0)
        try:
            self._impl.locator.ensure_cache_path()
            lock.acquire()
        except Timeout:
            yield False
            return
        except (OSError, NotImplementedError):
            # The folder cannot be written, or its file system has no locks.
            yield True
            return
        try:
            yield True
        finally:
            # Whoever waits for it finds the compiled kernel.
            with suppress(OSError):
                path.with_suffix(".lock").unlink(missing_ok=True)
            lock.release()

    def _save_overload(self, sig: Any, data: Any) -> None:
        try:
            super()._save_overload(sig, data)
        except OSError as error:
            _warn_once(self.cache_path, str(error))


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


class Folder:
    """Folder of the compiled code of a source file, in the form that numba's cache asks for."""

    def __init__(self, source: Path) -> None:
        from numba import config

        self._py_file, self._stamp = str(source), source_digest(source)[:16]
        self._parent = source.parent / "__pycache__"
        if config.CACHE_DIR:  # type: ignore[attr-defined]
            installation = hashlib.sha256(str(source.parent).encode()).hexdigest()[:12]
            self._parent = Path(config.CACHE_DIR) / f"{source.parent.name}_{installation}"  # type: ignore[attr-defined]
        self.path = self._parent / f"{source.stem}-{self._stamp}"

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self.path)

    def get_source_stamp(self) -> str:
        """Return the digest."""
        return self._stamp

    def ensure_cache_path(self) -> None:
        """Create the folder; remove those of former versions of the source."""
        if self.path.is_dir():
            return
        self.path.mkdir(parents=True, exist_ok=True)
        former = re.compile(rf"{re.escape(Path(self._py_file).stem)}-[0-9a-f]{{16}}")
        for other in self._parent.iterdir():
            if former.fullmatch(other.name) and other != self.path:
                shutil.rmtree(other, ignore_errors=True)


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


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """A file for each key and no index, so that processes that compile at the same time need no lock."""

    def load(self, key: str) -> Any:
        try:
            return self._load_data(f"{key}.nbc")
        except OSError:
            return None

    def save(self, key: str, data: Any) -> None:
        self._save_data(f"{key}.nbc", data)


@cache
def _warn_once(folder: str, reason: str) -> None:
    warnings.warn(f"compiled kernels cannot be kept in {folder}: {reason}", RuntimeWarning, stacklevel=2)
