"""Planted feet stay planted, whatever cuts and blends do to the motion above them."""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from crowdsim.take.limb_kernels import plant_feet
from crowdsim.take.window import Cuts, Places, Stands, Window
from crowdsim.take.workers import share

Array = NDArray[Any]

STAND = 0.55
"""How far before and after a time a planted foot's mean place is taken [s]."""
_EVEN = 0.55
"""Part of that over which every moment counts the same."""
SWING = 0.14
"""How long it takes to let go of a foot, or to lead it to where it lands [s]."""
_ALONG = 0.8
_ASIDE, _DOWN = 0.15, 0.1
_FLOOR = 0.008
KNEE_LEAST = math.radians(4.0)
"""Flexion that a knee keeps at the least when it is stretched to hold a foot [rad]."""


def hold_feet(
    window: Window,
    cuts: Cuts,
    stands: Stands,
    places: Places,
    times: Array,
    columns: Array,
    wide: float,
    roots: Array,
    rotations: Array,
) -> None:
    """Bring planted feet to where they belong, in place.

    Feet keep their turn in the world and knees their plane; no sole goes below the floor. The pelvis goes along with
    what both feet ask for, and down a little where a leg is too short.

    Args:
        window: The stretch of the take.
        cuts: Its cuts.
        stands: When feet are planted.
        places: Where the avatars are.
        times: Shape (T, n) or (T, 1) [s].
        columns: Column of each avatar. Shape (n,).
        wide: ``STAND``, or less at a low control rate [s].
        roots: Places of the roots [m]. Shape (T, n, 3), changed.
        rotations: Local rotations. Shape (T, n, J, 4), changed.
    """
    motion, rows = window.motion, window.rows
    how = (_EVEN * wide, wide, SWING, _ALONG, _ASIDE, _DOWN, KNEE_LEAST, _FLOOR)

    def work(low: int, high: int) -> None:
        plant_feet(low, high, columns, times, places.frames, places.fractions, places.ground, motion.frames, cuts,
                   stands, rows.rate, rows.scales, motion.legs, how, roots, rotations)  # fmt: skip

    share(window.threads, len(columns), work)
