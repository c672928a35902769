"""What is known of avatars at frames of a grid, worked out when it is asked for, and kept."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

import numpy as np

from crowdsim.core.types import Array
from crowdsim.poses.kernels.records import Offsets

_NUMBERS, _FRAMES = 4_000_000, 64
"""Numbers that are kept at the most; and frames that are kept however many avatars there are."""


class Kept:
    """Numbers for each avatar and frame; several threads may ask for them.

    Args:
        frames: Frames of the grid.
        rate: Frames a second.
        avatars: Avatars of the take.
        shape: Shape of the numbers of an avatar at a frame.
        find: Returns the numbers of avatars (n,), ascending, at frames (T,), ascending. Shape (T, n, *shape).
    """

    def __init__(
        self, frames: int, rate: float, avatars: int, shape: tuple[int, ...], find: Callable[[Array, Array], Array]
    ) -> None:
        self.frames, self.rate, self._find = frames, rate, find
        self._most = max(_NUMBERS // max(avatars * math.prod(shape), 1), _FRAMES)
        self._first, self._lock = 0, threading.RLock()
        self._values = np.zeros((0, avatars, *shape), np.float32)
        self._known = np.zeros((0, avatars), bool)

    def around(self, first: float, last: float) -> Array:
        """Return the frames that splines read from a time to another one [s]; the last one beyond the end."""
        low, high = max(int(first * self.rate) - 1, 0), min(int(last * self.rate) + 3, self.frames)
        return np.arange(min(low, self.frames - 1), high)

    def track(self, first: float, last: float, avatars: Array) -> Offsets:
        """Return the numbers of avatars (n,), as splines read them from a time to another one [s]."""
        frames = self.around(first, last)
        return Offsets(self.rows(frames, avatars), int(frames[0]), self.rate)

    def rows(self, frames: Array, avatars: Array) -> Array:
        """Return the numbers of avatars (n,) at frames (T,), both ascending. Shape (T, n, *shape), float32."""
        while True:
            with self._lock:
                frames_missing, avatars_missing = self.missing(frames, avatars)
                if not len(frames_missing):
                    return self._some(self._values, frames, avatars).copy()
            # Another thread may look for the same, and finds the same.
            self.note(frames_missing, avatars_missing, self._find(frames_missing, avatars_missing))

    def around_each(self, frames: Array, avatars: Array, asked: Array, find: Callable[[Array, Array], Array]) -> Array:
        """Return the numbers of avatars (m,) at all frames from the first to the last of some, where they are known.

        Args:
            frames: Frames at which they are known, ascending for each avatar. Shape (T, n).
            avatars: Which avatar at each, of those asked for; one may be there several times. Shape (n,).
            asked: The avatars. Shape (m,).
            find: Returns the numbers of avatars (n,) at frames (T, n), each at its own. Shape (T, n, *shape).
        """
        first, stop = int(frames.min()), int(frames.max()) + 1
        while True:
            with self._lock:
                self._hold(first, stop)
                missing = ~self._known[frames - self._first, avatars].all(axis=0)
                if not missing.any():
                    return np.ascontiguousarray(self._values[first - self._first : stop - self._first, asked])
            self.note(frames[:, missing], avatars[missing], find(frames[:, missing], avatars[missing]))

    def missing(self, frames: Array, avatars: Array) -> tuple[Array, Array]:
        """Return which of frames and avatars, both ascending, are not known all of them."""
        with self._lock:
            self._hold(int(frames[0]), int(frames[-1]) + 1)
            known = self._some(self._known, frames, avatars)
            if known.all():
                return frames[:0], avatars[:0]
        rows = ~known.all(axis=1)
        return frames[rows], avatars[~known[rows].all(axis=0)]

    def note(self, frames: Array, avatars: Array, found: Array) -> None:
        """Keep the numbers of avatars (n,) at frames (T,), or (T, n) of their own."""
        with self._lock:
            self._hold(int(frames.min()), int(frames.max()) + 1)
            rows = frames.reshape(len(frames), -1) - self._first
            self._values[rows, avatars] = found
            self._known[rows, avatars] = True

    def _some(self, values: Array, frames: Array, avatars: Array) -> Array:
        """Return values of frames (T,) and avatars (n,), both ascending; a view where these are all that follow."""
        first, stop = int(frames[0]) - self._first, int(frames[-1]) + 1 - self._first
        rows = values[first:stop] if stop - first == len(frames) else values[frames - self._first]
        return rows if len(avatars) == rows.shape[1] else rows[:, avatars]

    def _hold(self, low: int, high: int) -> None:
        """Make room for frames ``low`` to ``high``, and drop others where there are too many."""
        before, until = self._first, self._first + len(self._known)
        if before <= low and high <= until:
            return
        if self.frames <= self._most:
            first, stop = 0, self.frames
        elif low >= before:
            first, stop = (low if low > until else min(low, max(before, high - self._most))), high
        else:
            first, stop = low, max(high, min(until, low + self._most))
        values = np.zeros((stop - first, *self._values.shape[1:]), np.float32)
        known = np.zeros((stop - first, self._known.shape[1]), bool)
        low, high = max(first, before), min(stop, until)
        if low < high:
            values[low - first : high - first] = self._values[low - before : high - before]
            known[low - first : high - first] = self._known[low - before : high - before]
        self._first, self._values, self._known = first, values, known
