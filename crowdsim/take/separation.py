"""How far trunks and heads give way to others that lean into them, at each control frame of a take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.take.data import TakeData
from crowdsim.take.kernels.separation import push_trunks
from crowdsim.take.motion import PoseMotion

_KEPT, _FRAMES_KEPT = 8_000_000, 64
"""Avatar-frames whose pushes are kept, and control frames of larger crowds."""


class Separation:
    """Pushes of trunks, worked out for whole control frames when they are asked for, and kept for a while.

    What an avatar gives way at a control frame depends on where the avatars near it are in their motion and on the
    ground, from a frame before to a frame after.

    Args:
        take: The take.
        motions: The motion of each of its policies.
    """

    def __init__(self, take: TakeData, motions: Sequence[PoseMotion]) -> None:
        self._take, self._motions = take, motions
        self._kept: dict[int, Array] = {}
        self._most = max(_FRAMES_KEPT, _KEPT // max(take.avatar_count, 1))
        self._radii = np.zeros((take.avatar_count, 2))
        for index, motion in enumerate(motions):
            mine = take.cast.policies == index
            self._radii[mine] = [motion.body.head_radius, motion.body.torso_radius]
        self._radii *= np.asarray(take.cast.scales, dtype=float)[:, None]

    def rows(self, first: int, stop: int, avatars: Array) -> Array:
        """Return how far trunks of avatars (n,) give way at control frames, x and z [m]. Shape (R, n, 2)."""
        if not self._take.collision_avoidance:
            return np.zeros((stop - first, len(avatars), 2))
        low, high = max(first - 1, 0), min(stop + 1, self._take.frame_count)
        frames = self._frames(low, high)
        return _widest(np.stack([frame[avatars] for frame in frames]))[first - low : stop - low].astype(float)

    def _frames(self, first: int, stop: int) -> list[Array]:
        """Return the pushes of all avatars at control frames. Shape (N, 2) each, float32."""
        missing = [frame for frame in range(first, stop) if frame not in self._kept]
        found = {frame: self._kept[frame] for frame in range(first, stop) if frame in self._kept}
        if missing:
            low, high = missing[0], missing[-1] + 1
            for frame, pushes in enumerate(self._find(low, high), low):
                found[frame] = self._kept[frame] = pushes
        for frame in list(self._kept)[: max(len(self._kept) - self._most, 0)]:
            self._kept.pop(frame, None)
        return [found[frame] for frame in range(first, stop)]

    def _find(self, first: int, stop: int) -> Array:
        points = self._points(first, stop)
        pushes = np.empty((*points.shape[:2], 2), np.float32)
        order = np.argsort(points[:, :, 2, 0], axis=1, kind="stable")
        push_trunks(points, self._radii, order, pushes)
        return pushes

    def _points(self, first: int, stop: int) -> Array:
        """Heads, necks and pelvises in the world at control frames. Shape (T, N, 3, 3)."""
        take = self._take
        action, done = np.asarray(take.action[first:stop]), np.asarray(take.action_frame[first:stop], dtype=float)
        place = np.stack([np.asarray(values[first:stop], dtype=float) for values in (take.x, take.z, take.heading)], -1)
        points = np.full((*action.shape, 3, 3), np.nan)
        for index, motion in enumerate(self._motions):
            here = (action >= 0) & (take.cast.policies == index)
            some = action[here]
            frames = motion.origins[some] + np.rint(
                np.minimum(done[here], motion.lengths[some]) * motion.frames.stride
            ).astype(np.int64)
            sizes = np.broadcast_to(take.cast.scales, action.shape)[here][:, None, None]
            points[here] = ground.to_world(place[here][:, None], motion.trunks[frames].astype(float) * sizes)
        return points


def _widest(pushes: Array) -> Array:
    """The longest push of each frame, the one before and the one after, since what poses read is smoothed."""
    longest, length = pushes.copy(), np.sum(pushes**2, axis=-1)
    for one, other in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        further = length[other] > np.sum(longest[one] ** 2, axis=-1)
        longest[one] = np.where(further[..., None], pushes[other], longest[one])
    return longest
