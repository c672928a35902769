"""Where compiled kernels are kept, and how numba is loaded; neither needs numba itself."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent


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


def _usable(place: Path, private: bool) -> bool:
    """Return whether a folder can be made and written; a private one must be the user's alone."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        facts = place.parent.stat()
    except OSError:
        return False
    own = not hasattr(os, "getuid") or (facts.st_uid == os.getuid() and not facts.st_mode & stat.S_IWOTH)
    return os.access(place, os.W_OK) and (own or not private)
