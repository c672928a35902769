"""Where compiled kernels are kept and how many, and how numba is loaded; none of it needs numba itself."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent
LIMIT = 1000
"""Size of all kept kernels together at most [MB]; those of one version take about 20."""


def choose_kernel_cache(package: Path = PACKAGE) -> None:
    """Let kernels be kept where the user may write, and warn where that is not beside the package.

    numba keeps what it has compiled for each kind of processor. ``NUMBA_CACHE_DIR`` decides where it is set; else it is
    the package, then the user's cache, then a folder of the user's own for temporary files.
    """
    if os.environ.get("NUMBA_CACHE_DIR") or os.access(package, os.W_OK):
        return
    place = cache_folder("kernels")
    if place is None:
        warnings.warn(
            f"compiled kernels cannot be kept in {package} or in the user's cache, and every process compiles them "
            "again; NUMBA_CACHE_DIR names another folder",
            RuntimeWarning,
            stacklevel=3,
        )
        return
    os.environ["NUMBA_CACHE_DIR"] = str(place)
    if "numba" in sys.modules:
        from numba import config

        config.CACHE_DIR = str(place)  # type: ignore[attr-defined]
    warnings.warn(
        f"{package} is read-only; compiled kernels are kept in {place}, or where NUMBA_CACHE_DIR says",
        RuntimeWarning,
        stacklevel=3,
    )


def cache_folder(kind: str) -> Path | None:
    """Return the user's folder for what can be made again, such as ``kernels``; None where none can be written.

    It is in the user's cache. Where the user has no home, or may not write there, it is in a folder of the user's own
    for temporary files.
    """
    from platformdirs import user_cache_path

    # Without a home some versions raise an error, and others return a path that begins with "~".
    with suppress(RuntimeError):
        place = user_cache_path("crowdsim") / kind
        if place.is_absolute() and _usable(place, private=False):
            return place
    place = Path(tempfile.gettempdir()) / f"crowdsim-{getattr(os, 'getuid', lambda: 0)()}" / kind
    return place if _usable(place, private=True) else None


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


def foreign_access(facts: os.stat_result, ignored: int = 0) -> str:
    """Return how others than the user and root may write to a file or a folder; an empty text where they may not.

    Args:
        facts: What the system says of it.
        ignored: Bits of its mode that do not count.
    """
    if not hasattr(os, "geteuid"):
        return ""
    if facts.st_uid not in (os.geteuid(), 0):
        return f"belongs to user {facts.st_uid}, expected user {os.geteuid()} or root"
    if facts.st_mode & ~ignored & (stat.S_IWGRP | stat.S_IWOTH):
        return f"has mode {stat.S_IMODE(facts.st_mode):o}, expected one in which others may not write"
    return ""


def cache_limit() -> int:
    """Return how large all kept kernels may be together [bytes], from ``CROWDSIM_CACHE_MB``; 1 GB by default."""
    text = os.environ.get("CROWDSIM_CACHE_MB", "").strip()
    if text.isascii() and text.isdigit():
        return int(text) * 10**6
    if text:
        warnings.warn(
            f"CROWDSIM_CACHE_MB is {text!r}, expected a whole number of megabytes; {LIMIT} is used",
            RuntimeWarning,
            stacklevel=2,
        )
    return LIMIT * 10**6


def _usable(place: Path, private: bool) -> bool:
    """Return whether a folder can be made and written, by the user alone; a private one lies in such a folder."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        shared = any(foreign_access(one.stat()) for one in ((place, place.parent) if private else (place,)))
    except OSError:
        return False
    return os.access(place, os.W_OK) and not shared
