"""Frames all avatars from the side of the crowd."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from crowdsim.render.framing import frame_crowd
from crowdsim.render.view import View
from crowdsim.scenario.camera import Camera

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage


class SideCamera(Camera):
    """Frames all avatars from the side of the crowd."""

    kind: Literal["side"] = Field(description="Frames all avatars from the side of the crowd.")

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        return frame_crowd(footage.crowd, "side", footage.size, self.field)


CAMERA = SideCamera
