"""A strike that lands: gamma^t I(t) w(t), the greatest of the action's strikes or their sum, less what they cost.

I(t) is 1 when the strike lands: fist or foot is within ``tolerance`` of the surface of the target's body, outside or
inside. The body is the head and the upright torso under it together: a fist that is deep in one of them is not on the
surface of the other. A kick that comes through the body to its far side does not land (``core.bodies.comes_through``).
w(t) is a power of the strike's speed. Each strike that is thrown costs gamma^t ``effort``, and gamma^t ``waste`` more
where its fist ends further than ``WASTED`` from the target's axis.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from crowdsim.core.bodies import comes_through
from crowdsim.core.types import Array
from crowdsim.jit import kernel
from crowdsim.policy.terms.term import TargetBody, Term

WASTED = 0.4
"""Over the ground, how far from the target's axis a fist ends that strikes the air [m]."""


class Surface(NamedTuple):
    """Between which distances from the middle of head or torso a strike lands, squared; where the torso's axis ends.

    Attributes:
        head_least: A fist that is nearer to the head's centre is too deep in it [m^2].
        head_most: One that is further away is not on it.
        torso_least: The same of the torso's axis.
        torso_most: Likewise.
        top: How far the upper end of the axis lies under the head's centre [m].
        end: How far its lower end does.
    """

    head_least: float
    head_most: float
    torso_least: float
    torso_most: float
    top: float
    end: float


@kernel(inline=True)
def read_surface(term):
    """Return the surface of the target of a record; squares, so that what lands is found without roots."""
    tolerance, head, torso = term.tolerance, term.head_radius, term.torso_radius
    return Surface(
        max(head - tolerance, 0.0) ** 2,
        (head + tolerance) ** 2,
        max(torso - tolerance, 0.0) ** 2,
        (torso + tolerance) ** 2,
        term.neck_drop,
        term.pelvis_drop,
    )


@kernel(inline=True)
def lands(fist, origin, head, surface):
    """Return whether a strike lands on a target with its head at a point; without branches, since none is likely.

    Args:
        fist: Where fist or foot is [m]. (x, y, z).
        origin: Where a kick comes from over the ground; of a punch, the fist's own position. (x, z).
        head: Centre of the target's head. (x, y, z).
        surface: ``Surface``.
    """
    (px, py, pz), (x, y, z) = fist, head
    dx, dy, dz = px - x, py - y, pz - z
    aside = dx * dx + dz * dz
    to_head = aside + dy * dy
    dy = py - min(max(py, y - surface.end), y - surface.top)
    to_torso = aside + dy * dy
    on_surface = (
        ((to_head <= surface.head_most) | (to_torso <= surface.torso_most))
        & (to_head >= surface.head_least)
        & (to_torso >= surface.torso_least)
    )
    return on_surface & (not comes_through(px, pz, origin[0], origin[1], x, z))


@kernel(inline=True)
def is_wasted(fist, head, term):
    """Return whether a strike ends far from the axis of a target, over the ground."""
    dx, dz = fist[0] - head[0], fist[2] - head[2]
    return dx * dx + dz * dz > term.wasted * term.wasted


class StrikeTerm(Term):
    """A strike that lands."""

    numbers: ClassVar[tuple[str, ...]] = (
        *("tolerance", "speed_weight", "head_radius", "torso_radius", "neck_drop", "pelvis_drop"),
        *("effort", "waste", "greatest", "wasted"),
    )

    kind: Literal["strike"]
    tolerance: float = Field(
        default=0.10,
        gt=0.0,
        le=1.0,
        description="How far a fist or foot that lands may be from the target's surface, outside or inside [m].",
    )
    speed_weight: float = Field(
        default=0.5,
        ge=0.0,
        le=4.0,
        description="Power of the strike's speed over the mean of all punches, for a kick times the mass of a leg over "
        "that of an arm, 3.2; 0: all count alike.",
    )
    effort: float = Field(
        default=0.0, ge=0.0, le=10.0, description="What each strike costs that is thrown, whether or not it lands."
    )
    waste: float = Field(
        default=0.0, ge=0.0, le=10.0, description="What each strike costs that is far from the target."
    )
    form: Literal["sum", "max"] = Field(
        default="max", description="The greatest of what the action's landed strikes earn, or their sum."
    )

    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return the numbers of its record."""
        sizes = (body.head_radius, body.torso_radius, body.neck_drop, body.pelvis_drop)
        return (self.tolerance, self.speed_weight, *sizes, self.effort, self.waste, float(self.form == "max"), WASTED)

    def earned(self, actions: Any, discount: float) -> Array:
        """Return what each strike earns where it lands, for the weight 1. Shape (K,)."""
        speeds, times = actions.strike_speeds.astype(float), actions.strike_times.astype(float)
        return np.asarray(discount**times * speeds**self.speed_weight)

    def spent(self, actions: Any, discount: float) -> Array:
        """Return what each action costs by the effort of its strikes. Shape (A,)."""
        sums = np.concatenate([[0.0], np.cumsum(discount ** actions.strike_times.astype(float))])
        return self.weight * self.effort * np.diff(sums[actions.strike_offsets])
