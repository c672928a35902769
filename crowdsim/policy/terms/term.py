"""What all reward terms share."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

Metres = Annotated[float, Field(ge=0.0)]


class TargetBody(BaseModel):
    """The body of a target of which only the head's centre is known; sizes [m] come from the motion database.

    Training, control and poses give targets this body, the latter two with the scale of the attacker.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    head_radius: float = 0.11
    torso_radius: float = 0.15
    neck_drop: float = 0.16
    """How far the upper end of the torso's capsule lies under the head's centre."""
    pelvis_drop: float = 0.66
    """How far its lower end does."""

    def under(self, head: Any, scale: Any = 1.0) -> tuple[Any, Any, Any, Any]:
        """Return upper and lower ends of the torsos under heads (..., 3), and radii of heads and torsos (...) [m].

        Args:
            head: Centres of the heads [m]. Shape (..., 3).
            scale: Sizes of the bodies. Shape (...).
        """
        heads, sizes = np.asarray(head, dtype=float), np.asarray(scale, dtype=float)
        down = np.array([0.0, -1.0, 0.0]) * sizes[..., None]
        necks, pelvises = heads + self.neck_drop * down, heads + self.pelvis_drop * down
        return necks, pelvises, self.head_radius * sizes, self.torso_radius * sizes


class Seen(NamedTuple):
    """A target at one frame of an action, in the ground frame of the action's start; in one precision.

    Attributes:
        dx: How far the target's head is from the avatar over the ground, along x [m].
        dz: Along z.
        sin: Sine of the avatar's heading.
        cos: Its cosine.
        facing_sin: Sine of the target's heading, where a grid has the axis ``heading``; else 0.
        facing_cos: Its cosine; else 1.
        due: Control frames until the target's strike reaches furthest, far more than an action has where none is seen.
    """

    dx: Any
    dz: Any
    sin: Any
    cos: Any
    facing_sin: Any
    facing_cos: Any
    due: Any


class Term(BaseModel):
    """A reward term: keys of a recipe, and the numbers that compiled code reads of it.

    Attributes:
        numbers: Names of the fields of a record (``registry.TERM``) that this kind of term writes.
        at_frames: Of a term that counts at each frame of a path, two inlined kernels. ``read(record, number)`` returns
            its numbers in the precision ``number``. ``gap(seen, numbers)`` returns how far a moment (``Seen``) is from
            what is wanted, from 0 on: the moment is worth exp(-gap).
        axes: Axes that a grid must have.
        sign: -1 for a term that is a cost, else 1.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    numbers: ClassVar[tuple[str, ...]] = ()
    at_frames: ClassVar[tuple[Any, Any] | None] = None
    axes: ClassVar[tuple[str, ...]] = ()
    sign: ClassVar[float] = 1.0

    weight: float = Field(default=1.0, ge=0.0, description="How much the term counts in the sum.")

    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return what ``numbers`` names, for a target of some sizes."""
        return tuple(float(getattr(self, name)) for name in self.numbers)

    def of_actions(self, actions: Any) -> Any:
        """Return what each action earns wherever the target is. Shape (A,), or 0."""
        return 0.0
