"""Cameras that frame the whole crowd, from one side or round about.

They rest on this: a point p lies inside the picture of an eye e when ``g_k . p <= g_k . e``
for the normals g_k of the four sides of its view. So the crowd is in the picture when the eye satisfies four numbers,
the greatest ``g_k . p`` of each side. Their upper envelope over a window of time, smoothed by a kernel no wider than
that window, stays above them: the eye that follows from it moves without jerks and still frames everything.

Those numbers say how far the eye must keep away. Where one side of the picture decides that, there is room between the
other two, and the eye moves within it so that the crowd is in the middle of the picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.render.crowd_path import Crowd, between, envelope, filled, smooth
from crowdsim.render.view import View, directions

_ROOM = 0.93
"""Share of the picture's half width and height in which the crowd stays."""
_REACH = 0.40
"""How far an avatar reaches to the sides, as a share of its height."""
_FEET = 0.15
"""How far its feet and head are from its position, likewise."""
_CLOSEST, _CLOSE = 2.2, 1.5
"""How near a camera may come, in heights, and one that is close."""
_LOW = 0.2
"""How low a close camera may be, in heights."""
_ELEVATIONS = {"side": 7.0, "front": 7.0, "top": 90.0}
_LOWEST, _HIGHEST = 12.0, 36.0
"""How far down the cameras ``auto`` and ``orbit`` look [degrees]."""
_BISECTIONS = 24
_AT_ONCE = 200_000
"""Positions of avatars that are worked on at once."""
_ANGLES = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
_RING = np.stack([np.sin(_ANGLES), np.zeros(24), np.cos(_ANGLES)], axis=1)
_LINE, _OBLIQUE = 2.0, 0.5
"""A crowd so many times as wide as it is deep is a line, at which ``auto`` looks from so far aside [rad]."""


def _sides(azimuth: float, elevation: float, size: tuple[int, int], field: float) -> tuple[Array, Array, float, float]:
    """Normals of the four sides of a view (4, 3), its directions right, up and ahead as rows, and two tangents."""
    right, up, ahead = directions(azimuth, elevation)
    ty = math.tan(0.5 * field) * _ROOM
    tx = ty * size[0] / size[1]
    normals = np.stack([right - tx * ahead, -right - tx * ahead, up - ty * ahead, -up - ty * ahead])
    return normals, np.stack([right, up, ahead]), tx, ty


def _solve(limits: Array, tx: float, ty: float, closest: Array) -> tuple[Array, Array, Array]:
    """How far along its view an eye may be that satisfies the limits (..., 4) and stays behind ``closest`` (...,).

    Returns:
        That place along the view (...,), and the least and greatest places to the right and up (..., 2).
    """
    a, b, c, d = np.moveaxis(limits, -1, 0)
    reaches = np.stack([-0.5 * (a + b) / tx, -0.5 * (c + d) / ty, closest], axis=-1)
    # A soft minimum, so that the eye does not jerk where another limit takes over.
    least = reaches.min(axis=-1, keepdims=True)
    z = least[..., 0] - 0.5 * np.log(np.exp(-(reaches - least) / 0.5).sum(axis=-1))
    return z, np.stack([a + tx * z, c + ty * z], axis=-1), np.stack([-b - tx * z, -d - ty * z], axis=-1)


def _centre(across: Array, ahead: Array) -> Array:
    """Return where eyes, to the right or up, see points as far to one side as to the other; ``ahead`` is positive.

    Args:
        across: Points to the right or up, NaN where there are none [m]. Shape (..., n).
        ahead: How far they are before the eye [m]. Shape (..., n).
    """
    # As nanmin and nanmax, in a third of their time for a few points.
    least, most = np.fmin.reduce, np.fmax.reduce
    low, high = least(across, axis=-1), most(across, axis=-1)
    seen = np.empty(np.broadcast_shapes(across.shape, ahead.shape))
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        np.divide(np.subtract(across, middle[..., None], out=seen), ahead, out=seen)
        right = most(seen, axis=-1) + least(seen, axis=-1) > 0.0
        low, high = np.where(right, middle, low), np.where(right, high, middle)
    return 0.5 * (low + high)


def _elevation(kind: str, wide: float, deep: float, tall: float, avatars: int) -> float:
    """How far down a camera looks [rad]: so far that a crowd of this width and depth fills the picture's height."""
    if kind in _ELEVATIONS:
        return math.radians(_ELEVATIONS[kind])
    fills = math.asin(min(max((0.54 * wide - tall) / max(deep, 0.1), 0.0), 1.0))
    most = min(_LOWEST + 11.0 * math.log10(avatars), _HIGHEST)
    return math.radians(min(max(math.degrees(fills), _LOWEST), most))


def _extent(crowd: Crowd, way: Array) -> float:
    """How far the crowd reaches along a level direction (2,) at most moments [m]."""
    extents = []
    for grounds in crowd.grounds:
        here = grounds[np.isfinite(grounds[:, 0]), :2]
        if len(here):
            along = here[:, 0] * float(way[0]) + here[:, 1] * float(way[1])
            extents.append(float(along.max() - along.min()))
    return float(np.median(extents)) if extents else 0.0


def _width_and_depth(crowd: Crowd, azimuth: float, tall: float) -> tuple[float, float]:
    """Extents of the crowd across and along a heading [m]."""
    sin, cos = math.sin(azimuth), math.cos(azimuth)
    return _extent(crowd, np.array([-cos, sin])) + 2.0 * _REACH * tall, _extent(crowd, np.array([sin, cos]))


def _aside(crowd: Crowd, wide: float, deep: float) -> float:
    """How far ``auto`` looks aside [rad]: at one alone, and along a line of many, which would leave ground empty."""
    seen = int(np.isfinite(crowd.grounds[:, : crowd.avatars, 0]).any(axis=0).sum())
    return _OBLIQUE if crowd.avatars == 1 or (seen > 4 and wide > _LINE * deep) else 0.0


def frame_crowd(crowd: Crowd, kind: str, size: tuple[int, int], field: float) -> Callable[[float], View]:
    """Return the view of a camera of fixed direction that frames the crowd.

    Args:
        crowd: The crowd.
        kind: ``auto``, ``side``, ``front`` or ``top``.
        size: Width and height of the picture [px].
        field: Angle between its upper and lower edge [rad].
    """
    alone = crowd.avatars == 1
    azimuth = crowd.facing + {"front": 0.0 if alone else math.pi / 2, "side": math.pi / 2 if alone else 0.0}.get(
        kind, 0.0
    )
    tall = float(np.median(crowd.heights))
    wide, deep = _width_and_depth(crowd, azimuth, tall)
    aside = _aside(crowd, wide, deep) if kind == "auto" else 0.0
    if aside:
        azimuth += aside
        wide, deep = _width_and_depth(crowd, azimuth, tall)
    elevation = _elevation(kind, wide, deep, tall, crowd.avatars)
    normals, basis, tx, ty = _sides(azimuth, elevation, size, field)
    level = np.hypot(normals[:, 0], normals[:, 2])
    reach = level[:, None] * _REACH * crowd.heights + np.maximum(normals[:, 1:2] * 1.06 * crowd.heights, 0.0)
    limits, middles = np.empty((len(crowd.grounds), 4)), np.empty(len(crowd.grounds))

    def look(moments: Array) -> None:
        x, z = np.moveaxis(crowd.grounds[moments, :, :2].astype(float), -1, 0)
        for side, (right, _, ahead) in enumerate(normals):
            limits[moments, side] = np.nanmax(right * x + ahead * z + reach[side], axis=1)
        deep = x * basis[2, 0] + z * basis[2, 2]
        middles[moments] = 0.5 * (np.nanmin(deep, axis=1) + np.nanmax(deep, axis=1))

    _some_at_once(crowd, look)
    limits, middles = _as_before(crowd, limits), _as_before(crowd, middles)
    along, least, most = _solve(envelope(limits, crowd), tx, ty, smooth(middles, crowd) - _CLOSEST * tall)
    centres = np.clip(smooth(_centres(crowd, basis, along), crowd), least, np.maximum(least, most))
    eyes = np.concatenate([centres, along[:, None]], axis=1) @ basis
    eyes[:, 1] = np.maximum(eyes[:, 1], 0.35 * tall)
    distances = np.abs(smooth(middles, crowd) - eyes @ basis[2])
    # The view must not keep the crowd in memory.
    step = crowd.step

    def view(frame: float) -> View:
        return View(between(eyes, frame / step), basis[2], basis[0], float(between(distances, frame / step)), field)

    return view


def _centres(crowd: Crowd, basis: Array, along: Array) -> Array:
    """Positions of the eye to the right and up (M, 2) from which the crowd is in the middle at each moment."""
    centres = np.zeros((len(crowd.grounds), 2))

    def look(moments: Array) -> None:
        x, z = np.moveaxis(crowd.grounds[moments, :, :2].astype(float), -1, 0)
        places = []
        for side in range(3):
            feet = x * basis[side, 0] + z * basis[side, 2]
            places.append(np.concatenate([feet, feet + crowd.heights * basis[side, 1]], axis=1))
        right, up, ahead = places
        ahead = np.maximum(ahead - along[moments, None], 0.3)
        centres[moments, 0], centres[moments, 1] = _centre(right, ahead), _centre(up, ahead)

    _some_at_once(crowd, look)
    return _as_before(crowd, centres)


def _some_at_once(crowd: Crowd, look: Callable[[Array], None]) -> None:
    """Look at the moments at which anything is there, some at a time."""
    there = np.flatnonzero(np.isfinite(crowd.grounds[:, :, 0]).any(axis=1))
    size = max(1, _AT_ONCE // max(crowd.grounds.shape[1], 1))

    def work(low: int, high: int) -> None:
        for first in range(low * size, high * size, size):
            look(there[first : first + size])

    share(-(-len(there) // size), work, least=1)


def _as_before(crowd: Crowd, values: Array) -> Array:
    """Return values of moments (M, ...), at moments when nothing is there those of the last one before."""
    there = np.isfinite(crowd.grounds[:, :, 0]).any(axis=1)
    return values[np.maximum.accumulate(np.where(there, np.arange(len(values)), 0))]


@dataclass(frozen=True)
class Rings:
    """Cylinders around a crowd at every moment, which a camera frames from any side.

    Attributes:
        centres: Their middles on the ground, x and z [m]. Shape (M, 2).
        radii: Their radii [m]. Shape (M,).
        height: Height of all of them [m].
        step: Frames between moments.
    """

    centres: Array
    radii: Array
    height: float
    step: int

    def view(
        self,
        frame: float,
        azimuth: float,
        elevation: float,
        size: tuple[int, int],
        field: float,
        distance: float | None = None,
    ) -> View:
        """Return a view in a direction that shows all of the cylinder, or from a distance to its middle.

        Args:
            frame: The frame.
            azimuth: Heading in which the camera looks [rad].
            elevation: How far down it looks [rad].
            size: Width and height of the picture [px].
            field: Angle between its upper and lower edge [rad].
            distance: Level distance to the middle [m]; as near as shows all when None.
        """
        centre, radius = between(self.centres, frame / self.step), float(between(self.radii, frame / self.step))
        normals, basis, tx, ty = _sides(azimuth, elevation, size, field)
        if distance is not None:
            target = np.array([centre[0], 0.5 * self.height, centre[1]])
            eye = target - basis[2] * (distance / math.cos(elevation))
            return View(eye, basis[2], basis[0], distance, field)
        limits = normals[:, [0, 2]] @ centre + np.hypot(normals[:, 0], normals[:, 2]) * radius
        limits += np.maximum(normals[:, 1] * 1.06 * self.height, 0.0)
        middle = float(centre @ basis[2, [0, 2]])
        along, least, most = _solve(limits, tx, ty, np.array(middle - _CLOSEST * self.height))
        feet = np.insert(centre, 1, 0.0) + radius * _RING
        heads = feet + np.array([0.0, self.height, 0.0])
        _, up, ahead = (np.concatenate([feet, heads]) @ basis.T).T
        height = min(max(float(_centre(up, np.maximum(ahead - along, 0.3))), float(least[1])), float(most[1]))
        eye = np.array([float(np.insert(centre, 1, 0.0) @ basis[0]), height, float(along)]) @ basis
        return View(eye, basis[2], basis[0], middle - float(eye @ basis[2]), field)


def rings_around(crowd: Crowd) -> Rings:
    """Return smooth cylinders around a crowd."""
    flat = filled(crowd.grounds[..., :2])
    centres = smooth(0.5 * (flat.min(axis=1) + flat.max(axis=1)), crowd)
    tall = float(crowd.heights.max())
    radii = np.linalg.norm(flat - centres[:, None], axis=-1).max(axis=1)
    return Rings(centres, envelope(radii[:, None], crowd)[:, 0] + _REACH * tall, tall, crowd.step)


def orbit_elevation(rings: Rings, avatars: int) -> float:
    """Return how far down a camera looks at cylinders around some avatars [rad]."""
    across = 2.0 * float(np.median(rings.radii))
    return _elevation("orbit", across, across, rings.height, avatars)


@dataclass(frozen=True)
class CloseFrame:
    """Frames a few avatars as large as it can, from any side; arrays of views at once.

    Attributes:
        size: Width and height of the picture [px].
        field: Angle between its upper and lower edge [rad].
        height: Height of the tallest of them [m].
        distance: Level distance to their middle [m]; as near as shows all when None.
    """

    size: tuple[int, int]
    field: float
    height: float
    distance: float | None = None

    def _bases(self, angles: Array) -> tuple[Array, float, float]:
        """Directions right, up and ahead (..., 3, 3) as rows, and two tangents."""
        sin, cos = np.sin(angles[..., 0]), np.cos(angles[..., 0])
        low, level = np.sin(angles[..., 1]), np.cos(angles[..., 1])
        right = np.stack([-cos, np.zeros_like(cos), sin], axis=-1)
        ahead = np.stack([sin * level, -low, cos * level], axis=-1)
        ty = math.tan(0.5 * self.field) * _ROOM
        return np.stack([right, np.cross(right, ahead), ahead], axis=-2), ty * self.size[0] / self.size[1], ty

    def limits(self, grounds: Array, heights: Array, centres: Array, angles: Array) -> Array:
        """Return how far avatars reach beyond each side of the picture from a centre; 0 where none is there.

        Args:
            grounds: Ground transforms of the avatars, NaN while absent. Shape (..., n, 3).
            heights: Their heights [m]. Shape (..., n).
            centres: The centre, x and z [m]. Shape (..., 2).
            angles: Heading and elevation of the view [rad]. Shape (..., 2).

        Returns:
            Shape (..., 4).
        """
        bases, tx, ty = self._bases(angles)
        right, up, ahead = np.moveaxis(bases, -2, 0)
        sides = [right - tx * ahead, -right - tx * ahead, up - ty * ahead, -up - ty * ahead]
        nx, ny, nz = np.moveaxis(np.stack(sides, axis=-2), -1, 0)[..., None]
        x, z = np.moveaxis(grounds[..., :2] - centres[..., None, :], -1, 0)[..., None, :]
        tall = heights[..., None, :]
        reach = np.hypot(nx, nz) * np.array([_REACH, _REACH, _FEET, _FEET])[:, None] * tall
        found = nx * x + nz * z + reach + np.maximum(ny * 1.06 * tall, 0.0)
        found = np.where(np.isfinite(found), found, -np.inf).max(axis=-1)
        return np.where(np.isfinite(found), found, 0.0)

    def eyes(self, centres: Array, angles: Array, limits: Array) -> Array:
        """Return from where views show all within limits. Shape (..., 3).

        Args:
            centres: What they look at, x and z [m]. Shape (..., 2).
            angles: Their heading and elevation [rad]. Shape (..., 2).
            limits: See ``limits``; greater ones leave room. Shape (..., 4).
        """
        bases, tx, ty = self._bases(angles)
        if self.distance is None:
            along, least, most = _solve(limits, tx, ty, np.full(limits.shape[:-1], -_CLOSE * self.height))
            right, up = np.moveaxis(0.5 * (least + most), -1, 0)
        else:
            level = np.cos(angles[..., 1])
            right, up, along = 0.0 * level, 0.5 * self.height * level, -self.distance / level
        place = np.stack([right, up, along], axis=-1)
        eyes = np.asarray((place[..., None] * bases).sum(axis=-2))
        eyes[..., [0, 2]] += centres
        eyes[..., 1] = np.maximum(eyes[..., 1], _LOW * self.height)
        return eyes

    def view(self, centre: Array, angles: Array, limits: Array) -> View:
        """Return one view, see ``eyes``."""
        eye = self.eyes(centre, angles, limits)
        right, _, ahead = self._bases(angles)[0]
        away = float(np.hypot(*(eye[[0, 2]] - centre)))
        return View(eye, ahead, right, away, self.field)
