"""Skins that have been built, kept in the user's cache, since building one takes most of a second."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from crowdsim.assets import sources_hash
from crowdsim.jit.environment import cache_folder
from crowdsim.jit.store import DamageError, discard, read_entry, write_entry
from crowdsim.machine import describe_machine

_MOST = 128
"""Skins that are kept; each takes about 0.4 MB."""


@cache
def _origin() -> bytes:
    """Return a digest of what decides how a skin is built beside its arguments: code, libraries, and processor."""
    parts = sources_hash(("body", "core", "motion")), np.__version__, scipy.__version__, describe_machine()["machine"]
    return hashlib.sha256(repr(parts).encode()).digest()


def kept_arrays(key: bytes, build: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return arrays and numbers that are kept under a key, or build them, and keep them where a cache can be written.

    Files are used only where they are whole, and others could not have written them.

    Args:
        key: Digest of the arguments of ``build``.
        build: Builds them.
    """
    folder = cache_folder("skins")
    if folder is None:
        return build()
    path = folder / f"{hashlib.sha256(_origin() + key).hexdigest()}.npz"
    with suppress(OSError, DamageError), np.load(io.BytesIO(read_entry(path))) as stored:
        return dict(stored)
    arrays, data = build(), io.BytesIO()
    np.savez(data, **arrays)
    # A full disk is no reason to fail.
    with suppress(OSError):
        write_entry(path, data.getvalue())
        _forget(folder)
    return arrays


def _forget(folder: Path) -> None:
    """Remove the oldest skins beyond ``_MOST``."""
    found = sorted((path.stat().st_mtime, path) for path in folder.iterdir())
    for _, path in found[:-_MOST]:
        discard(path)
