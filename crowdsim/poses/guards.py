"""Where strikes that are blocked end: on the surface of the forearm or glove that is in their way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.model_arms import arm_radii
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body

_GIVES = 0.02
"""How much nearer than their radii the middle of a fist and the axis of what it hits come [m]; gloves give way."""
_ASIDE = 0.5
"""Share in where a fist stays of the side from which it met the arm; the rest is where it comes from."""


class Guard(NamedTuple):
    """Both arms of bodies; n bodies.

    Attributes:
        elbows: Shape (n, 2, 3) [m].
        fists: Shape (n, 2, 3) [m].
        forearms: Radius of the forearms. Shape (n,) [m].
        gloves: Radius of the gloves. Shape (n,) [m].
        shields: Radii of left and right forearm, left and right glove that shields make. Shape (n, 4) [m].
    """

    elbows: Array
    fists: Array
    forearms: Array
    gloves: Array
    shields: Array | float = 0.0


def guard_of(
    body: Body, positions: Array, rotations: Array, scales: Array, widths: Array, shields: Array | float = 0.0
) -> Guard:
    """Return the arms of bodies: positions (n, J, 3) [m] and rotations (n, J, 4) of joints, sizes and widths (n,).

    ``shields`` are the radii that shields make for scale 1 (n, 4) [m].
    """
    hands, elbows = ([body.roles[f"{side}_{role}"] for side in ("left", "right")] for role in ("hand", "elbow"))
    sizes, (forearm, glove) = np.asarray(scales, dtype=float), arm_radii(body)
    fists = positions[:, hands] + sizes[:, None, None] * quaternion.rotate(rotations[:, hands], body.fist_offsets)
    widths = np.asarray(widths, dtype=float)
    return Guard(positions[:, elbows], fists, forearm * widths, glove * sizes, sizes[:, None] * shields)


def guard_points(points: Array, origins: Array, guard: Guard) -> Array:
    """Return where the middle of a fist stays that meets an arm: outside it, on the side that it comes from.

    Args:
        points: Where it met an arm, about [m]. Shape (n, 3).
        origins: From where it comes [m]. Shape (n, 3).
        guard: The arms.

    Returns:
        Shape (n, 3) [m].
    """
    axes = guard.fists - guard.elbows
    along = np.sum((points[:, None] - guard.elbows) * axes, axis=-1)
    along = np.clip(along / np.maximum(np.sum(axes * axes, axis=-1), 1e-12), 0.0, 1.0)
    middles = np.stack([guard.elbows + along[..., None] * axes, guard.fists], axis=2).reshape(-1, 4, 3)
    radii = np.stack([guard.forearms, guard.gloves] * 2, axis=1)
    radii = np.maximum(radii, np.broadcast_to(guard.shields, radii.shape)[:, [0, 2, 1, 3]])
    gaps = np.linalg.norm(points[:, None] - middles, axis=-1) - radii
    rows, nearest = np.arange(len(points)), np.argmin(gaps, axis=1)
    middle, radius = middles[rows, nearest], radii[rows, nearest]
    way = _ASIDE * unit(points - middle) + unit(origins - middle)
    # Along a forearm it would come no further out of it.
    arm = nearest // 2
    bones, beside = unit(axes[rows, arm]), (nearest % 2 == 0) & (along[rows, arm] > 0.0) & (along[rows, arm] < 1.0)
    way = way - np.where(beside, np.sum(way * bones, axis=-1), 0.0)[:, None] * bones
    return np.asarray(middle + unit(way) * (radius + guard.gloves - _GIVES)[:, None])


def unit(vectors: Array) -> Array:
    """Return vectors of length 1. Shape (..., 3)."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))
