"""Sees what an avatar sees."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field

from crowdsim.core.types import Array
from crowdsim.errors import CrowdsimError
from crowdsim.render.crowd_path import between, filled, hann
from crowdsim.render.view import View, look_at
from crowdsim.scenario.camera import AvatarRef, Camera, avatar_number

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage

_SMOOTH = 0.12
"""Time to either side over which the movement of the head is smoothed [s]."""
_FIELD = 70.0
"""Field of view without a lens [degrees]."""
_FACE = 0.16
"""How far before the middle of the head the eyes are [m]: no camera sees its own nose."""
_SEES = 25.0
"""How far it looks [m]."""
_SCALE = 400.0


class EyeCamera(Camera):
    """Sees what an avatar sees."""

    follows = "avatar"

    sees_through = False

    kind: Literal["eye"] = Field(description="Sees what an avatar sees, 70 degrees high without a lens.")
    avatar: AvatarRef = Field(default=0, description="Number or name of the avatar.")

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        field = math.radians(_FIELD) if self.lens is None else self.lens.field
        source = footage.source
        number = avatar_number(self.avatar, source.avatar_names)
        heads, step = _heads(footage, number)
        if not np.isfinite(heads).any():
            raise CrowdsimError(f"camera eye: avatar {source.avatar_names[number]} is in none of these frames")
        heads = filled(heads[:, None])[:, 0]
        heads = hann(heads, max(1, round(_SMOOTH * source.fps / step)))

        def view(frame: float) -> View:
            place = between(heads, frame / step)
            ahead = place[3:] / np.linalg.norm(place[3:])
            return look_at(place[:3] + _FACE * ahead, place[:3] + ahead, field, _SEES)

        return view

    def avatars_named(self) -> Iterator[tuple[tuple[str | int, ...], int | str]]:
        """Yield the key of each avatar that the camera names, and its number or name."""
        yield ("avatar",), self.avatar


def _heads(footage: Footage, number: int) -> tuple[Array, int]:
    """Return where a head is and where it looks, some thirty times a second (M, 6), NaN while absent; and the step.

    Figures without a face look where they are headed, from nine tenths of their height.
    """
    from crowdsim.motion import quaternion
    from crowdsim.motion.body import Body
    from crowdsim.poses.facing import face_direction
    from crowdsim.render.source import Shown

    source = footage.source
    step = max(1, round(source.fps / 30.0))
    figure = int(source.avatar_figures[number])
    row = int(np.count_nonzero(source.avatar_figures[:number] == figure))
    body = source.figures[figure]
    scales = np.where(np.arange(len(source.avatar_figures)) == number, _SCALE, 0.0)
    shown = Shown(source.frame_count, lambda _: scales)
    frames = np.arange(0, max(source.frame_count, 1), step)
    found = np.full((len(frames), 6), np.nan)
    for moment, frame in enumerate(frames):
        if isinstance(body, Body):
            positions, rotations = (part[row] for part in source.poses(int(frame), shown)[figure])
            joint = body.roles["head"]
            offset = np.asarray(body.head_offset, float) * float(source.avatar_scales[number])
            found[moment, :3] = positions[joint] + quaternion.rotate(rotations[joint], offset)
            found[moment, 3:] = quaternion.rotate(rotations[joint], face_direction(body))
        else:
            x, z, heading = source.ground(np.array([frame]))[0, number]
            found[moment] = x, 0.9 * source.avatar_heights[number], z, math.sin(heading), 0.0, math.cos(heading)
    return found, step


CAMERA = EyeCamera
