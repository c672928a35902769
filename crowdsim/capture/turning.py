"""How joints of a body turn from frame to frame."""

from __future__ import annotations

import numpy as np

from crowdsim.capture.evidence import SIDES, unit
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array
from crowdsim.motion import quaternion

_LEAST, _ACCELERATION = np.deg2rad(5.0), np.deg2rad(14_000.0)
"""A joint has jumped that turns by so much more in one frame than in those around [rad], at any rate and by this
angular acceleration [rad/s^2] ..."""
_DROPPED = 2.5
"""... and by so many times as much: where a frame or so was dropped, it goes on, only further."""
_JOINTS = 4
"""How many joints jump at once where the whole pose is another one."""
AROUND = 3
"""Frames on each side that a step is compared with; the fastest of them may be a jump of its own."""


def directions_of_bones(reading: Reading) -> dict[int, Array]:
    """Return how joints are turned against their parents: rotations (F, 4), of limbs where bones point (F, 3).

    Limbs twist as they like where they are straight, which moves nothing.
    """
    clip, roles = reading.raw, reading.roles
    found = {roles[role]: clip.rotations[:, roles[role]] for role in ("pelvis", "spine", "chest", "neck")}
    for side in SIDES:
        for upper, lower in (("shoulder", "elbow"), ("elbow", "hand"), ("hip", "knee"), ("knee", "foot")):
            below = roles[f"{side}_{lower}"]
            while clip.skeleton.parents[below] != roles[f"{side}_{upper}"]:
                below = int(clip.skeleton.parents[below])
            if np.any(clip.skeleton.offsets[below]):
                joint = roles[f"{side}_{upper}"]
                found[joint] = unit(quaternion.rotate(clip.rotations[:, joint], clip.skeleton.offsets[below]))
    return found


def angles_between(a: Array, b: Array) -> Array:
    """Return the angles between rotations (..., 4) or directions (..., 3) [rad]."""
    dots = np.sum(a * b, axis=-1)
    return 2.0 * np.arccos(np.minimum(np.abs(dots), 1.0)) if a.shape[-1] == 4 else np.arccos(np.clip(dots, -1.0, 1.0))


def steps_around(count: int) -> Array:
    """Return the steps around each of so many, half of them on each side but at the ends. Shape (count, 6)."""
    steps = np.arange(count)[:, None]
    around = np.clip(steps - AROUND, 0, count - 1 - 2 * AROUND) + np.arange(2 * AROUND)
    return np.asarray(around + (around >= steps))


def pose_jumps(reading: Reading) -> Array:
    """Return the frames in which the whole pose is suddenly another one than in the frame before."""
    turns = np.stack([angles_between(way[:-1], way[1:]) for way in directions_of_bones(reading).values()], axis=1)
    excess = turns - _DROPPED * np.sort(turns[steps_around(len(turns))], axis=1)[:, -2]
    least = max(_LEAST, _ACCELERATION / reading.clip.fps**2)
    return np.asarray(np.flatnonzero((excess > least).sum(axis=1) >= _JOINTS) + 1)
