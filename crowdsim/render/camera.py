"""Cameras: where the eye is at every frame of a take.

A camera is made from the whole take before the first picture, so that any range of frames shows what the whole shows.
It knows the crowd at a few moments a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import CrowdsimError, nearest
from crowdsim.render.crowd_path import Crowd, between, filled, hann, watch
from crowdsim.render.framing import HAZE, LEAST_HAZE, frame_crowd, orbit_crowd
from crowdsim.render.raycast import sun_direction
from crowdsim.render.source import PoseSource
from crowdsim.render.view import View, look_at

CAMERAS = ("auto", "orbit", "follow:AVATAR", "top", "side", "front")


@dataclass(frozen=True)
class Keys:
    """A camera that moves through given positions.

    Attributes:
        seconds: Times, ascending [s]. Shape (K,).
        positions: Position of the eye at each [m]. Shape (K, 3).
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
    """Return the camera that a text names, ``follow:`` with a number; several joined by '+' are drawn side by side.

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
    # The sun is over the shoulder of the camera auto, so that shadows fall away from it and to the right.
    sun = sun_direction(crowd.facing + math.pi + 1.05)
    if isinstance(camera, Keys):
        return Track(_keyed(camera, source.fps), sun)
    kind, _, avatar = parse_camera(camera, crowd.avatars, tuple(source.avatar_names)).partition(":")
    if kind == "follow":
        return Track(_following(source, int(avatar)), sun)
    if kind == "orbit":
        return Track(orbit_crowd(crowd, size), sun)
    return Track(frame_crowd(crowd, kind, size), sun)


def _following(source: PoseSource, avatar: int) -> Callable[[int], View]:
    """A camera behind the shoulder of one avatar."""
    step = max(1, round(source.fps / 10.0))
    frames = np.arange(0, max(source.frame_count, 1) - 1 + step, step).clip(max=max(source.frame_count - 1, 0))
    block = max(1, 400_000 // max(len(source.avatar_teams), 1))
    path = np.concatenate([source.ground(frames[i : i + block])[:, avatar] for i in range(0, len(frames), block)])
    path = filled(path[:, None])[:, 0]
    tall = float(source.avatar_heights[avatar])
    smooth = hann(path[:, :2], round(0.8 * source.fps / step))
    headings = hann(np.unwrap(path[:, 2])[:, None], round(1.6 * source.fps / step))

    def view(frame: int) -> View:
        x, z = between(smooth, frame / step)
        heading = float(between(headings, frame / step)[0])
        forward = np.array([math.sin(heading), 0.0, math.cos(heading)])
        left = np.array([forward[2], 0.0, -forward[0]])
        stand = np.array([x, 0.0, z])
        eye = stand + tall * (-2.4 * forward - 0.75 * left + np.array([0.0, 1.55, 0.0]))
        return look_at(eye, stand + tall * (0.7 * forward + np.array([0.0, 0.5, 0.0])), 48.0)

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
        return look_at(place[:3], place[3:], max(HAZE * float(np.linalg.norm(place[:3] - place[3:])), LEAST_HAZE))

    return view
