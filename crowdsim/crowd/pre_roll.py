"""The pre-roll: avatars stand on guard for some seconds before the first frame, so that a take begins in motion.

Everyone moves as in the run, but throws no strikes, and nothing hurts or happens. Then all are put back to where the
scenario places them, in the middle of what they do. Draws have a stream of their own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.random import Purpose, stream
from crowdsim.places.arrays import as_at_first


def on_guard(crowd: Crowd) -> Crowd:
    """Return a crowd as it is in its pre-roll: nothing hurts, changes or ends it, and everyone rests after strikes."""
    return replace(
        crowd,
        pre_roll=0,
        seed=int(stream(crowd.seed, Purpose.PRE_ROLL)),
        intervals=np.maximum(crowd.intervals, 1.0),
        rules=np.zeros_like(crowd.rules),
        changes=(),
        until=None,
        frames=crowd.pre_roll,
        parts=as_at_first(crowd.parts),
        targets=tuple(path.at_first() for path in crowd.targets),
    )


def take_over(avatars: Avatars, rolled: Avatars, present: int) -> Array:
    """Let avatars go on with what those of a pre-roll do, at the places where they are.

    Args:
        avatars: The avatars.
        rolled: Those of the pre-roll.
        present: How many are there, the first ones.

    Returns:
        Slots of those that are about to strike, and begin as without a pre-roll. Shape (K,), int32.
    """
    strikes = rolled.playback["pending"][rolled.slot_of[avatars.number[:present]]] != layout.NO_STRIKE
    slots = np.flatnonzero(~strikes)
    numbers = avatars.number[slots]
    source = rolled.slot_of[numbers]
    motion, playback = rolled.motion[source], rolled.playback[source]
    turn = avatars.heading[slots].astype(float) - rolled.heading[source]
    cos, sin = np.cos(turn), np.sin(turn)
    for name in ("end", "halt"):
        x, z = (motion[f"{name}_{axis}"].astype(float) - getattr(rolled, axis)[source] for axis in "xz")
        motion[f"{name}_x"] = avatars.x[slots] + x * cos + z * sin
        motion[f"{name}_z"] = avatars.z[slots] - x * sin + z * cos
    playback["base_turn"] += turn
    avatars.motion[slots], avatars.playback[slots] = motion, playback
    avatars.opponent[slots], avatars.shown[numbers] = rolled.opponent[source], rolled.shown[numbers]
    for name in ("piece", "does", "does_next") if len(avatars.conditions) else ():
        avatars.conditions[name][numbers] = rolled.conditions[name][numbers]
    return np.flatnonzero(strikes).astype(np.int32)
