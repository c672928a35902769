"""Bodies that are down rest on the floor, whatever the lengths of their legs and arms, and their girth."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules
from crowdsim.poses.kernels.columns import LOWER
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.layer import Layer, Part, Scheduler
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.world import world_joints

_UNDER, _OVER, _SOFT = 0.006, 0.004, 0.0007
"""How far a body may be under the floor, or over it and higher than captured; and how softly it is moved [m]."""
_FACES_FLOOR = 0.26
"""Least cosine of the angle between the direction of a sole that faces the floor and straight down."""
_DOWN = np.array([0.0, -1.0, 0.0])
"""Direction of a sole in the frame of its joint."""


class Floor(Layer):
    """Bodies that are down rest on the floor."""

    name = "floor"
    size = 0.4
    hops = 1

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        self._settlings = [Settling(motion) for motion in poser.motions]

    def apply(self, part: Part, poses: Posed) -> None:
        """Lay them there."""
        girths = np.asarray(self.poser.take.cast.girths, dtype=np.float64)[part.window.avatars]
        self._settlings[part.policy].settle(part, girths, poses)


class Settling:
    """Bodies of one policy that are down, at the heights at which they were captured.

    Args:
        motion: The policy's motion.
    """

    def __init__(self, motion: PoseMotion) -> None:
        self._motion = motion
        self._lowest = np.zeros(len(motion.down))
        # The last frame is mixed with the one after it.
        frames = np.flatnonzero(motion.down | np.roll(motion.down, 1))
        if len(frames):
            poses = Posed(motion.frames.roots[None, frames], motion.frames.rotations[None, frames])
            ones = np.ones(len(frames))
            self._lowest[frames] = self._lowest_points(poses, ones, ones, np.ones((len(frames), 3)))

    def settle(self, part: Part, girths: Array, poses: Posed) -> None:
        """Raise bodies that are down out of the floor, and lower those that are over it, in place.

        Args:
            part: The avatars.
            girths: Girth of each in the window. Shape (n,).
            poses: Their poses; roots are changed.
        """
        scales, playback = part.window.rows.scales, part.playback
        stretches = part.window.rows.sizes / scales[:, None]
        frames = np.maximum(playback.frames, 0)
        down = (playback.frames >= 0) & self._motion.down[frames]
        if not down.any():
            return
        row, column = np.nonzero(down)
        some = part.moments.columns[column]
        here = Posed(poses.roots[None, row, column], poses.rotations[None, row, column])
        lowest = self._lowest_points(here, scales[some], girths[some], stretches[some])
        frame, share = frames[down], playback.fractions[down]
        after = np.minimum(frame + 1, len(self._lowest) - 1)
        captured = scales[some] * (self._lowest[frame] * (1.0 - share) + self._lowest[after] * share)
        raised = _beyond(-lowest, _UNDER)
        poses.roots[row, column, 1] += raised - _beyond(lowest - np.maximum(captured, 0.0), _OVER)

    def _lowest_points(self, poses: Posed, scales: Array, girths: Array, stretches: Array) -> Array:
        """Return the height of the lowest point of bodies (n,), feet that stand by their soles [m]."""
        motion, count = self._motion, len(scales)
        body = motion.body
        positions, rotations = world_joints(motion.skeleton, motion.segments, scales, stretches, poses)
        posed = PosedBodies(body, np.arange(count), scales, girths, stretches, positions, rotations)
        capsules = place_capsules([posed], 1, count)
        low = np.minimum(
            *(ends[0, ..., 1] - capsules.radii[..., k] for k, ends in enumerate((capsules.starts, capsules.ends)))
        )
        # Where a sole faces the floor, heel and ball are on it and toes bend.
        feet, order = motion.legs.joints[:, LOWER], body.capsule_joints[capsule_order(body)]
        turned = rotations[0][:, feet]
        soles = quaternion.rotate(turned[:, :, None], body.sole_offsets)[..., 1].min(axis=2) * scales[:, None]
        soles += positions[0][:, feet, 1]
        faces = quaternion.rotate(turned, _DOWN)[..., 1] < -_FACES_FLOOR
        for foot, joint in enumerate(feet):
            shoes = order == joint
            low[:, shoes] = np.where(faces[:, foot, None], soles[:, foot, None], low[:, shoes])
        return np.asarray(low.min(axis=1), dtype=float)


def _beyond(ways: Array, least: float) -> Array:
    """Return what of some ways (n,) is beyond the least, smoothly [m]."""
    return np.asarray(_SOFT * np.logaddexp(0.0, (ways - least) / _SOFT))
