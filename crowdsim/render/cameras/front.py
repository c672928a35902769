"""Frames all avatars from the front: along the crowd, or into the face of one alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from crowdsim.render.framing import frame_crowd
from crowdsim.render.view import View
from crowdsim.scenario.camera import Camera

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage


class FrontCamera(Camera):
    """Frames all avatars from the front: along the crowd, or into the face of one alone."""

    kind: Literal["front"] = Field(
        description="Frames all avatars from the front: along the crowd, or into the face of one alone."
    )

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        return frame_crowd(footage.crowd, "front", footage.size, self.field)


CAMERA = FrontCamera
