"""What suits the crowd: ``fight`` for two to four avatars, else one that frames all of them obliquely or from aside."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from crowdsim.render.cameras.fight import FightCamera
from crowdsim.render.framing import frame_crowd
from crowdsim.render.view import View
from crowdsim.scenario.camera import Camera

if TYPE_CHECKING:
    from crowdsim.render.camera import Footage

_FIGHT = range(2, 5)
"""Numbers of avatars that ``fight`` shows."""


class AutoCamera(Camera):
    """`fight` for two to four avatars, else one of fixed direction that frames all avatars."""

    kind: Literal["auto"] = Field(
        description="`fight` for two to four avatars, else one of fixed direction that frames all avatars."
    )

    def plan(self, footage: Footage) -> Callable[[float], View]:
        """Return the view at each frame."""
        if len(footage.crowd.present) in _FIGHT:
            return FightCamera(kind="fight", lens=self.lens).plan(footage)
        return frame_crowd(footage.crowd, "auto", footage.size, self.field)


CAMERA = AutoCamera
