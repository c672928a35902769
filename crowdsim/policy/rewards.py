"""What a behaviour is rewarded for: terms that a recipe combines (paper, section 4; equations for r(e, a)).

The reward of one action is the sum of its terms, evaluated exactly where the target is, never interpolated. Time t
counts control frames from the action's state, and gamma is the discount a frame:

* ``strike``: gamma^t I(t) w(t), the greatest of the action's strikes (``max``, the paper's) or their sum; less gamma^t
  ``effort`` for each strike thrown, and gamma^t ``waste`` where its fist ends more than ``WASTED`` from the target's
  axis. I(t) is 1 when the strike lands: its fist is within ``tolerance`` of the surface of the target's head, or of the
  upright torso under it.
* ``proximity``: gamma^t exp(-d(t) / sigma), summed over the action's frames (``sum``, which does not depend on where
  actions are cut) or its greatest (``max``, the paper's). d(t) is how far the target is from where it is wanted: at a
  distance, or between two distances, from the avatar.
* ``transition``: what cuts cost, since they are seen.

To add a term, write its model here, add it to ``TERMS``, and add a branch to ``term_reward`` in ``kernels.py``.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from crowdsim.motion import ground
from crowdsim.yaml_files import Fault

if TYPE_CHECKING:
    from crowdsim.motion.database import MotionDatabase
    from crowdsim.policy.actions import Actions

Array = NDArray[Any]
Metres = Annotated[float, Field(ge=0.0)]

TERM_WIDTH = 12
"""Numbers of a term as compiled code reads it."""


WASTED = 0.5
"""Over the ground, how far from the target's axis a fist ends that strikes the air [m]."""


class TargetBody(BaseModel):
    """The body of a target for whom only the head's centre is known; sizes [m] come from the motion database."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    head_radius: float = 0.11
    torso_radius: float = 0.15
    neck_drop: float = 0.16
    """How far the upper end of the torso's capsule lies under the head's centre."""
    pelvis_drop: float = 0.66
    """How far its lower end does."""


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
    tolerance: float = Field(default=0.10, gt=0.0, le=1.0, description="Fist to surface at the strike's frame [m].")
    speed_weight: float = Field(
        default=0.5,
        ge=0.0,
        le=4.0,
        description="Power of the fist's speed over the mean of all strikes; 0: all count alike.",
    )
    effort: float = Field(
        default=0.0, ge=0.0, le=10.0, description="What each strike costs that is thrown, whether or not it lands."
    )
    waste: float = Field(default=0.0, ge=0.0, le=10.0, description="What each strike costs that is far from the target.")
    form: Literal["sum", "max"] = Field(
        default="max", description="The greatest of what the action's landed strikes earn, or their sum."
    )

    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return weight, tolerance, speed weight, the target's sizes, a place for control, effort, waste, and the form."""
        sizes = (body.head_radius, body.torso_radius, body.neck_drop, body.pelvis_drop)
        return (self.weight, self.tolerance, self.speed_weight, *sizes, 0.0, self.effort, self.waste, float(self.form == "max"))


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
    """What a cut costs: its weight times how visible it is (``Actions.costs``), and an amount for each cut."""

    code: ClassVar[int] = 2
    kind: Literal["transition"]
    each: float = Field(default=0.0, ge=0.0, description="What each cut costs however good it is.")

    def pack(self, body: TargetBody) -> tuple[float, ...]:
        """Return weight and the amount for each cut."""
        return (self.weight, self.each)


TERMS: dict[str, type[Term]] = {"strike": StrikeTerm, "proximity": ProximityTerm, "transition": TransitionTerm}
"""Every reward term there is."""

AnyTerm = Annotated[StrikeTerm | ProximityTerm | TransitionTerm, Field(discriminator="kind")]


def pack_terms(terms: list[Term] | tuple[Term, ...], body: TargetBody) -> Array:
    """Return terms as compiled code reads them: the code, then the term's own numbers. Shape (n, 9), float64."""
    rows = np.zeros((len(terms), TERM_WIDTH))
    for row, term in zip(rows, terms, strict=True):
        numbers = (float(term.code), *term.pack(body))
        row[: len(numbers)] = numbers
    return rows


def target_body(database: MotionDatabase) -> TargetBody:
    """Return the sizes of a target like the performers of a database: radii of its body, medians of how it hangs."""
    heads = database.heads[:, 1]
    return TargetBody(
        head_radius=float(database.body.head_radius),
        torso_radius=float(database.body.torso_radius),
        neck_drop=round(float(np.median(heads - database.necks[:, 1])), 4),
        pelvis_drop=round(float(np.median(heads - database.pelvises[:, 1])), 4),
    )


def surface_distance(point: ArrayLike, head: ArrayLike, body: TargetBody) -> tuple[float, float]:
    """Return how far a point lies from the surfaces of the head and of the torso under it [m], inside or out."""
    point, head = np.asarray(point, dtype=float), np.asarray(head, dtype=float)
    to_head = abs(float(np.linalg.norm(point - head)) - body.head_radius)
    height = min(max(float(point[1]), float(head[1]) - body.pelvis_drop), float(head[1]) - body.neck_drop)
    axis = np.array([head[0], height, head[2]])
    return to_head, abs(float(np.linalg.norm(point - axis)) - body.torso_radius)


def action_reward(
    actions: Actions,
    action: int,
    target: ArrayLike,
    terms: tuple[Term, ...],
    body: TargetBody,
    discount: float,
    velocity: ArrayLike = (0.0, 0.0),
    lasts: float = math.inf,
) -> float:
    """Return r(e, a) for a target (3,) in the ground frame of the action's state: slow and plain, as said above.

    Args:
        actions: All actions.
        action: Which one.
        target: Centre of the target's head [m].
        terms: The terms of the behaviour.
        body: The target's sizes.
        discount: gamma, a control frame.
        velocity: How far the target moves over the ground, along x and z [m a control frame].
        lasts: For how many control frames it moves on.
    """
    start = np.asarray(target, dtype=float)
    step = np.array([velocity[0], 0.0, velocity[1]])  # type: ignore[index]
    total = 0.0
    for term in terms:
        if isinstance(term, StrikeTerm):
            found, spent = [0.0], 0.0
            for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
                t = float(actions.strike_times[strike])
                place = start + min(t, lasts) * step
                away = actions.strike_places[strike].astype(float) - place
                spent += discount**t * (term.effort + term.waste * (math.hypot(away[0], away[2]) > WASTED))
                if min(surface_distance(actions.strike_places[strike], place, body)) <= term.tolerance:
                    found.append(discount**t * float(actions.strike_speeds[strike]) ** term.speed_weight)
            total += term.weight * ((max(found) if term.form == "max" else sum(found)) - spent)
        elif isinstance(term, ProximityTerm):
            path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]].astype(float)
            values = []
            for t, place in enumerate(path, start=1):
                x, _, z = ground.to_local(place, start + min(t, lasts) * step)
                ahead = z if term.facing else math.hypot(x, z)
                gap = ahead - min(max(ahead, term.between[0]), term.between[1])
                if term.facing:
                    gap = math.hypot(gap, max(abs(x) - term.aside, 0.0))
                gap = abs(gap)
                values.append(discount**t * math.exp(-gap / term.sigma))
            total += term.weight * (sum(values) if term.form == "sum" else max(values))
        elif isinstance(term, TransitionTerm):
            cost = float(actions.costs[action])
            total -= term.weight * cost + (term.each if cost > 0.0 else 0.0)
    return total
