"""The grid of the behaviour ``defend``: what an avatar sees coming at it, or how far away whoever may strike is.

Its axes are when a strike in progress reaches furthest, whether above the neck or below, and on which side; where none
can be seen, the distance.
"""

SOON = (3.0, 6.0)
"""Where its axis of time is divided [control frames]."""
ASIDE = 0.06
"""How far to a side a strike ends that comes from there, on a body of scale 1 [m]."""
DISTANCES = (0.75, 0.95, 1.2)
"""Where its axis of distance is divided, on a body of scale 1 [m]."""
SIDES, HEIGHTS = 3, 2
SEEN_CELLS = (len(SOON) + 1) * HEIGHTS * SIDES
"""Cells of strikes in progress: by time, then height, then side (right, ahead, left)."""
CELLS = SEEN_CELLS + len(DISTANCES) + 1
"""All cells; behind those of strikes there is one for each distance."""
