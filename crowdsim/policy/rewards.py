"""What a behaviour is rewarded for: terms that a recipe combines (paper, section 4; equations for r(e, a)).

The reward of one action is the sum of its terms, evaluated exactly where the target is, never interpolated. Time t
counts control frames from the action's state, and gamma is the discount a frame:

* ``strike``: gamma^t I(t) w(t), the greatest of the action's strikes (``max``, the paper's) or their sum; less gamma^t
  ``effort`` for each strike thrown, and gamma^t ``waste`` where its fist ends more than ``WASTED`` from the target's
  axis. I(t) is 1 when the strike lands: fist or foot is within ``tolerance`` of the surface of the target's body,
  outside or inside (``lands``). The body is the head and the upright torso under it together, so that the signed
  distance from it is the lesser of the two (``surface_distance``): a fist that is deep in one of them is not on the
  surface of the other. A kick that comes through the body to its far side does not land (``comes_through``).
* ``proximity``: gamma^t exp(-d(t) / sigma), summed over the action's frames (``sum``, which does not depend on where
  actions are cut) or its greatest (``max``, the paper's). d(t) is how far the target is from where it is wanted: at a
  distance, or between two distances, from the avatar.
* ``transition``: what transitions cost, since they are visible.

To add a term, write its model with a code of its own, add it to ``TERMS`` and ``AnyTerm``, define what it is worth in
``action_rewards.py`` and in ``term_reward`` of ``kernels/rewards.py``, and list it in ``COMPILED``: training knows it
then. Control has kernels of its own for behaviours with the look-up v: ``SUPPORTED_TERMS`` in ``crowd/model.py`` says
what they need. A term that is not listed is refused, never taken for another one. Terms other than strikes depend on
where the target is over the ground, not on its height.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, model_validator

from crowdsim.config.files import Fault
from crowdsim.core.bodies import BEYOND
from crowdsim.core.types import Array
from crowdsim.errors import RecipeError

if TYPE_CHECKING:
    from crowdsim.motion.database import MotionDatabase

Metres = Annotated[float, Field(ge=0.0)]

TERM_WIDTH = 13
"""Numbers of a term as compiled code reads it."""


WASTED = 0.4
"""Over the ground, how far from the target's axis a fist ends that strikes the air [m]."""


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

    def under(self, head: ArrayLike, scale: ArrayLike = 1.0) -> tuple[Array, Array, Array, Array]:
        """Return upper and lower ends of the torsos under heads (..., 3), and radii of heads and torsos (...) [m].

        Args:
            head: Centres of the heads [m]. Shape (..., 3).
            scale: Sizes of the bodies. Shape (...).
        """
        heads, sizes = np.asarray(head, dtype=float), np.asarray(scale, dtype=float)
        down = np.array([0.0, -1.0, 0.0]) * sizes[..., None]
        necks, pelvises = heads + self.neck_drop * down, heads + self.pelvis_drop * down
        return necks, pelvises, self.head_radius * sizes, self.torso_radius * sizes


class Term(BaseModel):
    """What all reward terms share."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    code: ClassVar[int]
    weight: float = Field(default=1.0, ge=0.0, description="How much the term counts in the sum.")

    @abstractmethod
    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return the term's numbers after its code, as compiled code reads them."""


class StrikeTerm(Term):
    """A strike that lands."""

    code: ClassVar[int] = 0
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
        """Return weight, tolerance, speed weight, sizes, a place for control, effort, waste, form and ``WASTED``."""
        sizes = (body.head_radius, body.torso_radius, body.neck_drop, body.pelvis_drop)
        return (
            self.weight,
            self.tolerance,
            self.speed_weight,
            *sizes,
            0.0,
            self.effort,
            self.waste,
            float(self.form == "max"),
            WASTED,
        )


class ProximityTerm(Term):
    """Being near the target."""

    code: ClassVar[int] = 1
    kind: Literal["proximity"]
    distance: Metres | tuple[Metres, Metres] | None = Field(
        default=None,
        description="Where the target is wanted: this far away, or between two distances; null: where strikes reach "
        "it, by the data [m].",
    )
    sigma: float = Field(default=0.5, gt=0.0, description="How fast the reward falls with the distance from there [m].")
    form: Literal["sum", "max"] = Field(
        default="sum", description="Summed over the action's frames, or their greatest."
    )
    facing: bool = Field(
        default=False, description="Whether the target is wanted straight ahead, rather than anywhere round."
    )
    aside: float = Field(
        default=0.0, ge=0.0, description="With facing: how far to the side of straight ahead is as good [m]."
    )

    @model_validator(mode="after")
    def _upwards(self) -> ProximityTerm:
        if isinstance(self.distance, tuple) and self.distance[0] > self.distance[1]:
            raise Fault(f"is {list(self.distance)}, expected the nearer distance first", "distance")
        return self

    @property
    def between(self) -> tuple[float, float]:
        """Least and greatest distance at which the target is wanted [m]."""
        if self.distance is None:
            raise ValueError("the distance is not known yet; see ranges.resolve_terms")
        return self.distance if isinstance(self.distance, tuple) else (self.distance, self.distance)

    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return weight, least distance, sigma, whether it is the greatest, facing, greatest distance, aside."""
        near, far = self.between
        return (self.weight, near, self.sigma, float(self.form == "max"), float(self.facing), far, self.aside)


class TransitionTerm(Term):
    """What a transition costs: its weight times how visible it is (``Actions.costs``), and an amount for each one."""

    code: ClassVar[int] = 2
    kind: Literal["transition"]
    each: float = Field(default=0.0, ge=0.0, description="What each transition costs however good it is.")

    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return weight and the amount for each transition."""
        return (self.weight, self.each)


TERMS: dict[str, type[Term]] = {"strike": StrikeTerm, "proximity": ProximityTerm, "transition": TransitionTerm}
"""Every reward term there is."""

COMPILED: tuple[type[Term], ...] = (StrikeTerm, ProximityTerm, TransitionTerm)
"""Terms that have a branch in ``term_reward`` of ``kernels/rewards.py``; no others reach compiled code."""

AnyTerm = Annotated[StrikeTerm | ProximityTerm | TransitionTerm, Field(discriminator="kind")]


def pack_terms(terms: list[Term] | tuple[Term, ...], body: TargetBody) -> Array:
    """Return terms as compiled code reads them: the code, then the term's own numbers. Shape (n, 13), float64.

    Raises:
        RecipeError: A term is unknown to compiled code.
    """
    rows = np.zeros((len(terms), TERM_WIDTH))
    for row, term in zip(rows, terms, strict=True):
        if not isinstance(term, COMPILED):
            raise unknown_term(term)
        numbers = (float(term.code), *term.pack(body))
        row[: len(numbers)] = numbers
    return rows


def term_name(term: Term) -> str:
    """Return what a recipe calls a term."""
    return str(getattr(term, "kind", type(term).__name__))


def supported(terms: tuple[type[Term], ...]) -> str:
    """Return the end of a message: which of ``TERMS`` were expected."""
    return f"expected one of {', '.join(name for name, term in TERMS.items() if issubclass(term, terms))}"


def unknown_term(term: Term) -> RecipeError:
    """Return the error of a term that training does not evaluate."""
    return RecipeError(f"{term_name(term)!r} is no reward term of training, {supported(COMPILED)}")


def target_body(database: MotionDatabase) -> TargetBody:
    """Return the sizes of a target like the performers of a database: radii of its body, medians of how it hangs."""
    standing = database.standing(database.stride)
    heads = database.heads[standing, 1]
    return TargetBody(
        head_radius=float(database.body.head_radius),
        torso_radius=float(database.body.torso_radius),
        neck_drop=round(float(np.median(heads - database.necks[standing, 1])), 4),
        pelvis_drop=round(float(np.median(heads - database.pelvises[standing, 1])), 4),
    )


def surface_distance(point: ArrayLike, head: ArrayLike, body: TargetBody) -> float:
    """Return the signed distance of a point from the surface of a target's body [m]: negative inside."""
    return float(posed_distance(point, head, *body.under(head)))


def posed_distance(
    point: ArrayLike,
    head: ArrayLike,
    neck: ArrayLike,
    pelvis: ArrayLike,
    head_radius: ArrayLike,
    torso_radius: ArrayLike,
) -> Array:
    """Return the signed distances of points from the surfaces of bodies, negative inside [m]. Shape (...).

    A body is the union of head and torso, a ball and a capsule, and the distance the lesser of those from the two.

    Args:
        point: The points [m]. Shape (..., 3).
        head: Centres of the heads [m]. Shape (..., 3).
        neck: Upper ends of the torsos [m]. Shape (..., 3).
        pelvis: Their lower ends [m]. Shape (..., 3).
        head_radius: Radii of the heads [m]. Shape (...).
        torso_radius: Radii of the torsos [m]. Shape (...).
    """
    places, upper = np.asarray(point, dtype=float), np.asarray(neck, dtype=float)
    axis = np.asarray(pelvis, dtype=float) - upper
    share = np.sum((places - upper) * axis, axis=-1) / np.maximum(np.sum(axis * axis, axis=-1), 1e-12)
    middle = upper + np.clip(share, 0.0, 1.0)[..., None] * axis
    to_head = np.linalg.norm(places - np.asarray(head, dtype=float), axis=-1) - head_radius
    return np.asarray(np.minimum(to_head, np.linalg.norm(places - middle, axis=-1) - torso_radius))


def comes_through(point: ArrayLike, origin: ArrayLike, head: ArrayLike) -> bool:
    """Return whether a kick comes through a body (``core.bodies.comes_through``), which is no way to land on it.

    Args:
        point: Where the foot is [m]. Shape (3,).
        origin: Where the kick comes from over the ground, or of a punch the fist's own position [m]. Shape (2,).
        head: Centre of the head over the torso's axis [m]. Shape (3,).
    """
    (x, _, z), (from_x, from_z), (axis_x, _, axis_z) = np.asarray(point), np.asarray(origin), np.asarray(head)
    far = (float(x) - from_x) ** 2 + (float(z) - from_z) ** 2
    return bool(far > BEYOND * ((axis_x - from_x) ** 2 + (axis_z - from_z) ** 2))


def lands(distance: float, tolerance: float) -> bool:
    """Return whether a fist lands at a signed distance from a body's surface: not too far outside, nor too deep [m]."""
    return -tolerance <= distance <= tolerance
