"""The cells of the table of ``defend``: how far away an attacker is of which no strike can be seen yet."""

DISTANCES = (0.75, 0.95, 1.2)
"""Where the distance is divided, on a body of scale 1 [m]."""
CELLS = len(DISTANCES) + 1
"""Cells of the table, one for each distance."""
