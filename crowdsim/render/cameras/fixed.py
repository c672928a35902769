"""Stays in one position, and looks at a point or turns after an avatar."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field, model_validator

from crowdsim.config.files import Fault
from crowdsim.render.view import View, look_at
from crowdsim.scenario.camera import AvatarRef, Camera, Position, avatar_number

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage

_CHEST = 0.65
"""Height that it looks at of an avatar, as a share of its height."""
_NEAREST = 0.3
"""How near what it looks at may come [m]."""


class FixedCamera(Camera):
    """Stays in one position, and looks at a point or turns after an avatar."""

    sees_through = False

    kind: Literal["fixed"] = Field(description="Stays in one position, and looks at a point or turns after an avatar.")
    position: Position = Field(description="Position of the camera, x, y and z [m].")
    look_at: Position | None = Field(
        default=None, description="Point in the middle of the picture, x, y and z [m]; (0, 1, 0) if nothing is named."
    )
    avatar: AvatarRef | None = Field(
        default=None, description="Number or name of the avatar that it turns after, instead of looking at a point."
    )

    @model_validator(mode="after")
    def _check(self) -> FixedCamera:
        if self.look_at is not None and self.avatar is not None:
            raise Fault("is given beside look_at, expected one of them", "avatar")
        if self.avatar is None and self.position == (self.look_at or (0.0, 1.0, 0.0)):
            raise Fault("is the point that it looks at, expected another one", "position")
        return self

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        eye, field = np.array(self.position, float), self.field
        if self.avatar is None:
            target = np.array(self.look_at or (0.0, 1.0, 0.0), float)
            still = look_at(eye, target, field)
            return lambda frame: still
        number = avatar_number(self.avatar, footage.source.avatar_names)
        path, height = footage.path(number, 0.5), _CHEST * float(footage.source.avatar_heights[number])

        def view(frame: float) -> View:
            x, z = path(frame)
            target = np.array([x, height, z])
            if np.linalg.norm(target - eye) < _NEAREST:
                target = eye + np.array([0.0, 0.0, _NEAREST])
            return look_at(eye, target, field)

        return view

    def avatars_named(self) -> Iterator[tuple[tuple[str | int, ...], int | str]]:
        """Yield the key of each avatar that the camera names, and its number or name."""
        if self.avatar is not None:
            yield ("avatar",), self.avatar


CAMERA = FixedCamera
