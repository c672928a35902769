"""A stretch of a take for some avatars: where each is in its motion and on the ground at any time, and its cuts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import ground
from crowdsim.take.motion import PoseMotion
from crowdsim.take.pose_kernels import measure_cuts
from crowdsim.take.take import Take

Array = NDArray[Any]

_SNAP = 1e-4
"""Part of a playback frame that counts as none, so that output frames on playback frames are those."""


@dataclass(frozen=True)
class Places:
    """Where avatars are at some times; S is the shape that was asked for.

    Attributes:
        frames: Playback frame; -1 while absent. Shape S, int32.
        fractions: How far on to the next playback frame. Shape S.
        ground: Ground transform. Shape S + (3,).
    """

    frames: Array
    fractions: Array
    ground: Array


@dataclass(frozen=True)
class Cuts:
    """Places where motion does not go on as captured, by avatar and time; C cuts of n avatars.

    Attributes:
        offsets: CSR: cuts of avatar i are ``offsets[i]:offsets[i + 1]``. Shape (n + 1,).
        owners: Avatar of each cut, a column of the window. Shape (C,).
        times: When [s]. Shape (C,).
        before: Playback frame that the cut leaves. Shape (C,).
        after: Playback frame that it goes on from. Shape (C,).
        turns: See ``measure_cuts``. Shape (C, J, 3).
        turn_rates: Likewise. Shape (C, J, 3).
        moves: Likewise. Shape (C, 2, 3).
    """

    offsets: Array
    owners: Array
    times: Array
    before: Array
    after: Array
    turns: Array
    turn_rates: Array
    moves: Array


class Window:
    """Control frames ``first`` to ``stop`` of a take for some avatars of one policy.

    Args:
        take: The take.
        motion: The policy's motion.
        avatars: Numbers of the avatars, ascending; their place here is their column.
        first: First control frame.
        stop: One past the last.
    """

    def __init__(self, take: Take, motion: PoseMotion, avatars: Array, first: int, stop: int) -> None:
        whole = len(avatars) == take.avatar_count

        def read(array: Any) -> Array:
            values = np.asarray(array[first:stop])
            return values if whole else values[:, avatars]

        self.motion, self.first, self.rate = motion, first, take.control_rate
        self.avatars = avatars
        action = read(take.action).astype(np.int64)
        self.scales = np.asarray(take.cast.scales, dtype=np.float64)[avatars]
        self.speeds = np.asarray(take.cast.speeds, dtype=np.float64)[avatars]
        self.present = action >= 0
        self.lengths = motion.lengths[np.maximum(action, 0)].astype(np.float64)
        self.origins = motion.origins[np.maximum(action, 0)]
        self.phase = np.minimum(read(take.action_frame).astype(np.float64), self.lengths)
        self.ground = np.stack([read(take.x), read(take.z), read(take.heading)], axis=-1).astype(np.float64)
        self.fresh = np.ones(action.shape, bool)
        self.fresh[1:] = (action[1:] != action[:-1]) | (self.phase[1:] < self.phase[:-1])

    def _moment(self, times: Array, columns: Array) -> tuple[Array, ...]:
        """Control frames before and after, how far between, whether the later one's action has begun, its phase."""
        clock = times * self.rate - self.first
        before = np.clip(np.floor(clock + 1e-9).astype(np.int64), 0, len(self.phase) - 1)
        after = np.minimum(before + 1, len(self.phase) - 1)
        part = np.clip(clock - before, 0.0, 1.0)
        part = np.where(part < 1e-9, 0.0, part)
        cut = self.fresh[after, columns] & (after > before)
        speeds = self.speeds[columns]
        # The action that starts at the later frame has begun before it, by as much as its phase there.
        began = np.where(cut, 1.0 - self.phase[after, columns] / speeds, 2.0)
        new = part >= began
        old_phase = np.minimum(self.phase[before, columns] + part * speeds, self.lengths[before, columns])
        new_phase = np.clip((part - began) * speeds, 0.0, self.lengths[after, columns])
        stride = self.motion.stride
        frame = np.where(
            new,
            self.origins[after, columns] + new_phase * stride,
            self.origins[before, columns] + old_phase * stride,
        )
        return before, after, part, cut, new, frame

    def frames(self, times: Array, columns: Array) -> Array:
        """Return playback frames, whole and parts, of avatars at times; -1 while absent. Arguments broadcast."""
        before, _, _, _, _, frame = self._moment(times, columns)
        return np.where(self.present[before, columns], frame, -1.0)

    def place(self, times: Array, columns: Array) -> Places:
        """Return where avatars are at times; the arguments broadcast against one another.

        Between two control frames the ground transform follows the motion from the earlier one and up to the later one;
        where the two disagree, because avatars have been pushed apart, one passes into the other.
        """
        before, after, part, cut, new, frame = self._moment(times, columns)
        whole = np.floor(frame + _SNAP).astype(np.int64)
        fraction = np.where(frame - whole < _SNAP, 0.0, frame - whole)
        exact = whole + fraction
        stride, scale = self.motion.stride, self.scales[columns]
        old_end = self.origins[before, columns] + self.lengths[before, columns] * stride
        new_start = self.origins[after, columns].astype(float)
        here = self.origins[before, columns] + self.phase[before, columns] * stride
        there = self.origins[after, columns] + self.phase[after, columns] * stride

        def step(start: Array, end: Array) -> Array:
            moved = ground.compose(ground.inverse(self._ground_at(start)), self._ground_at(end))
            moved[..., :2] *= scale[..., None]
            return moved

        over = ground.compose(step(here, old_end), step(new_start, np.where(new, exact, new_start)))
        forward = np.where(new[..., None], over, step(here, np.where(new, here, exact)))
        apart = cut & ~new
        back = ground.compose(step(there, new_start), step(old_end, np.where(new, old_end, exact)))
        backward = np.where(apart[..., None], back, step(there, np.where(apart, there, exact)))
        ahead = ground.compose(self.ground[before, columns], forward)
        gap = ground.compose(self.ground[after, columns], backward) - ahead
        gap[..., 2] = ground.wrap(gap[..., 2])
        absent = ~self.present[before, columns]
        usable = ~absent & self.present[after, columns] & (after > before)
        placed = ahead + np.where(usable[..., None], gap * part[..., None], 0.0)
        return Places(np.where(absent, -1, whole).astype(np.int32), fraction, placed)

    def _ground_at(self, frame: Array) -> Array:
        low = np.floor(frame).astype(np.int64)
        part = (frame - low)[..., None]
        high = np.minimum(low + 1, len(self.motion.ground) - 1)
        return self.motion.ground[low] * (1.0 - part) + np.where(part > 0, self.motion.ground[high] * part, 0.0)

    def cuts(self) -> Cuts:
        """Return the places where motion does not go on as captured, measured."""
        motion = self.motion
        owner, row = np.nonzero((self.fresh & self.present)[1:].T)
        row = row + 1
        was = self.present[row - 1, owner]
        owner, row = owner[was], row[was]
        before = (self.origins + self.lengths.astype(np.int64) * motion.stride)[row - 1, owner]
        after = self.origins[row, owner]
        seen = before != after
        owner, row, before, after = owner[seen], row[seen], before[seen], after[seen]
        speeds = self.speeds[owner]
        times = (self.first + row - self.phase[row, owner] / speeds) / self.rate
        joints = motion.skeleton.joint_count
        turns, turn_rates = np.empty((len(owner), joints, 3)), np.empty((len(owner), joints, 3))
        moves = np.empty((len(owner), 2, 3))
        bounds = np.stack([before, after], axis=1)
        first, last = motion.clip_first[bounds], motion.clip_last[bounds]
        measure_cuts(before, after, speeds, self.scales[owner], motion.rate, motion.rotations, motion.roots, first,
                     last, turns, turn_rates, moves)  # fmt: skip
        offsets = np.searchsorted(owner, np.arange(len(self.avatars) + 1))
        return Cuts(offsets, owner, times, before, after, turns, turn_rates, moves)
