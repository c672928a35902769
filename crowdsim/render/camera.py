"""Cameras over a whole take: what they film, and how they are planned.

A camera is made from the whole take before the first picture, so that any range of frames shows what the whole shows.
It knows the crowd at a few moments a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import CrowdsimError
from crowdsim.render.crowd_path import Crowd, between, filled, hann, watch
from crowdsim.render.view import View
from crowdsim.scenario.camera_files import camera_in_file
from crowdsim.scenario.cameras import Chosen, check_avatars, chosen_cameras

if TYPE_CHECKING:
    from crowdsim.render.source import PoseSource
    from crowdsim.scenario.camera import Camera


@dataclass(frozen=True)
class Footage:
    """What a camera films.

    Attributes:
        source: Where motion comes from.
        crowd: Where the crowd is over the whole take.
        size: Width and height of the picture [px].
    """

    source: PoseSource
    crowd: Crowd
    size: tuple[int, int]

    def ground_path(self, avatar: int) -> tuple[Array, int]:
        """Return ground transforms of an avatar at about ten moments a second (M, 3), headings unwrapped, and a step.

        The step is the number of frames between them.
        """
        source = self.source
        step = max(1, round(source.fps / 10.0))
        frames = np.arange(0, max(source.frame_count, 1) - 1 + step, step).clip(max=max(source.frame_count - 1, 0))
        block = max(1, 400_000 // max(len(source.avatar_teams), 1))
        path = np.concatenate([source.ground(frames[i : i + block])[:, avatar] for i in range(0, len(frames), block)])
        path = filled(path[:, None])[:, 0]
        path[:, 2] = np.unwrap(path[:, 2])
        return path, step

    def path(self, avatar: int, seconds: float) -> Callable[[float], Array]:
        """Return where an avatar is at a frame, x and z [m], smoothed over a time to either side [s]."""
        path, step = self.ground_path(avatar)
        smooth = hann(path[:, :2], max(1, round(seconds * self.source.fps / step)))
        return lambda frame: between(smooth, frame / step)


@dataclass(frozen=True)
class Track:
    """A camera over a whole take.

    Attributes:
        view: The view at a frame.
        sun: Unit direction to the sun. Shape (3,).
    """

    view: Callable[[float], View]
    sun: Array


def resolve_camera(source: PoseSource, chosen: Chosen) -> tuple[Camera, ...]:
    """Return the cameras that are chosen for a source; of several, pictures are drawn side by side.

    Args:
        source: What they film; its cameras can be had by name.
        chosen: A camera; or text: the name of one, a kind, ``follow:AVATAR``, or ``FILE.yaml#NAME``; several joined by
            '+'.

    Raises:
        CrowdsimError: There is no such camera or avatar.
    """
    in_file = camera_in_file(chosen) if isinstance(chosen, str) else None
    found = (in_file,) if in_file is not None else chosen_cameras(chosen, source.cameras)
    for camera in found:
        for finding in check_avatars(camera, source.avatar_names):
            raise CrowdsimError(f"camera {chosen if isinstance(chosen, str) else camera.kind!r}: {finding.message}")
    return tuple(camera.numbered(source.avatar_names) for camera in found)


def build_track(source: PoseSource, camera: Chosen, size: tuple[int, int], crowd: Crowd | None = None) -> Track:
    """Return one camera over a whole take.

    Args:
        source: The take.
        camera: The camera, see ``resolve_camera``; not several.
        size: Width and height of the picture [px].
        crowd: What ``watch`` gives, where it is known already.

    Raises:
        CrowdsimError: There is no such camera or avatar.
    """
    from crowdsim.render.raycast import sun_direction

    crowd = watch(source) if crowd is None else crowd
    # The sun is over the shoulder of the camera auto, so that shadows fall away from it and to the right.
    sun = sun_direction(crowd.facing + math.pi + 1.05)
    (one,) = resolve_camera(source, camera)
    plan, lens = one.plan(Footage(source, crowd, size)), one.lens
    keys: dict[str, Any] = {"sees_through": one.sees_through}
    if lens is not None:
        keys.update(aperture=lens.aperture, focus=lens.focus)
    return Track(lambda frame: replace(plan(frame), **keys), sun)
