"""Planted feet stay planted, whatever transitions and blends do to the motion above them."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.take.kernels.feet import plant_feet
from crowdsim.take.kernels.records import Footing, Moments, Playback, Posed, Transitions
from crowdsim.take.window import Window


def hold_feet(window: Window, transitions: Transitions, playback: Playback, moments: Moments, poses: Posed) -> Array:
    """Bring planted feet to their positions, in place.

    They keep their captured motion there, rotations included. Knees keep their plane; no sole goes below the
    floor. The pelvis goes down a little where a leg is too short.

    Args:
        window: The stretch of the take.
        transitions: Its transitions.
        playback: Where the avatars are.
        moments: Who is posed, and when.
        poses: Their poses, changed.

    Returns:
        How far pelvises go down beyond what the window has for them [m]. Shape (T, n).
    """
    motion = window.motion
    plants = window.foot_plants()
    footing = Footing(motion.frames, transitions, plants, window.steps(transitions, plants))

    drops = np.zeros(playback.frames.shape)

    def work(low: int, high: int) -> None:
        plant_feet(low, high, moments, playback, window.rows, footing, motion.legs, drops, poses)

    share(len(moments.columns), work, threads=window.threads)
    return drops
