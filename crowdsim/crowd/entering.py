"""Where avatars enter that an event adds: at the start of their path, at their placement, or near that."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, positions_of
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.kernels import layout
from crowdsim.places.arrays import Places, are_ways_clear, gaps_of
from crowdsim.places.kernels.distance import CLEAR

REACH = 1.0
"""How far from its placement an avatar may enter [m]."""
AGAIN = 5
"""After how many control frames one that waits tries again."""
_STANDING, _DOWN, _WALKING_IN = 0.25, 0.75, 0.55
"""How far others keep off the middle of an avatar that stands, by its width, of one that is down, and, by its width, of
one that enters along a path [m]."""
_RINGS, _WAYS, _NEAREST = 4, 12, 16
"""Positions that are tried: rings up to ``REACH``, and directions; and others that are looked at for each."""


class Arrival(NamedTuple):
    """An avatar that had no room where it was to enter, or to be put.

    Attributes:
        avatar: Its number.
        asked: Control frame in which it was to enter.
        entered: Control frame in which it did.
        distance: How far from there that was [m].
        is_put: Whether an event put it there, instead of adding it.
    """

    avatar: int
    asked: int
    entered: int
    distance: float
    is_put: bool = False


def find_entries(crowd: Crowd, avatars: Avatars, present: int, numbers: Array) -> Array:
    """Return where avatars enter that are not there; the same for any order of storage.

    An avatar that enters along a path does so at its start, if that is free. One whose placement is free enters there;
    members of one group keep the distances of their placements. Each of the others takes, in the order of their
    numbers, the nearest free position within ``REACH`` and inside the arena.

    Args:
        crowd: The crowd.
        avatars: Its avatars.
        present: How many are there.
        numbers: Avatars that are to enter, ascending, along each path no more than one. Shape (n,).

    Returns:
        Positions, x and z [m]; NaN where there is none. Shape (n, 2).
    """
    here = avatars.number[:present]
    rooms = _STANDING * avatars.motion["width"].astype(float)
    points = positions_of(avatars, slice(present))
    others = rooms[:present].copy()
    if len(avatars.conditions):
        others[avatars.conditions["standing"][here] >= layout.DROPS] = _DOWN
    placed = entry_points(crowd, numbers)
    own = rooms[avatars.slot_of[numbers]]
    own[entries_of(crowd, numbers) >= 0] *= _WALKING_IN / _STANDING
    free = _are_free(placed, own, points, others)
    free[free] = _are_first(placed[free], own[free], crowd.group[numbers[free]])
    found = np.where(free[:, None], placed, np.nan)
    points, others = np.concatenate([points, placed[free]]), np.concatenate([others, own[free]])
    blocked = np.flatnonzero(~free & (entries_of(crowd, numbers) < 0))
    if not len(blocked):
        return found
    around = points_around()
    tried = placed[blocked, None] + around
    free = _are_free(tried.reshape(-1, 2), np.repeat(own[blocked], len(around)), points, others)
    free &= _are_inside(crowd.arena, tried.reshape(-1, 2))
    free &= are_ways_clear(crowd.parts, np.repeat(placed[blocked], len(around), axis=0), tried.reshape(-1, 2))
    taken: list[int] = []
    for row, avatar in enumerate(blocked):
        choices = tried[row][free.reshape(len(blocked), -1)[row]]
        gaps = np.linalg.norm(choices[:, None] - found[taken], axis=-1)
        choices = choices[(gaps >= own[avatar] + own[taken]).all(axis=1)]
        if len(choices):
            found[avatar] = choices[0]
            taken.append(int(avatar))
    return found


def find_place(
    crowd: Crowd, places: Places, avatars: Avatars, present: int, number: int, point: Array, frame: int
) -> Array | None:
    """Return the free position for an avatar that is nearest to a point, within ``REACH``; None where there is none.

    Args:
        crowd: The crowd.
        places: Its obstacles.
        avatars: Its avatars.
        present: How many are there.
        number: The avatar, which may be there.
        point: x and z [m]. Shape (2,).
        frame: Control frame, by which doors are open.

    Returns:
        x and z [m]. Shape (2,).
    """
    here = avatars.number[:present]
    others = here != number
    rooms = _STANDING * avatars.motion["width"].astype(float)
    taken = rooms[:present].copy()
    if len(avatars.conditions):
        taken[avatars.conditions["standing"][here] >= layout.DROPS] = _DOWN
    slot = avatars.slot_of[number]
    tried = np.asarray(point, float) + np.concatenate([np.zeros((1, 2)), points_around()])
    points = positions_of(avatars, slice(present))[others]
    free = _are_free(tried, np.full(len(tried), rooms[slot]), points, taken[others])
    free &= _are_inside(crowd.arena, tried)
    if len(crowd.parts):
        free &= gaps_of(places, tried, float(frame)) >= CLEAR * avatars.playback["scale"][slot]
    return tried[np.argmax(free)] if free.any() else None


def points_around() -> Array:
    """Return positions around an avatar that are tried, the nearest first. Shape (n, 2)."""
    rings, ways = np.arange(1, _RINGS + 1) * REACH / _RINGS, np.arange(_WAYS) * 2.0 * np.pi / _WAYS
    return np.concatenate([ring * np.column_stack([np.sin(ways), np.cos(ways)]) for ring in rings])


def entries_of(crowd: Crowd, numbers: Array) -> Array:
    """Return the path by which each avatar enters, an index into ``Crowd.travels``; -1 for none. Shape (n,)."""
    return crowd.entries[crowd.group[numbers]] if len(crowd.entries) else np.full(len(numbers), -1)


def entry_points(crowd: Crowd, numbers: Array) -> Array:
    """Return where avatars are to enter, x and z [m]: at the start of their path, or where they are placed. (n, 2)."""
    points = np.column_stack([crowd.x[numbers], crowd.z[numbers]])
    entries = entries_of(crowd, numbers)
    for index in np.unique(entries[entries >= 0]):
        points[entries == index] = crowd.travels[index].points[0]
    return points


def first_in_line(crowd: Crowd, waiting: Mapping[int, int]) -> Array:
    """Return which waiting avatars may enter: of those along one path the first one alone. Ascending, int64.

    Args:
        crowd: The crowd.
        waiting: Numbers of the avatars, and in which control frame each was to enter.
    """
    numbers = np.array(sorted(waiting), np.int64)
    entries = entries_of(crowd, numbers)
    asked = np.array([waiting[number] for number in numbers.tolist()], np.int64)
    order = np.lexsort((numbers, asked))
    _, first = np.unique(entries[order], return_index=True)
    return np.sort(np.concatenate([numbers[entries < 0], numbers[order[first]][entries[order[first]] >= 0]]))


def describe_arrivals(
    arrivals: Sequence[Arrival],
    waiting: Mapping[int, int],
    places: Container[int],
    frame: int,
    rate: float,
    names: Array,
) -> str:
    """Return in words which avatars had no room where they were to enter, or to be put, and which are still waiting.

    Args:
        arrivals: Those that have entered.
        waiting: Those that have not, and since when [control frames].
        places: Those of them that an event puts somewhere.
        frame: Control frames that were run.
        rate: Control frames a second.
        names: Names of all avatars.
    """
    texts = []
    for is_put, how in (
        (False, ("added where another avatar stood", "entered", "its placement", "never entered")),
        (True, ("put where it had no room", "was put", "that point", "is absent")),
    ):
        own = [one for one in arrivals if one.is_put == is_put]
        late = {number: since for number, since in waiting.items() if (number in places) == is_put}
        if own or late:
            texts.append(_describe_some(own, late, how, frame, rate, names))
    return "; ".join(texts)


def _describe_some(
    arrivals: Sequence[Arrival],
    waiting: Mapping[int, int],
    how: tuple[str, str, str, str],
    frame: int,
    rate: float,
    names: Array,
) -> str:
    """Return in a sentence how avatars entered, or were put, that had no room, and which are still waiting."""
    where, entered, there, never = how
    count = len(arrivals) + len(waiting)
    moved = [one for one in arrivals if one.distance > 0.0]
    late = [one for one in arrivals if one.entered > one.asked]
    parts = []
    if moved:
        farthest = max(one.distance for one in moved)
        parts.append(f"{_some(len(moved), count)}{entered} {_up_to(len(moved))}{farthest:.2f} m from {there}")
    if late:
        longest = max(one.entered - one.asked for one in late) / rate
        parts.append(f"{_some(len(late), count)}waited for room for {_up_to(len(late))}{longest:.1f} s")
    if waiting:
        longest = (frame - min(waiting.values())) / rate
        parts.append(f"{_some(len(waiting), count)}found no room in {longest:.1f} s and {never}")
    first = names[min([*(one.avatar for one in arrivals), *waiting])]
    who = f"avatar {first} was" if count == 1 else f"{count:,} avatars, {first} the first of them, were"
    return f"{who} {where}: {'it ' if count == 1 else ''}{', '.join(parts)}"


def _up_to(number: int) -> str:
    """Return how a figure begins that is the largest of several."""
    return "up to " if number > 1 else ""


def _some(number: int, count: int) -> str:
    """Return how many of several a part of a sentence is about; nothing where there is one."""
    return f"{number:,} " if count > 1 else ""


def _are_free(places: Array, own: Array, points: Array, others: Array) -> Array:
    """Return whether avatars that need some room (P,) have it at places (P, 2) among others (m,) at points (m, 2)."""
    from scipy.spatial import cKDTree

    if not len(points):
        return np.ones(len(places), bool)
    widest = float(own.max(initial=0.0) + others.max())
    most = min(_NEAREST, len(points))
    distances, which = cKDTree(points).query(places, k=np.arange(1, most + 1), distance_upper_bound=widest)
    rooms = np.append(others, 0.0)[which]
    return np.asarray((distances >= own[:, None] + rooms).all(axis=1))


def _are_first(points: Array, rooms: Array, groups: Array) -> Array:
    """Return whether avatars (n,) have room at points (n, 2) among those of other groups that come before them."""
    from scipy.spatial import cKDTree

    first = np.ones(len(points), bool)
    if len(np.unique(groups)) > 1:
        pairs = cKDTree(points).query_pairs(2.0 * float(rooms.max()), output_type="ndarray")
        gaps = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        pairs = pairs[(gaps < rooms[pairs].sum(axis=1)) & (groups[pairs[:, 0]] != groups[pairs[:, 1]])]
        for one, other in pairs[np.argsort(pairs[:, 1], kind="stable")]:
            first[other] &= not first[one]
    return first


def _are_inside(arena: Array, points: Array) -> Array:
    """Return whether points (P, 2) lie in the arena of a crowd (``Crowd.arena``). Shape (P,), bool."""
    kind, x, z, half_x, half_z = arena
    dx, dz = np.abs(points - [x, z]).T
    if kind == layout.CIRCLE:
        return np.asarray(np.hypot(dx, dz) <= half_x)
    return np.asarray((dx <= half_x) & (dz <= half_z)) if kind == layout.RECTANGLE else np.ones(len(points), bool)
