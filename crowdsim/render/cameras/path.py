"""Moves through keys in time, with a continuous velocity."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field, model_validator

from crowdsim.config.files import Fault, StrictModel
from crowdsim.render.view import View, look_at
from crowdsim.scenario.camera import Camera, Position
from crowdsim.scenario.parts import MAXIMUM_SECONDS

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage


class CameraKey(StrictModel):
    """Where the camera is at a time."""

    seconds: float = Field(ge=0, le=MAXIMUM_SECONDS, description="Time from the start of the run [s].")
    position: Position = Field(description="Position of the camera, x, y and z [m].")
    look_at: Position = Field(description="Point in the middle of the picture, x, y and z [m].")


class PathCamera(Camera):
    """Moves smoothly through keys in time."""

    sees_through = False

    kind: Literal["path"] = Field(description="Moves smoothly through keys in time.")
    keys: tuple[CameraKey, ...] = Field(min_length=1, description="Where it is at which time, in order of time.")

    @model_validator(mode="after")
    def _check(self) -> PathCamera:
        for i, key in enumerate(self.keys):
            if key.position == key.look_at:
                raise Fault("is the position itself, expected a point that it looks at", "keys", i, "look_at")
            if i and key.seconds <= self.keys[i - 1].seconds:
                before = self.keys[i - 1].seconds
                raise Fault(f"is {key.seconds}, expected more than {before} before it", "keys", i, "seconds")
        return self

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        seconds = np.array([key.seconds for key in self.keys])
        both = np.array([[*key.position, *key.look_at] for key in self.keys])
        slopes = np.zeros_like(both)
        if len(seconds) > 2:
            slopes[1:-1] = np.gradient(both, seconds, axis=0)[1:-1]
        fps, field = footage.crowd.fps, self.field

        def view(frame: float) -> View:
            time = float(np.clip(frame / fps, seconds[0], seconds[-1]))
            i = max(min(int(np.searchsorted(seconds, time, side="right")) - 1, len(seconds) - 2), 0)
            j = min(i + 1, len(seconds) - 1)
            span = max(float(seconds[j] - seconds[i]), 1e-9)
            t = (time - seconds[i]) / span
            place = (
                (1 + 2 * t) * (1 - t) ** 2 * both[i]
                + t * t * (3 - 2 * t) * both[j]
                + span * t * (1 - t) * ((1 - t) * slopes[i] - t * slopes[j])
            )
            return look_at(place[:3], place[3:], field)

        return view


CAMERA = PathCamera
