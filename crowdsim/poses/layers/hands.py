"""Hands stay over the floor, whatever the lengths of legs and arms."""

from __future__ import annotations

from crowdsim.core.workers import share
from crowdsim.crowd.model_arms import arm_radii
from crowdsim.poses.kernels.hands import lift_hands
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.layer import Layer, Part


class Hands(Layer):
    """Lifts hands that would be under the floor; where legs and arms are as captured, they stay as they are."""

    name = "hands"
    size = 0.4
    hops = 1

    def apply(self, part: Part, poses: Posed) -> None:
        """Lift them."""
        motion, sizes = part.window.motion, part.window.rows.sizes
        if (sizes == sizes[:, :1]).all():
            return
        glove = float(arm_radii(motion.body)[1])
        share(len(part.moments.columns), lift_hands, part.moments, sizes, motion.arms, glove, poses,
              threads=part.window.threads)  # fmt: skip
