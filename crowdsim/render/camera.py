"""Cameras: where the eye is at every frame of a take.

A camera is made from the whole take before the first picture, so that any range of frames shows what the whole shows.
It knows the crowd at a few moments a second.

The cameras that frame the crowd rest on this: a point p lies inside the picture of an eye e when ``g_k . p <= g_k . e``
for the normals g_k of the four sides of its view. So the crowd is in the picture when the eye satisfies four numbers,
the greatest ``g_k . p`` of each side. Their upper envelope over a window of time, smoothed by a kernel no wider than
that window, stays above them: the eye that follows from it moves without jerks and still frames everything.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.errors import CrowdsimError, nearest
from crowdsim.render.crowd_path import Crowd, between, envelope, filled, hann, smooth, watch
from crowdsim.render.raycast import sun_direction
from crowdsim.render.source import PoseSource
from crowdsim.render.view import FIELD, View, directions, look_at

Array = NDArray[Any]

CAMERAS = ("auto", "orbit", "follow:AVATAR", "top", "side", "front")

_ROOM = 0.88
"""Share of the picture's half width and height in which the crowd stays."""
_REACH = 0.40
"""How far an avatar reaches to the sides, as a share of its height."""
_LAP = 30.0
"""Time of one lap of the orbit [s]."""
_HAZE, _LEAST_HAZE = 3.6, 34.0
_ELEVATIONS = {"auto": 13.0, "side": 7.0, "front": 7.0, "top": 90.0, "orbit": 12.0}


@dataclass(frozen=True)
class Keys:
    """A camera that moves through given places.

    Attributes:
        seconds: Times, ascending [s]. Shape (K,).
        positions: Place of the eye at each [m]. Shape (K, 3).
        targets: What it looks at [m]. Shape (K, 3).
    """

    seconds: Array
    positions: Array
    targets: Array


@dataclass(frozen=True)
class Track:
    """A camera over a whole take.

    Attributes:
        view: The view at a frame.
        sun: Unit direction to the sun. Shape (3,).
    """

    view: Callable[[int], View]
    sun: Array


def parse_camera(text: str, avatars: int | None = None, names: tuple[str, ...] = ()) -> str:
    """Return the camera that a text names, ``follow:`` with a number; several joined by '+' stand side by side.

    Args:
        text: 'auto', 'orbit', 'follow:3', 'follow:red_007', 'top', 'side', 'front', 'front+side'.
        avatars: How many avatars there are, when that is known.
        names: Their names.

    Raises:
        CrowdsimError: There is no such camera or avatar.
    """
    parts = []
    for part in text.split("+"):
        kind, colon, avatar = part.strip().partition(":")
        if kind == "follow" and colon:
            number = names.index(avatar) if avatar in names else int(avatar) if avatar.isdecimal() else -1
            if number < 0 or (avatars is not None and number >= avatars):
                known = f"0 to {avatars - 1}" if avatars else "0 on"
                raise CrowdsimError(
                    f"camera {part!r}: no avatar {avatar!r}, expected a number from {known}"
                    + (f" or a name such as {names[0]!r}{nearest(avatar, names)}" if names else "")
                )
            parts.append(f"follow:{number}")
        elif colon or kind not in CAMERAS:
            hint = " (follow whom? 'follow:0' say)" if kind == "follow" else nearest(kind, CAMERAS)
            raise CrowdsimError(f"camera {part!r} is unknown, expected one of {', '.join(CAMERAS)}{hint}")
        else:
            parts.append(kind)
    return "+".join(parts)


def build_track(source: PoseSource, camera: str | Keys, size: tuple[int, int], crowd: Crowd | None = None) -> Track:
    """Return one camera over a whole take.

    Args:
        source: The take.
        camera: A name without '+', see ``parse_camera``, or keys.
        size: Width and height of the picture [px].
        crowd: What ``watch`` gives, where it is known already.

    Raises:
        CrowdsimError: There is no such camera or avatar.
    """
    crowd = watch(source) if crowd is None else crowd
    # The sun stands over the shoulder of the camera auto, so that shadows fall away from it and to the right.
    sun = sun_direction(crowd.facing + math.pi + 1.05)
    if isinstance(camera, Keys):
        return Track(_keyed(camera, source.fps), sun)
    kind, _, avatar = parse_camera(camera, len(crowd.heights), tuple(source.avatar_names)).partition(":")
    if kind == "follow":
        return Track(_following(source, int(avatar)), sun)
    if kind == "orbit":
        return Track(_orbiting(crowd, size), sun)
    return Track(_framing(crowd, kind, size), sun)


def _sides(azimuth: float, elevation: float, size: tuple[int, int]) -> tuple[Array, Array, float, float]:
    """Normals of the four sides of a view (4, 3), its directions right, up and ahead as rows, and two tangents."""
    right, up, ahead = directions(azimuth, elevation)
    ty = math.tan(0.5 * FIELD) * _ROOM
    tx = ty * size[0] / size[1]
    normals = np.stack([right - tx * ahead, -right - tx * ahead, up - ty * ahead, -up - ty * ahead])
    return normals, np.stack([right, up, ahead]), tx, ty


def _solve(limits: Array, basis: Array, tx: float, ty: float, closest: Array) -> Array:
    """Place of the eye that satisfies the limits (..., 4) and stays behind ``closest`` (...,) along its view."""
    a, b, c, d = np.moveaxis(limits, -1, 0)
    x, y = 0.5 * (a - b), 0.5 * (c - d)
    reaches = np.stack([-0.5 * (a + b) / tx, -0.5 * (c + d) / ty, closest], axis=-1)
    # A soft minimum, so that the eye does not jerk where another limit takes over.
    least = reaches.min(axis=-1, keepdims=True)
    z = least[..., 0] - 0.5 * np.log(np.exp(-(reaches - least) / 0.5).sum(axis=-1))
    return np.stack([x, y, z], axis=-1) @ basis


def _elevation(kind: str, avatars: int) -> float:
    """How far down a camera looks [rad]: steeper over large crowds."""
    degrees = _ELEVATIONS[kind]
    if kind in ("auto", "orbit"):
        degrees += 5.5 * math.log10(max(avatars, 1))
    return math.radians(degrees)


def _framing(crowd: Crowd, kind: str, size: tuple[int, int]) -> Callable[[int], View]:
    """A camera of fixed direction that frames the crowd."""
    alone = len(crowd.heights) == 1
    azimuth = crowd.facing + {"front": 0.0 if alone else math.pi / 2, "side": math.pi / 2 if alone else 0.0}.get(
        kind, 0.0
    )
    if kind == "auto" and alone:
        azimuth += 0.5
    elevation = _elevation(kind, len(crowd.heights))
    normals, basis, tx, ty = _sides(azimuth, elevation, size)
    level = np.hypot(normals[:, 0], normals[:, 2])
    reach = level[:, None] * _REACH * crowd.heights + np.maximum(normals[:, 1:2] * 1.06 * crowd.heights, 0.0)
    limits = np.empty((len(crowd.places), 4))
    middles = np.empty(len(crowd.places))
    for moment, places in enumerate(crowd.places):
        here = np.isfinite(places[:, 0])
        if not here.any():
            limits[moment], middles[moment] = limits[moment - 1], middles[moment - 1]
            continue
        x, z = places[here, :2].T.astype(float)
        flat = normals[:, :1] * x + normals[:, 2:] * z
        limits[moment] = (flat + reach[:, here]).max(axis=1)
        ahead = x * basis[2, 0] + z * basis[2, 2]
        middles[moment] = 0.5 * (ahead.min() + ahead.max())
    tall = float(np.median(crowd.heights))
    eyes = _solve(envelope(limits, crowd), basis, tx, ty, smooth(middles, crowd) - 2.2 * tall)
    eyes[:, 1] = np.maximum(eyes[:, 1], 0.35 * tall)
    distances = np.abs(smooth(middles, crowd) - eyes @ basis[2])
    hazes = np.maximum(_HAZE * distances, _LEAST_HAZE)
    # The view must not keep the crowd in memory.
    step = crowd.step

    def view(frame: int) -> View:
        return View(between(eyes, frame / step), basis[2], basis[0], float(between(hazes, frame / step)))

    return view


def _orbiting(crowd: Crowd, size: tuple[int, int]) -> Callable[[int], View]:
    """A camera that circles the crowd and frames it."""
    flat = filled(crowd.places[..., :2])
    centres = smooth(0.5 * (flat.min(axis=1) + flat.max(axis=1)), crowd)
    tall = float(crowd.heights.max())
    radii = np.linalg.norm(flat - centres[:, None], axis=-1).max(axis=1)
    radii = envelope(radii[:, None], crowd)[:, 0] + _REACH * tall
    elevation = _elevation("orbit", len(crowd.heights))
    step, turn, facing = crowd.step, 2.0 * math.pi / (_LAP * crowd.fps), crowd.facing

    def view(frame: int) -> View:
        centre, radius = between(centres, frame / step), float(between(radii, frame / step))
        azimuth = facing + turn * frame
        normals, basis, tx, ty = _sides(azimuth, elevation, size)
        limits = normals[:, [0, 2]] @ centre + np.hypot(normals[:, 0], normals[:, 2]) * radius
        limits += np.maximum(normals[:, 1] * 1.06 * tall, 0.0)
        middle = float(centre @ basis[2, [0, 2]])
        eye = _solve(limits, basis, tx, ty, np.array(middle - 2.2 * tall))
        haze = max(_HAZE * (middle - float(eye @ basis[2])), _LEAST_HAZE)
        return View(eye, basis[2], basis[0], haze)

    return view


def _following(source: PoseSource, avatar: int) -> Callable[[int], View]:
    """A camera behind the shoulder of one avatar."""
    step = max(1, round(source.fps / 10.0))
    frames = np.arange(0, max(source.frame_count, 1) - 1 + step, step).clip(max=max(source.frame_count - 1, 0))
    block = max(1, 400_000 // max(len(source.avatar_teams), 1))
    path = np.concatenate([source.ground(frames[i : i + block])[:, avatar] for i in range(0, len(frames), block)])
    path = filled(path[:, None])[:, 0]
    tall = float(source.avatar_heights[avatar])
    places = hann(path[:, :2], round(0.8 * source.fps / step))
    headings = hann(np.unwrap(path[:, 2])[:, None], round(1.6 * source.fps / step))

    def view(frame: int) -> View:
        x, z = between(places, frame / step)
        heading = float(between(headings, frame / step)[0])
        forward = np.array([math.sin(heading), 0.0, math.cos(heading)])
        left = np.array([forward[2], 0.0, -forward[0]])
        stand = np.array([x, 0.0, z])
        eye = stand + tall * (-2.3 * forward - 0.75 * left + np.array([0.0, 1.3, 0.0]))
        return look_at(eye, stand + tall * (0.7 * forward + np.array([0.0, 0.55, 0.0])), 48.0)

    return view


def _keyed(keys: Keys, fps: float) -> Callable[[int], View]:
    """A camera through keys, with a continuous velocity."""
    seconds = np.asarray(keys.seconds, float)
    both = np.concatenate([np.asarray(keys.positions, float), np.asarray(keys.targets, float)], axis=1)
    if len(seconds) > 1:
        slopes = np.gradient(both, seconds, axis=0)
        slopes[0] = slopes[-1] = 0.0

    def view(frame: int) -> View:
        time = float(np.clip(frame / fps, seconds[0], seconds[-1]))
        if len(seconds) == 1:
            place = both[0]
        else:
            i = min(int(np.searchsorted(seconds, time, side="right")) - 1, len(seconds) - 2)
            span = seconds[i + 1] - seconds[i]
            t = (time - seconds[i]) / span
            place = (
                (1 + 2 * t) * (1 - t) ** 2 * both[i]
                + t * t * (3 - 2 * t) * both[i + 1]
                + span * t * (1 - t) * ((1 - t) * slopes[i] - t * slopes[i + 1])
            )
        return look_at(place[:3], place[3:], max(_HAZE * float(np.linalg.norm(place[:3] - place[3:])), _LEAST_HAZE))

    return view
