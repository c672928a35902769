"""Frames all avatars from above."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from crowdsim.render.framing import frame_crowd
from crowdsim.render.view import View
from crowdsim.scenario.camera import Camera

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage


class TopCamera(Camera):
    """Frames all avatars from above."""

    kind: Literal["top"] = Field(description="Frames all avatars from above.")

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        return frame_crowd(footage.crowd, "top", footage.size, self.field)


CAMERA = TopCamera
