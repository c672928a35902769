"""Planted feet stay planted, whatever cuts and blends do to the motion above them."""

from __future__ import annotations

import math

from crowdsim.core.types import Array
from crowdsim.take.limb_kernels import plant_feet
from crowdsim.take.window import Cuts, Places, Window
from crowdsim.take.workers import share

WIDE = 0.9
"""How far from a cut feet move for it [s]."""
SWING = 0.15
"""How long it takes to let go of a foot, or to lead it to where it lands [s]."""
PASS = 0.2
"""Time between two stands in which a foot is led from one to the other [s]."""
_MOST = (0.4, 0.6)
"""How far feet are moved from where blends have them before they are moved less, and at the most [m]."""
_DOWN = 0.1
_SLACK, _FLOOR, _UNDER = 0.02, 0.00003, 0.0003
KNEE_LEAST = math.radians(4.0)
"""Flexion that a knee keeps at the least when it is stretched to hold a foot [rad]."""


def hold_feet(
    window: Window,
    cuts: Cuts,
    places: Places,
    times: Array,
    columns: Array,
    roots: Array,
    rotations: Array,
) -> None:
    """Bring planted feet to where they belong, in place.

    They keep what the capture has them do there, turns and all. Knees keep their plane; no sole goes below the floor.
    The pelvis goes down a little where a leg is too short.

    Args:
        window: The stretch of the take.
        cuts: Its cuts.
        places: Where the avatars are.
        times: Shape (T, n) or (T, 1) [s].
        columns: Column of each avatar. Shape (n,).
        roots: Places of the roots [m]. Shape (T, n, 3), changed.
        rotations: Local rotations. Shape (T, n, J, 4), changed.
    """
    motion, rows = window.motion, window.rows
    stands = window.stands()
    falls = window.falls(cuts, stands)
    how = (WIDE, SWING, PASS, *_MOST, _DOWN, KNEE_LEAST, _SLACK, _FLOOR, _UNDER)

    def work(low: int, high: int) -> None:
        plant_feet(low, high, columns, times, places.frames, places.fractions, places.ground, motion.frames, cuts,
                   stands, falls, rows.rate, rows.scales, rows.speeds, motion.legs, how, roots, rotations)  # fmt: skip

    share(window.threads, len(columns), work)
