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

import numpy as np

from crowdsim.core.types import Array
from crowdsim.render.crowd_path import Crowd, between, envelope, filled, smooth
from crowdsim.render.view import FIELD, View, directions

_ROOM = 0.93
"""Share of the picture's half width and height in which the crowd stays."""
_REACH = 0.40
"""How far an avatar reaches to the sides, as a share of its height."""
_LAP = 30.0
"""Time of one lap of the orbit [s]."""
HAZE, LEAST_HAZE = 3.6, 34.0
_ELEVATIONS = {"side": 7.0, "front": 7.0, "top": 90.0}
_LOWEST, _HIGHEST = 12.0, 36.0
"""How far down the cameras ``auto`` and ``orbit`` look [degrees]."""
_BISECTIONS = 24
_LINE, _OBLIQUE = 2.0, 0.5
"""A crowd so many times as wide as it is deep is a line, at which ``auto`` looks from so far aside [rad]."""


def _sides(azimuth: float, elevation: float, size: tuple[int, int]) -> tuple[Array, Array, float, float]:
    """Normals of the four sides of a view (4, 3), its directions right, up and ahead as rows, and two tangents."""
    right, up, ahead = directions(azimuth, elevation)
    ty = math.tan(0.5 * FIELD) * _ROOM
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


def _centre(across: Array, ahead: Array) -> float:
    """Return where an eye, to the right or up, sees points as far to one side as to the other; ``ahead`` is positive.

    Args:
        across: Points to the right or up [m]. Shape (n,).
        ahead: How far they are before the eye [m]. Shape (n,).
    """
    low, high = float(across.min()), float(across.max())
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        seen = (across - middle) / ahead
        if seen.max() + seen.min() > 0.0:
            low = middle
        else:
            high = middle
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


def _aside(crowd: Crowd, azimuth: float, tall: float) -> float:
    """How far ``auto`` looks aside [rad]: at one alone, and along a line of many, which would leave ground empty."""
    wide, deep = _width_and_depth(crowd, azimuth, tall)
    seen = int(np.isfinite(crowd.grounds[:, : crowd.avatars, 0]).any(axis=0).sum())
    return _OBLIQUE if crowd.avatars == 1 or (seen > 4 and wide > _LINE * deep) else 0.0


def frame_crowd(crowd: Crowd, kind: str, size: tuple[int, int]) -> Callable[[int], View]:
    """A camera of fixed direction that frames the crowd."""
    alone = crowd.avatars == 1
    azimuth = crowd.facing + {"front": 0.0 if alone else math.pi / 2, "side": math.pi / 2 if alone else 0.0}.get(
        kind, 0.0
    )
    tall = float(np.median(crowd.heights))
    if kind == "auto":
        azimuth += _aside(crowd, azimuth, tall)
    wide, deep = _width_and_depth(crowd, azimuth, tall)
    elevation = _elevation(kind, wide, deep, tall, crowd.avatars)
    normals, basis, tx, ty = _sides(azimuth, elevation, size)
    level = np.hypot(normals[:, 0], normals[:, 2])
    reach = level[:, None] * _REACH * crowd.heights + np.maximum(normals[:, 1:2] * 1.06 * crowd.heights, 0.0)
    limits = np.empty((len(crowd.grounds), 4))
    middles = np.empty(len(crowd.grounds))
    for moment, grounds in enumerate(crowd.grounds):
        here = np.isfinite(grounds[:, 0])
        if not here.any():
            limits[moment], middles[moment] = limits[moment - 1], middles[moment - 1]
            continue
        x, z = grounds[here, :2].T.astype(float)
        flat = normals[:, :1] * x + normals[:, 2:] * z
        limits[moment] = (flat + reach[:, here]).max(axis=1)
        ahead = x * basis[2, 0] + z * basis[2, 2]
        middles[moment] = 0.5 * (ahead.min() + ahead.max())
    along, least, most = _solve(envelope(limits, crowd), tx, ty, smooth(middles, crowd) - 2.2 * tall)
    centres = np.clip(smooth(_centres(crowd, basis, along), crowd), least, np.maximum(least, most))
    eyes = np.concatenate([centres, along[:, None]], axis=1) @ basis
    eyes[:, 1] = np.maximum(eyes[:, 1], 0.35 * tall)
    distances = np.abs(smooth(middles, crowd) - eyes @ basis[2])
    hazes = np.maximum(HAZE * distances, LEAST_HAZE)
    # The view must not keep the crowd in memory.
    step = crowd.step

    def view(frame: int) -> View:
        return View(between(eyes, frame / step), basis[2], basis[0], float(between(hazes, frame / step)))

    return view


def _centres(crowd: Crowd, basis: Array, along: Array) -> Array:
    """Positions of the eye to the right and up (M, 2) from which the crowd is in the middle at each moment."""
    centres = np.zeros((len(crowd.grounds), 2))
    for moment, grounds in enumerate(crowd.grounds):
        here = np.isfinite(grounds[:, 0])
        if not here.any():
            centres[moment] = centres[moment - 1]
            continue
        feet = grounds[here, 0, None].astype(float) * basis[:, 0] + grounds[here, 1, None].astype(float) * basis[:, 2]
        heads = feet + crowd.heights[here, None] * basis[:, 1]
        right, up, ahead = np.concatenate([feet, heads]).T
        ahead = np.maximum(ahead - along[moment], 0.3)
        centres[moment] = _centre(right, ahead), _centre(up, ahead)
    return centres


def orbit_crowd(crowd: Crowd, size: tuple[int, int]) -> Callable[[int], View]:
    """A camera that circles the crowd and frames it."""
    flat = filled(crowd.grounds[..., :2])
    centres = smooth(0.5 * (flat.min(axis=1) + flat.max(axis=1)), crowd)
    tall = float(crowd.heights.max())
    radii = np.linalg.norm(flat - centres[:, None], axis=-1).max(axis=1)
    radii = envelope(radii[:, None], crowd)[:, 0] + _REACH * tall
    across = 2.0 * float(np.median(radii))
    elevation = _elevation("orbit", across, across, tall, crowd.avatars)
    step, turn, facing = crowd.step, 2.0 * math.pi / (_LAP * crowd.fps), crowd.facing
    angles = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    ring = np.stack([np.sin(angles), np.zeros(24), np.cos(angles)], axis=1)

    def view(frame: int) -> View:
        centre, radius = between(centres, frame / step), float(between(radii, frame / step))
        azimuth = facing + turn * frame
        normals, basis, tx, ty = _sides(azimuth, elevation, size)
        limits = normals[:, [0, 2]] @ centre + np.hypot(normals[:, 0], normals[:, 2]) * radius
        limits += np.maximum(normals[:, 1] * 1.06 * tall, 0.0)
        middle = float(centre @ basis[2, [0, 2]])
        along, least, most = _solve(limits, tx, ty, np.array(middle - 2.2 * tall))
        feet = np.insert(centre, 1, 0.0) + radius * ring
        heads = feet + np.array([0.0, tall, 0.0])
        _, up, ahead = (np.concatenate([feet, heads]) @ basis.T).T
        height = min(max(_centre(up, np.maximum(ahead - along, 0.3)), float(least[1])), float(most[1]))
        eye = np.array([float(np.insert(centre, 1, 0.0) @ basis[0]), height, float(along)]) @ basis
        haze = max(HAZE * (middle - float(eye @ basis[2])), LEAST_HAZE)
        return View(eye, basis[2], basis[0], haze)

    return view
