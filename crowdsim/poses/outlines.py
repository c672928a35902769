"""Where fists stay on bodies as pictures show them, which are thicker in places than what counts as hit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules

GIVES = 0.012
"""How far outside a head, or any capsule of a trunk, the middle of a fist stays, which is thicker than that [m]."""
WRIST_IN = 0.01
"""How deep the wrist behind a fist may be in them [m]."""
_ROUNDS = (3, 12)
"""Times that a point alone, and one with a wrist, goes out of the capsules, and back where that took it too far."""


class Outline(NamedTuple):
    """What counts as hit: heads and capsules from neck to pelvis; n bodies.

    Attributes:
        head: Shape (n, 3) [m].
        neck: Shape (n, 3) [m].
        pelvis: Shape (n, 3) [m].
        head_radius: Shape (n,) [m].
        torso_radius: Shape (n,) [m].
    """

    head: Array
    neck: Array
    pelvis: Array
    head_radius: Array
    torso_radius: Array


def leave_capsules(points: Array, wrists: Array | None, bodies: PosedBodies, outline: Outline) -> Array:
    """Return points that are moved out of the capsules of trunk and head, to ``GIVES`` outside of them.

    The wrist behind each goes along, and is no deeper in them than ``WRIST_IN``. No point ends further than ``GIVES``
    from what counts as hit, even if that leaves it or its wrist inside a capsule.

    Args:
        points: Points on what counts as hit, one for each body [m]. Shape (n, 3).
        wrists: Way from each to its wrist [m]; None without. Shape (n, 3).
        bodies: The bodies at one time.
        outline: What of them counts as hit.
    """
    starts, axes, radii = upper_capsules(bodies)
    if not starts.shape[1]:
        return points
    squares, rows, found = np.maximum(np.sum(axes * axes, axis=-1), 1e-12), np.arange(len(points)), points
    behind = np.zeros_like(points) if wrists is None else wrists
    for _ in range(_ROUNDS[wrists is not None]):
        both = np.stack([found, found + behind], axis=1)[:, :, None]
        along = np.clip(np.sum((both - starts[:, None]) * axes[:, None], axis=-1) / squares[:, None], 0.0, 1.0)
        out = both - starts[:, None] - along[..., None] * axes[:, None]
        far = np.linalg.norm(out, axis=-1)
        depths = radii[:, None, :, 0] + along * (radii[..., 1] - radii[..., 0])[:, None] - far
        depths += np.array([GIVES, -WRIST_IN])[:, None]
        deepest = rows, *np.divmod(np.argmax(depths.reshape(len(points), -1), axis=1), depths.shape[2])
        go = np.maximum(depths[deepest], 0.0) / np.maximum(far[deepest], 1e-9)
        found = _bring_back(found + go[:, None] * out[deepest], outline)
    return found


def upper_capsules(bodies: PosedBodies) -> tuple[Array, Array, Array]:
    """Return starts (n, K, 3), axes (n, K, 3) and radii (n, K, 2) of the capsules of trunks and heads [m]."""
    body, count = bodies.body, len(bodies.columns)
    limbs = [joint for role, joint in body.roles.items() if role.startswith(("left", "right"))]
    trunk = ~np.isin(body.capsule_joints[capsule_order(body)], limbs)
    capsules = place_capsules([bodies], 1, count)
    starts, ends = (values[0, :, trunk].swapaxes(0, 1).astype(float) for values in (capsules.starts, capsules.ends))
    return starts, ends - starts, capsules.radii[:, trunk]


def _bring_back(points: Array, outline: Outline) -> Array:
    """Return points that are no further than ``GIVES`` outside what counts as hit."""
    axis = outline.pelvis - outline.neck
    along = np.sum((points - outline.neck) * axis, axis=-1) / np.maximum(np.sum(axis * axis, axis=-1), 1e-12)
    to_head, to_torso = outline.head - points, outline.neck + np.clip(along, 0.0, 1.0)[:, None] * axis - points
    far_head, far_torso = np.linalg.norm(to_head, axis=-1), np.linalg.norm(to_torso, axis=-1)
    gap_head, gap_torso = far_head - outline.head_radius, far_torso - outline.torso_radius
    near_head = gap_head < gap_torso
    far = np.maximum(np.where(near_head, far_head, far_torso), 1e-9)
    go = np.maximum(np.minimum(gap_head, gap_torso) - GIVES, 0.0) / far
    return np.asarray(points + go[:, None] * np.where(near_head[:, None], to_head, to_torso))
