"""Rows of arrays on disk that are read again and again."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np

from crowdsim.core.types import Array

_AROUND, _MOST = 60, 1024
"""Rows before and after those asked for that are read along; and rows beyond which none are kept."""
_ENTRIES, _PIECE = 20_000_000, 16
"""Most entries of an array of which all rows are kept that were read; and how many rows are read at once."""


class RecentRows:
    """An array that is read from disk; the rows that were read last are kept, and of one that is not too large all.

    Args:
        array: The array.
    """

    def __init__(self, array: Any) -> None:
        self._array, self.shape, self.dtype = array, array.shape, array.dtype
        self._kept: tuple[int, Array] | None = None
        self._keeps_all = math.prod(array.shape) <= _ENTRIES
        # Memory is taken where it is written.
        self._rows = np.empty(array.shape if self._keeps_all else 0, array.dtype)
        self._lock = threading.Lock()
        self._known = np.zeros(-(-len(self) // _PIECE), bool)

    def __len__(self) -> int:
        """Return the number of rows."""
        return int(self.shape[0])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return all rows."""
        return np.asarray(self._array[:], dtype)

    def __getitem__(self, key: Any) -> Any:
        """Return rows."""
        if not isinstance(key, slice):
            return self._array[key]
        low, high, step = key.indices(len(self))
        if step != 1 or high - low > _MOST:
            return self._array[key]
        if self._keeps_all:
            pieces = slice(low // _PIECE, -(-high // _PIECE))
            if not self._known[pieces].all():
                with self._lock:
                    for piece in np.flatnonzero(~self._known[pieces]) + pieces.start:
                        some = slice(piece * _PIECE, (piece + 1) * _PIECE)
                        self._rows[some] = self._array[some]
                        # Last, since other threads read what is known.
                        self._known[piece] = True
            return self._rows[low:high]
        kept = self._kept
        if kept is None or low < kept[0] or high > kept[0] + len(kept[1]):
            first = max(low - _AROUND, 0)
            kept = self._kept = first, np.asarray(self._array[first : min(high + _AROUND, len(self))])
        return kept[1][low - kept[0] : high - kept[0]]
