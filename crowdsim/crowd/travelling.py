"""Avatars that travel along paths: they enter, or go away, and are led from point to point."""

from __future__ import annotations

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, positions_of
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.entering import entries_of
from crowdsim.crowd.kernels import layout

ARRIVED = 0.7
"""How near to a point of its path an avatar goes on to the next [m]."""
GONE = 1.2
"""How near to the end of its path an avatar that goes away leaves [m]."""
PASSED = 3.0
"""How near to it one that has passed it does so [m]."""


def set_out(crowd: Crowd, avatars: Avatars, numbers: Array, travel: int, leg: int) -> None:
    """Let avatars travel along a path.

    Args:
        crowd: The crowd.
        avatars: Its avatars; changed.
        numbers: Numbers of the avatars that travel. Shape (n,).
        travel: Index of the path.
        leg: Which of its points they go to first.
    """
    rows = avatars.conditions[numbers]
    rows["mode"], rows["pace"] = layout.TRAVELS, crowd.travels[travel].pace
    rows["travel"], rows["leg"] = travel + 1, leg
    avatars.conditions[numbers] = rows
    _show_way(crowd, avatars, numbers)


def travel_on(crowd: Crowd, avatars: Avatars, present: int) -> Array:
    """Lead avatars that have come to a point of their path on to the next; at its end they fight, or leave.

    Args:
        crowd: The crowd.
        avatars: Its avatars; changed.
        present: How many are there.

    Returns:
        Numbers of those that leave, ascending. Shape (n,).
    """
    here = np.sort(avatars.number[:present])
    travellers = here[avatars.conditions["mode"][here] == layout.TRAVELS]
    leaving: list[int] = []
    for index in np.unique(avatars.conditions["travel"][travellers]).astype(int) - 1:
        travel = crowd.travels[index]
        numbers = travellers[avatars.conditions["travel"][travellers] == index + 1]
        leg = avatars.conditions["leg"][numbers].astype(int)
        way = np.column_stack([avatars.conditions["way_x"][numbers], avatars.conditions["way_z"][numbers]])
        slots = avatars.slot_of[numbers]
        beyond = positions_of(avatars, slots) - way
        far = np.linalg.norm(beyond, axis=1)
        before = travel.points[np.maximum(leg - 1, 0)]
        has_passed = (leg > 0) & (far <= PASSED) & (np.sum(beyond * (way - before), axis=1) > 0.0)
        near = np.where(travel.leaves & (leg == len(travel.points) - 1), GONE, ARRIVED)
        arrived = numbers[(far <= near) | has_passed]
        avatars.conditions["leg"][arrived] += 1
        is_done = avatars.conditions["leg"][arrived] >= len(travel.points) + travel.forms_up
        _show_way(crowd, avatars, arrived[~is_done])
        halt(avatars, arrived[is_done])
        leaving += arrived[is_done].tolist() if travel.leaves else []
    return np.array(sorted(leaving), np.int64)


def halt(avatars: Avatars, numbers: Array) -> None:
    """Let avatars fight that travel."""
    rows = avatars.conditions[numbers]
    rows["mode"], rows["travel"], rows["leg"] = layout.FIGHTS, 0.0, 0.0
    avatars.conditions[numbers] = rows


def defend_travellers(crowd: Crowd, avatars: Avatars, thrown: Array) -> None:
    """Let avatars fight that others have struck at (``records.STRIKE``) on a path that ends when they are attacked."""
    struck = np.unique(thrown["victim"][thrown["victim"] >= 0])
    travel = avatars.conditions["travel"][struck].astype(int)
    ends = np.array([False, *(one.ends_attacked for one in crowd.travels)])
    halt(avatars, struck[(avatars.conditions["mode"][struck] == layout.TRAVELS) & ends[travel]])


def headings_of(crowd: Crowd, numbers: Array) -> Array:
    """Return where avatars look as they enter [rad]: along the beginning of their path, or as placed. Shape (n,)."""
    headings = crowd.heading[numbers]
    entries = entries_of(crowd, numbers)
    for index in np.unique(entries[entries >= 0]):
        x, z = crowd.travels[index].points[1] - crowd.travels[index].points[0]
        headings[entries == index] = np.arctan2(x, z)
    return headings


def _show_way(crowd: Crowd, avatars: Avatars, numbers: Array) -> None:
    """Show avatars the next point of their path; behind the last one it is where they are placed."""
    rows = avatars.conditions[numbers]
    for index in np.unique(rows["travel"]).astype(int) - 1:
        points = crowd.travels[index].points
        own = rows["travel"] == index + 1
        leg = rows["leg"][own].astype(int)
        placed = np.column_stack([crowd.x[numbers[own]], crowd.z[numbers[own]]])
        way = np.where((leg < len(points))[:, None], points[np.minimum(leg, len(points) - 1)], placed)
        rows["way_x"][own], rows["way_z"][own] = way.T
    avatars.conditions[numbers] = rows
