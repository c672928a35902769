"""What is known of all avatars at control frames, worked out when it is asked for, and kept."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from crowdsim.core.types import Array

_WHOLE = 4_000_000
"""A take of no more avatar-frames than this is worked out at once."""
_FRAMES = 64
"""Control frames that are kept of a longer one."""


class KeptRows:
    """Numbers for each avatar and control frame of a take.

    Args:
        frames: Control frames of the take.
        avatars: Avatars of the take.
        find: Returns the numbers of all avatars at control frames ``first`` to ``stop``. Shape
            (T, N, k).
    """

    def __init__(self, frames: int, avatars: int, find: Callable[[int, int], Array]) -> None:
        self._frames, self._find, self._is_short = frames, find, frames * avatars <= _WHOLE
        self._whole: Array | None = None
        self._kept: dict[int, Array] = {}

    def rows(self, first: int, stop: int, avatars: Array) -> Array:
        """Return the numbers of avatars (n,) at control frames ``first`` to ``stop``. Shape (T, n, k), float32."""
        if self._is_short:
            if self._whole is None:
                self._whole = self._find(0, self._frames).astype(np.float32)
            return np.ascontiguousarray(self._whole[first:stop, avatars])
        found = {frame: self._kept[frame] for frame in range(first, stop) if frame in self._kept}
        missing = [frame for frame in range(first, stop) if frame not in found]
        if missing:
            for frame, numbers in enumerate(self._find(missing[0], missing[-1] + 1), missing[0]):
                found[frame] = self._kept[frame] = numbers.astype(np.float32)
        for frame in list(self._kept)[: max(len(self._kept) - _FRAMES, 0)]:
            self._kept.pop(frame, None)
        return np.stack([found[frame][avatars] for frame in range(first, stop)])
