"""How far pelvises go down, at each control frame of a take, where legs are too short for planted feet."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.poses.kept import Kept
from crowdsim.poses.kernels.records import Offsets
from crowdsim.poses.layer import Block, Layer, Part, Scheduler
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.smoothing import highest

_WIDE, _FINE = 1, 2
"""How long a pelvis stays down before and after it has to be, so that splines reach nearly as far down [control
frames]; and times at which it is looked for in one, since legs are too short for a few hundredths of a second."""
_FRAMES_AT_ONCE = 512


class Lowering(Layer):
    """How far pelvises go down.

    Legs that are too short for a moment would pull the pelvis down suddenly; it goes down evenly around that moment, as
    ``feet`` has it. It is planned from poses that separation has moved.
    """

    name = "pelvis"
    size = 0.04
    needs = ("separation",)
    hops = 1

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        take = poser.take
        self.lacks = Kept(take.frame_count, take.control_rate, take.avatar_count, (), self._find)

    def plan(self, part: Part) -> Offsets:
        """Return how far pelvises go down [m]."""
        frames, moments, avatars = self.lacks.around(*part.span), part.moments, part.window.avatars
        first, stop = int(frames[0]), int(frames[-1]) + 1
        if moments.times.shape[1] == 1:
            return Offsets(self.rows(first, stop, avatars), first, self.lacks.rate)
        assert len(moments.times) == 1
        # Each at its own time: what splines read around that, of which there is none beyond the last control frame.
        before = np.minimum((moments.times[0] * self.lacks.rate).astype(np.int64), self.lacks.frames)
        own = np.clip(before + np.arange(-1 - _WIDE, 3 + _WIDE)[:, None], 0, self.lacks.frames - 1)
        lacks = self.lacks.around_each(own, avatars[moments.columns], avatars, self._find_each)
        lows = highest(lacks, _WIDE)[first - int(own.min()) :]
        return Offsets(lows[: stop - first], first, self.lacks.rate)

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

            self.poser.stretch(note, avatars, times, "feet", (self.name,), self._legs())
        return found

    def _find_each(self, frames: Array, avatars: Array) -> Array:
        """Find the same about control frames (T, n) of avatars (n,), each at its own. Shape (T, n)."""
        found = np.empty(frames.shape, np.float32)
        last, begin = (self.poser.take.frame_count - 1) * _FINE, frames[0] * _FINE - _FINE // 2
        moments = np.clip(begin + np.arange(_FINE * len(frames) + 1)[:, None], 0, last)
        times = moments / (_FINE * self.poser.take.control_rate)
        where = np.clip(_FINE * frames + np.arange(-(_FINE // 2), _FINE // 2 + 1)[:, None, None], 0, last) - begin
        for part, some in self.poser.each_at(avatars, times, "feet", (self.name,), self._legs()):
            self.poser.pose(part)
            drops = part.plans["feet"].drops.astype(np.float32)
            found[:, some] = np.take_along_axis(drops[None], where[:, :, some], axis=1).max(axis=0)
        return found

    def _legs(self) -> list[PoseMotion]:
        """The motion of legs alone, policy by policy."""
        return [motion.of_legs for motion in self.poser.motions]
