"""Circles the crowd and frames all of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from crowdsim.render.framing import orbit_elevation, rings_around
from crowdsim.render.view import View
from crowdsim.scenario.camera import Camera

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage


class OrbitCamera(Camera):
    """Circles the crowd and frames all of it."""

    kind: Literal["orbit"] = Field(description="Circles the crowd and frames all of it.")
    lap: float = Field(default=30.0, gt=0, le=3600, description="Time of one lap [s].")
    clockwise: bool = Field(default=False, description="Whether it circles clockwise, seen from above.")
    elevation: float | None = Field(
        default=None, ge=0, le=89, description="How far down it looks [degrees]; what suits the crowd without it."
    )
    distance: float | None = Field(
        default=None, gt=0, le=100_000, description="Level distance to the middle [m]; as near as shows all without it."
    )

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        crowd, size, field = footage.crowd, footage.size, self.field
        rings = rings_around(crowd)
        chosen = orbit_elevation(rings, crowd.avatars) if self.elevation is None else math.radians(self.elevation)
        turn = (-1.0 if self.clockwise else 1.0) * 2.0 * math.pi / (self.lap * crowd.fps)
        facing, distance = crowd.facing, self.distance

        def view(frame: float) -> View:
            return rings.view(frame, facing + turn * frame, chosen, size, field, distance)

        return view


CAMERA = OrbitCamera
