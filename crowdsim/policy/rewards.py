"""What a behaviour is rewarded for: terms that a recipe combines (paper, section 4; equations for r(e, a)).

The reward of one action is the sum of its terms, each a file in ``terms``, evaluated exactly where the target is, never
interpolated. Time t counts control frames from the action's state, and gamma is the discount a frame. Terms other than
strikes depend on where the target is over the ground and, where a grid has these axes, on its heading and the time to
its strike; not on its height.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.policy.terms.hit import HitTerm
from crowdsim.policy.terms.proximity import ProximityTerm
from crowdsim.policy.terms.registry import TERMS, AnyTerm, once_of, pack_terms, term_name
from crowdsim.policy.terms.strike import WASTED, StrikeTerm
from crowdsim.policy.terms.term import TargetBody, Term
from crowdsim.policy.terms.transition import TransitionTerm

if TYPE_CHECKING:
    from crowdsim.motion.database import MotionDatabase

__all__ = [
    "TERMS",
    "WASTED",
    "AnyTerm",
    "HitTerm",
    "ProximityTerm",
    "StrikeTerm",
    "TargetBody",
    "Term",
    "TransitionTerm",
    "lands",
    "once_of",
    "pack_terms",
    "posed_distance",
    "surface_distance",
    "target_body",
    "term_name",
]


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


def lands(distance: float, tolerance: float) -> bool:
    """Return whether a fist lands at a signed distance from a body's surface: not too far outside, nor too deep [m]."""
    return -tolerance <= distance <= tolerance
