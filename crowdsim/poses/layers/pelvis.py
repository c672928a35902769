"""How far pelvises go down, at each control frame of a take, where legs are too short for planted feet."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.poses.kept import Kept
from crowdsim.poses.kernels.records import Offsets
from crowdsim.poses.layer import Block, Layer, Part, Scheduler
from crowdsim.poses.smoothing import highest

_WIDE, _FINE = 1, 2
"""How long a pelvis stays down before and after it has to be, so that splines reach nearly as far down [control
frames]; and times at which it is looked for in one, since legs are too short for a few hundredths of a second."""
_FRAMES_AT_ONCE = 512


class Lowering(Layer):
    """How far pelvises go down.

    Legs that are too short for a moment would pull the pelvis down suddenly; it goes down evenly around that moment, as
    ``feet`` has it.
    """

    name = "pelvis"
    size = 0.075
    hops = 1

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        take = poser.take
        self.lacks = Kept(take.frame_count, take.control_rate, take.avatar_count, (), self._find)

    def plan(self, part: Part) -> Offsets:
        """Return how far pelvises go down [m]."""
        frames = self.lacks.around(*part.span)
        lows = self.rows(int(frames[0]), int(frames[-1]) + 1, part.window.avatars)
        return Offsets(lows, int(frames[0]), self.lacks.rate)

    def rows(self, first: int, stop: int, avatars: Array) -> Array:
        """Return how far pelvises of avatars (n,) go down at control frames ``first`` to ``stop`` [m]. Shape (T, n)."""
        low, high = max(first - _WIDE, 0), min(stop + _WIDE, self.poser.take.frame_count)
        lacks = self.lacks.rows(np.arange(low, high), avatars)
        return highest(lacks, _WIDE)[first - low : stop - low]

    def _find(self, frames: Array, avatars: Array) -> Array:
        """Find how far pelvises of avatars (n,) would have to go down about control frames (T,). Shape (T, n)."""
        found = np.empty((len(frames), len(avatars)), np.float32)
        last, around = (self.poser.take.frame_count - 1) * _FINE, np.arange(-(_FINE // 2), _FINE // 2 + 1)
        for low in range(0, len(frames), _FRAMES_AT_ONCE):
            wanted = np.clip(frames[low : low + _FRAMES_AT_ONCE, None] * _FINE + around, 0, last)
            moments, where = np.unique(wanted, return_inverse=True)
            times = moments / (_FINE * self.poser.take.control_rate)
            rows, where = slice(low, low + len(wanted)), where.reshape(wanted.shape)

            def note(block: Block, rows: slice = rows, where: Array = where) -> None:
                found[rows, block.which] = block.part.plans["feet"].drops.astype(np.float32)[where].max(axis=1)

            self.poser.stretch(note, avatars, times, "feet", (self.name,))
        return found
