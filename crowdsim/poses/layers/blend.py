"""Captured motion, and what blends add to it around transitions."""

from __future__ import annotations

from crowdsim.core.workers import share
from crowdsim.poses.kernels.blending import BLEND, blend_poses
from crowdsim.poses.kernels.records import Posed, Transitions
from crowdsim.poses.layer import Layer, Part


class Blend(Layer):
    """Writes poses, from which the other layers go on."""

    name = "blend"
    reach = BLEND

    def plan(self, part: Part) -> Transitions:
        """Return the transitions."""
        return part.window.transitions

    def apply(self, part: Part, poses: Posed) -> None:
        """Write captured motion with its blends."""
        window, transitions = part.window, part.plans[self.name]
        share(len(part.moments.columns), blend_poses, part.moments, part.playback, window.rows, window.motion.frames,
              transitions, window.motion.hinges, poses, threads=window.threads)  # fmt: skip
