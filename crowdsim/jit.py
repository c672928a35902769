"""The decorator of compiled kernels, and where compiled code is kept."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).resolve().parent
_IMPORT = re.compile(rf"^(?:from|import)\s+({PACKAGE.name}(?:\.\w+)*)", re.MULTILINE)


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    parallel: bool = False,
    inline: bool = False,
    allocates: bool = True,
    fastmath: Collection[str] = (),
) -> Any:
    """Compile a function with numba when it is first called, without the GIL, and keep the compiled code.

    The code is kept in a folder that is named by a digest of every source that the kernel depends on: its own file and,
    in turn, the files of this package that are imported there. A kernel may therefore call kernels of other files and
    use their constants: an edit recompiles what depends on the file, and nothing else.

    Args:
        function: The function; without it, a decorator with these options is returned.
        parallel: ``prange`` runs in threads.
        inline: The compiled code becomes part of each caller, which saves passing arrays; it allocates nothing.
        allocates: Whether the kernel creates arrays. One that does not needs no reference counts, which cost two atomic
            operations for every array that is passed to a function or read from a named tuple.
        fastmath: LLVM's flags for faster arithmetic that the kernel permits.
    """
    if function is None:
        return lambda wanted: kernel(wanted, parallel=parallel, inline=inline, allocates=allocates, fastmath=fastmath)
    import numba

    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    if parallel:
        options["parallel"] = True
    if fastmath:
        options["fastmath"] = set(fastmath)
    if inline or not allocates:
        options["_nrt"] = False
    if inline:
        options["forceinline"] = True
    dispatcher: Any = numba.njit(**options)(function)
    if not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        dispatcher._cache = _cache_class()(function)
    return dispatcher


@cache
def source_digest(path: Path) -> str:
    """Return a digest of a source file and of all files of this package that it depends on.

    Raises:
        ImportError: It imports a name from a package instead of from the module that defines it.
    """
    source = path.read_bytes()
    digest = hashlib.sha256(source)
    for name in sorted(set(_IMPORT.findall(source.decode("utf-8")))):
        imported = PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py")
        if not imported.is_file():
            raise ImportError(f"{path}: kernels import from modules, and {name} is a package", path=str(path))
        digest.update(source_digest(imported).encode())
    return digest.hexdigest()


def choose_kernel_cache(package: Path = PACKAGE) -> None:
    """Let kernels be kept where the user may write, and warn where that is not beside the package.

    numba keeps what it has compiled for each kind of processor. ``NUMBA_CACHE_DIR`` decides where it is set; else it is
    the package, then the user's cache, then a folder of the user's own for temporary files.
    """
    if os.environ.get("NUMBA_CACHE_DIR") or os.access(package, os.W_OK):
        return
    from platformdirs import user_cache_path

    temporary = Path(tempfile.gettempdir()) / f"crowdsim-{getattr(os, 'getuid', lambda: 0)()}"
    for place in (user_cache_path("crowdsim") / "kernels", temporary / "kernels"):
        if _usable(place, private=place.parent == temporary):
            os.environ["NUMBA_CACHE_DIR"] = str(place)
            if "numba" in sys.modules:
                from numba import config

                config.CACHE_DIR = str(place)  # type: ignore[attr-defined]
            warnings.warn(
                f"{package} is read-only; compiled kernels are kept in {place}, or where NUMBA_CACHE_DIR says",
                RuntimeWarning,
                stacklevel=3,
            )
            return
    warnings.warn(
        f"compiled kernels cannot be kept in {package} or in the user's cache, and every process compiles them anew; "
        "NUMBA_CACHE_DIR names another folder",
        RuntimeWarning,
        stacklevel=3,
    )


def load_numba() -> None:
    """Load numba without scipy, for which it looks as it loads, which takes a tenth of a second.

    Only linear algebra in compiled code needs scipy, and no kernel here has any. For the program alone: in a process in
    which others compile as well, they may.
    """
    name = "scipy.linalg.cython_blas"
    if "numba.np.arraymath" in sys.modules or name in sys.modules:
        return
    sys.modules[name] = None  # type: ignore[assignment]
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        del sys.modules[name]


def _usable(place: Path, private: bool) -> bool:
    """Return whether a folder can be made and written; a private one must be the user's alone."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        facts = place.parent.stat()
    except OSError:
        return False
    own = not hasattr(os, "getuid") or (facts.st_uid == os.getuid() and not facts.st_mode & stat.S_IWOTH)
    return os.access(place, os.W_OK) and (own or not private)


def _describe(kind: Any) -> str:
    """Return the name of a numba type, with the fields of named tuples, which their names leave out."""
    if not hasattr(kind, "types"):
        return str(kind)
    return f"{kind}[{' '.join(getattr(kind, 'fields', ()))}]({', '.join(map(_describe, kind.types))})"


class _Folder:
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
        return str(self.path)

    def get_source_stamp(self) -> str:
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


@cache
def _cache_class() -> Any:
    """Return the class of a kernel's cache; it cannot be defined before numba is loaded."""
    import numba
    from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

    class Results(CompileResultCacheImpl):  # type: ignore[misc]
        def __init__(self, function: Any) -> None:
            self._lineno = function.__code__.co_firstlineno
            self._locator = _Folder(Path(function.__code__.co_filename))
            self._filename_base = function.__qualname__

    class Files(IndexDataCacheFile):
        """A file for each key and no index, so that processes that compile at the same time need no lock."""

        def load(self, key: str) -> Any:
            try:
                return self._load_data(f"{key}.nbc")
            except OSError:
                return None

        def save(self, key: str, data: Any) -> None:
            self._save_data(f"{key}.nbc", data)

    class KernelCache(FunctionCache):  # type: ignore[misc]
        _impl_class = Results

        def __init__(self, function: Any) -> None:
            super().__init__(function)
            self._cache_file = Files(self.cache_path, function.__qualname__, self._impl.locator.get_source_stamp())

        def _index_key(self, sig: Any, codegen: Any) -> str:
            versions = (numba.__version__, sys.implementation.cache_tag)
            text = repr((versions, [_describe(kind) for kind in sig], codegen.magic_tuple()))
            return f"{self._py_func.__qualname__}.{hashlib.sha256(text.encode()).hexdigest()[:16]}"

        def _save_overload(self, sig: Any, data: Any) -> None:
            try:
                super()._save_overload(sig, data)
            except OSError as error:
                _warn_once(self.cache_path, str(error))

    return KernelCache


@cache
def _warn_once(folder: str, reason: str) -> None:
    warnings.warn(f"compiled kernels cannot be kept in {folder}: {reason}", RuntimeWarning, stacklevel=2)
