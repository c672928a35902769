"""Sources of pictures: anything that gives positions and poses of its avatars."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from crowdsim.core.types import Array
from crowdsim.render.figure import Figure
from crowdsim.scenario.camera import Camera


@dataclass(frozen=True)
class Shown:
    """What is to be seen of a source.

    Attributes:
        stop: One past the last frame that is drawn after one another.
        scales: Returns at how many pixels a metre each avatar shows at a frame, 0 where nothing of it does. Shape (N,).
    """

    stop: int
    scales: Callable[[int], Array]


class PoseSource(Protocol):
    """Motion of N avatars at the rate of the pictures.

    Frames are output frames, from 0. Every method is a pure function of its arguments, whatever was called before and
    whichever thread asks. With ``jobs`` above one the source goes to other processes through pickle.
    """

    @property
    def name(self) -> str:
        """What it is called in captions."""

    @property
    def fingerprint(self) -> str:
        """A text that differs whenever any picture would."""

    @property
    def fps(self) -> float:
        """Frames a second."""

    @property
    def frame_count(self) -> int:
        """Number of frames."""

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Cameras that can be had by name: those of its scenario."""

    @property
    def avatar_names(self) -> Sequence[str]:
        """Name of each avatar. Length N."""

    @property
    def avatar_teams(self) -> Array:
        """Number of each avatar's team, from 0. Shape (N,)."""

    @property
    def avatar_scales(self) -> Array:
        """Size of each avatar, by which its figure's capsules grow. Shape (N,)."""

    @property
    def avatar_girths(self) -> Array:
        """How thick each avatar's trunk and limbs are for their length. Shape (N,)."""

    @property
    def avatar_stretches(self) -> Array:
        """How long the bones of each avatar's trunk, legs and arms are for its size. Shape (N, 3)."""

    @property
    def avatar_heights(self) -> Array:
        """Standing height of each avatar [m]; cameras leave room for it. Shape (N,)."""

    @property
    def figures(self) -> Sequence[Figure]:
        """The kinds of bodies; a ``crowdsim.motion.body.Body`` is a figure."""

    @property
    def avatar_figures(self) -> Array:
        """Index of each avatar's figure. Shape (N,)."""

    @property
    def avatar_colours(self) -> Array:
        """Colour of each avatar instead of its team's: red, green, blue in 0..1, NaN for none. Shape (N, 3)."""

    @property
    def arena(self) -> Array:
        """The arena: kind (0 none, 1 circle, 2 rectangle), centre x and z, half the sizes along x and z [m].

        Shape (5,).
        """

    def ground(self, frames: Array) -> Array:
        """Return the ground transforms of all avatars at some frames; NaN while absent. Shape (n, N, 3)."""

    def poses(self, frame: int, shown: Shown | None = None) -> list[tuple[Array, Array]]:
        """Return for each figure the poses of its avatars, ascending, at a frame.

        Args:
            frame: The frame.
            shown: What is to be seen of them; everything when None. What is hardly seen may be left out.

        Returns:
            World positions [m] (n, J, 3) and rotations (n, J, 4), scaled already and NaN while absent or out of sight,
            a pair a figure.
        """

    def recent_strikes(self, frame: int) -> tuple[Array, Array, Array, Array]:
        """Return the strikes at somebody that reached furthest within the last 0.4 s before a frame.

        Returns:
            Points [m] (H, 3), time since [s] (H,), speeds [m/s] (H,), numbers of ``crowd.events.OUTCOMES`` (H,).
        """

    def markers(self, frame: int) -> Array:
        """Return the positions of scripted targets and the like [m]. Shape (G, 3)."""


def no_strikes() -> tuple[Array, Array, Array, Array]:
    """Return what ``recent_strikes`` gives where there were none."""
    return np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros(0, np.uint8)
