"""Planted feet stay planted, whatever transitions and blends do to the motion above them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.poses.kernels.feet import plant_feet
from crowdsim.poses.kernels.records import Footing, Offsets, Posed
from crowdsim.poses.layer import Layer, Part

REACH = 1.25
"""How far a pose looks around its time in the take [s]."""


class Plan(NamedTuple):
    """Where feet belong, and how far pelvises go down beyond what is planned for them (T, n) [m]; written."""

    footing: Footing
    drops: Array


class Feet(Layer):
    """Brings planted feet to their positions.

    They keep their captured motion there, rotations included. Knees keep their plane; no sole goes below the floor.
    Bodies go aside and down over feet that stay, as separation and pelvis have it, and down a little more where a leg
    is too short.
    """

    name = "feet"
    size = 0.6
    reach = REACH
    hops = 1

    def plan(self, part: Part) -> Plan:
        """Return what feet do about transitions."""
        window = part.window
        footing = Footing(window.motion.frames, window.transitions, window.foot_plants, window.steps)
        return Plan(footing, np.zeros(part.playback.frames.shape))

    def apply(self, part: Part, poses: Posed) -> None:
        """Bring the feet there."""
        window, (footing, drops), count = part.window, part.plans[self.name], len(part.window.avatars)
        pushes = part.plans.get("separation") or Offsets(np.zeros((1, count, 2), np.float32), 0, 1.0)
        lows = part.plans.get("pelvis") or Offsets(np.zeros((1, count), np.float32), 0, 1.0)
        # Where it is planned how far pelvises go down, nothing reads the legs.
        reaches = "pelvis" not in part.without
        share(len(part.moments.columns), plant_feet, part.moments, part.playback, window.rows, pushes, lows, footing,
              window.motion.legs, reaches, drops, poses, threads=window.threads)  # fmt: skip
