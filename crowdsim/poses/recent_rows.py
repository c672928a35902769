"""Rows of arrays on disk that are read again and again."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from crowdsim.core.types import Array

_AROUND, _MOST = 60, 1024
"""Rows before and after those asked for that are read along; and rows beyond which none are kept."""
_ENTRIES = 20_000_000
"""Most entries that are kept, but for those of a stretch that is asked for and the rows around it."""


class RecentRows:
    """An array that is read from disk; the rows that were read last are kept.

    Args:
        array: The array.
    """

    def __init__(self, array: Any) -> None:
        self._array, self.shape, self.dtype = array, array.shape, array.dtype
        self._kept: tuple[int, Array] | None = None

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
        kept = self._kept
        if kept is None or low < kept[0] or high > kept[0] + len(kept[1]):
            kept = self._kept = self._read(kept, max(low - _AROUND, 0), min(high + _AROUND, len(self)))
        return kept[1][low - kept[0] : high - kept[0]]

    def _read(self, kept: tuple[int, Array] | None, first: int, stop: int) -> tuple[int, Array]:
        """Return rows from ``first`` to ``stop``, and those beside them that are kept as far as there is room."""
        begin, rows = kept or (first, np.empty((0, *self.shape[1:]), self.dtype))
        end, room = begin + len(rows), _ENTRIES // max(math.prod(self.shape[1:]), 1)
        if first > end or stop < begin:
            return first, np.asarray(self._array[first:stop])
        low, high = max(min(begin, first), stop - room), min(max(end, stop), first + room)
        low, high = min(low, first), max(high, stop)
        parts = [np.asarray(self._array[low:begin])] if low < begin else []
        parts.append(rows[max(low - begin, 0) : high - begin])
        parts += [np.asarray(self._array[end:high])] if high > end else []
        return low, np.concatenate(parts)
