"""Folders of compiled kernels: one for each source file, named by a digest of all that its kernels depend on."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import stat
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from crowdsim.jit.environment import cache_limit, foreign_access
from crowdsim.jit.store import discard, report

PACKAGE = Path(__file__).resolve().parent.parent
_IMPORT = re.compile(rf"^(?:from|import)\s+({PACKAGE.name}(?:\.\w+)*)", re.MULTILINE)
_DECORATOR = f"{PACKAGE.name}.jit"
_LEFT_BEHIND = 3600
"""Age from which a file that is no kernel, such as one that was never completed, is removed [s]."""
_HEX = "[0-9a-f]"


@cache
def source_digest(path: Path) -> str:
    """Return a digest of a source file and of all files of this package that it depends on, but for the compiler.

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


@cache
def _compiler_digest() -> bytes:
    """Return a digest of how kernels are compiled and kept: of all files of ``jit``."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))).digest()


class Folder:
    """Folder of the compiled code of a source file, in the form that numba's cache asks for."""

    def __init__(self, source: Path) -> None:
        self._py_file = str(source)
        self._stamp = hashlib.sha256(source_digest(source).encode() + _compiler_digest()).hexdigest()[:16]
        self.path = _parent(source.parent) / f"{source.stem}-{self._stamp}"
        # A user who may write beside the package may change the program itself.
        self._private = [self.path, self.path.parent, self.path.parent.parent] if _cache_dir() else [self.path]

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self.path)

    def get_source_stamp(self) -> str:
        """Return the digest."""
        return self._stamp

    def ensure_cache_path(self) -> None:
        """Create the folder, so that only this user may write there.

        Raises:
            OSError: It cannot be created, or others may write there.
        """
        if os.path.lexists(self.path) and not self.path.is_dir():
            discard(self.path)
            report(f"{self.path}: is no folder; it is replaced by one, and kernels are compiled again")
        for place in reversed((self.path, *self.path.parents)):
            if not place.exists():
                place.mkdir(mode=0o755, exist_ok=True)
        if problem := self.problem():
            raise PermissionError(problem)

    def problem(self) -> str:
        """Return why the folder must not be used, and what to do; an empty text where it may be, or is missing."""
        for place in self._private:
            try:
                facts = place.stat()
            except FileNotFoundError:
                continue
            except OSError as error:
                return f"compiled kernels cannot be kept in {self.path}: {error.strerror}"
            # In one such as /tmp, others cannot replace what is the user's own.
            sticky = place not in self._private[:2] and facts.st_mode & stat.S_ISVTX
            if access := foreign_access(facts, ignored=0o022 if sticky else 0):
                return (
                    f"compiled kernels are not kept in {self.path}: {place} {access}; use chmod go-w or chown there, "
                    "or set NUMBA_CACHE_DIR to another folder"
                )
        return ""


def tidy() -> int:
    """Remove kernels of former versions, what killed processes left, and the oldest kernels beyond the limit.

    Returns:
        How much more may be written before this should be done again [bytes].
    """
    limit, now = cache_limit(), time.time()
    files: list[tuple[float, int, str]] = []
    for folder in _folders():
        with suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                facts = entry.stat(follow_symlinks=False)
                if entry.name.endswith(".nbc"):
                    files.append((facts.st_mtime, facts.st_size, entry.path))
                elif now - facts.st_mtime > _LEFT_BEHIND:
                    discard(Path(entry.path))
    total = sum(size for _, size, _ in files)
    # Somewhat more is removed, so that it is not to be done again at once.
    excess = total - limit * 9 // 10 if total > limit else 0
    for _, size, path in sorted(files):
        if excess <= 0:
            break
        with suppress(OSError):
            os.unlink(path)
            excess, total = excess - size, total - size
    return limit - total


def _folders() -> Iterator[Path]:
    """Yield the folders of kernels, and remove those of former versions of this package."""
    sources = {_parent(folder): folder for folder in {path.parent for path in PACKAGE.rglob("*.py")}}
    base = _cache_dir()
    for parent in {*sources, *(Path(base).glob(f"*_{_HEX * 12}") if base else ())}:
        for folder in parent.glob(f"*-{_HEX * 16}"):
            try:
                facts = folder.lstat()
            except OSError:
                # Another process has removed it.
                continue
            if not stat.S_ISDIR(facts.st_mode) or foreign_access(facts):
                continue
            if parent in sources and not _is_current(folder, sources[parent]):
                shutil.rmtree(folder, ignore_errors=True)
            else:
                yield folder


def _is_current(folder: Path, sources: Path) -> bool:
    source = sources / f"{folder.name[:-17]}.py"
    try:
        return Folder(source).path == folder
    except (OSError, ImportError):
        return False


def _parent(sources: Path) -> Path:
    """Return where the folders of kernels of some source files are."""
    base = _cache_dir()
    if not base:
        return sources / "__pycache__"
    return Path(base) / f"{sources.name}_{hashlib.sha256(str(sources).encode()).hexdigest()[:12]}"


def _cache_dir() -> str:
    from numba import config

    return str(config.CACHE_DIR)  # type: ignore[attr-defined]
