"""How far pelvises go down, at each control frame of a take, where legs are too short for planted feet."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import maximum_filter1d

from crowdsim.core.types import Array
from crowdsim.take.data import TakeData
from crowdsim.take.feet import hold_feet
from crowdsim.take.kernels.records import Moments, Playback, Posed, Transitions
from crowdsim.take.window import Window

_WHOLE = 4_000_000
"""Rows of a take of no more avatar-frames than this are kept."""
_WIDE, _FINE = 1, 2
"""How long a pelvis stays down before and after it has to be, so that splines reach nearly as far down [control
frames]; and times at which it is looked for in one, since legs are too short for a few hundredths of a second."""
_POSES_AT_ONCE = 16_000


class Lowering:
    """How far pelvises go down.

    Legs that are too short for a moment would pull the pelvis down suddenly; it goes down evenly around that moment.

    Args:
        take: The take.
        window: Returns the stretch of the take for avatars (n,), ascending, of a policy, given by its number, at times
            (T,), without what is found here.
        blend: Poses avatars with blends alone.
    """

    def __init__(
        self,
        take: TakeData,
        window: Callable[[int, Array, Array], Window],
        blend: Callable[[Window, Transitions, Playback, Moments], Posed],
    ) -> None:
        self._take, self._window, self._blend = take, window, blend
        self._is_short = take.frame_count * take.avatar_count <= _WHOLE
        self._kept: dict[int, Array] = {}

    def rows(self, first: int, stop: int, avatars: Array) -> Array:
        """Return how far pelvises of avatars (n,) go down at control frames ``first`` to ``stop`` [m]. Shape (T, n)."""
        low, high = max(first - _WIDE, 0), min(stop + _WIDE, self._take.frame_count)
        if not self._is_short:
            lacks = self._find_some(np.arange(low, high), avatars)
        else:
            missing = np.array([row for row in range(low, high) if row not in self._kept], np.int64)
            if len(missing):
                found = self._find_some(missing, np.arange(self._take.avatar_count))
                self._kept.update(zip(missing.tolist(), found, strict=True))
            lacks = np.stack([self._kept[row][avatars] for row in range(low, high)])
        lows = maximum_filter1d(lacks, 2 * _WIDE + 1, axis=0, mode="nearest")
        return np.asarray(lows[first - low : stop - low])

    def _find_some(self, rows: Array, avatars: Array) -> Array:
        """Find the most about control frames (R,) for avatars (n,), some at once. Shape (R, n), float32."""
        lacks = np.zeros((len(rows), len(avatars)), np.float32)
        frames = max(1, _POSES_AT_ONCE // (2 * _FINE * max(len(avatars), 1)))
        for low in range(0, len(rows), frames):
            for at in range(0, len(avatars), _POSES_AT_ONCE):
                here = slice(low, low + frames), slice(at, at + _POSES_AT_ONCE)
                lacks[here] = self._most_about(rows[here[0]], avatars[here[1]])
        return lacks

    def _most_about(self, rows: Array, avatars: Array) -> Array:
        """The most about control frames (R,) for avatars (n,). Shape (R, n)."""
        around = np.arange(-(_FINE // 2), _FINE // 2 + 1)
        wanted = np.clip(rows[:, None] * _FINE + around, 0, (self._take.frame_count - 1) * _FINE)
        moments, where = np.unique(wanted, return_inverse=True)
        found = self._find(avatars, moments / (_FINE * self._take.control_rate))
        return np.asarray(found[where.reshape(wanted.shape)].max(axis=1))

    def _find(self, avatars: Array, times: Array) -> Array:
        """How far pelvises of avatars (n,), ascending, would have to go down at times (T,) [m]. Shape (T, n)."""
        owners, lacks = self._take.cast.policies[avatars], np.zeros((len(times), len(avatars)), np.float32)
        for index in np.unique(owners):
            which = np.flatnonzero(owners == index)
            window = self._window(int(index), avatars[which], times)
            moments = Moments(np.arange(len(which)), times[:, None])
            playback, transitions = window.playback(moments), window.transitions()
            poses = self._blend(window, transitions, playback, moments)
            lacks[:, which] = hold_feet(window, transitions, playback, moments, poses)
        return lacks
