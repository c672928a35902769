"""Hands stay over the floor, whatever the lengths of legs and arms."""

from __future__ import annotations

from crowdsim.core.workers import share
from crowdsim.crowd.model_arms import arm_radii
from crowdsim.take.kernels.hands import lift_hands
from crowdsim.take.kernels.records import Moments, Posed
from crowdsim.take.window import Window


def hold_hands(window: Window, moments: Moments, poses: Posed) -> None:
    """Lift hands that would be under the floor, in place; where legs and arms are as captured, they stay as they are.

    Args:
        window: The stretch of the take.
        moments: Who is posed, and when.
        poses: Their poses; rotations are changed.
    """
    motion, sizes = window.motion, window.rows.sizes
    if (sizes == sizes[:, :1]).all():
        return
    glove = float(arm_radii(motion.body)[1])
    share(len(moments.columns), lift_hands, moments, sizes, motion.arms, glove, poses, threads=window.threads)
