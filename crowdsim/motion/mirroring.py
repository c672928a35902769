"""Mirror images of clips, so that an orthodox boxer is a southpaw too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.joint_names import split_name
from crowdsim.motion.measuring import rests_like_a_body
from crowdsim.motion.skeleton import Clip, Skeleton

_SNAP = np.cos(np.deg2rad(3.0))


def mirrored(clip: Clip, body: Body) -> Clip:
    """Return the mirror image of a clip, left and right exchanged, on the same skeleton.

    The world is mirrored at x = 0 and every joint takes the motion of its counterpart. Where the rest pose is symmetric
    this is exact; a limb that differs from its counterpart keeps its own lengths.

    Raises:
        MotionError: The rest pose is no pose of a body, so that its joints have no common mirror plane.
    """
    if not rests_like_a_body(clip.skeleton, body.roles):
        raise MotionError(
            f"clip {clip.name!r} cannot be mirrored: the rest pose of its skeleton is no pose of a body; "
            "expected legs below the trunk and feet off the shanks"
        )
    partner = mirror_partners(clip.skeleton, body)
    normal = _mirror_normal(clip.skeleton, body)
    # With n the normal of the rest pose's mirror plane, a rotation R becomes N R N: its part about n stays, the rest
    # rotates in the opposite sense. The root's stands between the world's mirror and the rest pose's.
    rotations = clip.rotations[:, partner].copy()
    rotations[..., 1:] = 2.0 * (rotations[..., 1:] @ normal)[..., None] * normal - rotations[..., 1:]
    half = np.concatenate([[0.0], normal])
    rotations[:, 0] = quaternion.multiply(
        np.array([0.0, -1.0, 0.0, 0.0]), quaternion.multiply(clip.rotations[:, 0], half)
    )
    positions = clip.root_positions * np.array([-1.0, 1.0, 1.0])
    moved = clip.translations
    if moved is not None:
        moved = _reflected(moved[:, partner], normal)
        moved[:, 0] = positions
    return replace(clip, name=f"{clip.name}~mirror", root_positions=positions, rotations=rotations, translations=moved)


def mirror_partners(skeleton: Skeleton, body: Body) -> Array:
    """Return each joint's counterpart on the other side, itself for joints of the middle. Shape (J,)."""
    from scipy.optimize import linear_sum_assignment

    normal = _mirror_normal(skeleton, body)
    partner = np.arange(skeleton.joint_count)
    names = [split_name(name) for name in skeleton.names]
    sides = {body.roles[role]: body.roles[_other_side(role)] for role in body.roles if _other_side(role) in body.roles}
    for joint in range(skeleton.joint_count):
        ours, theirs = skeleton.children(joint), skeleton.children(int(partner[joint]))
        if len(ours) != len(theirs) or not ours:
            continue
        flipped = _reflected(skeleton.offsets[ours], normal)
        gaps = np.linalg.norm(flipped[:, None] - skeleton.offsets[theirs][None], axis=-1)
        for row, a in enumerate(ours):
            side, words = names[a]
            opposite = (None if side is None else 1 - side, words)
            for column, b in enumerate(theirs):
                # Names without a side may be bare numbers: then only the shape distinguishes sides.
                if names[b] != opposite and (side is not None or names[b][0] is not None):
                    gaps[row, column] += 0.5 * body.height
                if sides.get(a, b) != b or sides.get(b, a) != a:
                    gaps[row, column] += 2.0 * body.height
        rows, columns = linear_sum_assignment(gaps)
        for row, match in zip(rows, columns, strict=True):
            partner[ours[row]] = theirs[match]
    return partner


def _other_side(role: str) -> str:
    return role.replace("left_", "?").replace("right_", "left_").replace("?", "right_")


def _reflected(vectors: Array, normal: Array) -> Array:
    return np.asarray(vectors - 2.0 * (vectors @ normal)[..., None] * normal)


def _mirror_normal(skeleton: Skeleton, body: Body) -> Array:
    """The direction from right to left in the rest pose, which is an axis where it is close to one. Shape (3,)."""
    rest, roles = skeleton.rest_positions(), body.roles
    across = np.sum(
        [rest[roles[f"left_{part}"]] - rest[roles[f"right_{part}"]] for part in ("hip", "shoulder")], axis=0
    )
    across = across / max(float(np.linalg.norm(across)), 1e-12)
    axis = int(np.argmax(np.abs(across)))
    if abs(across[axis]) > _SNAP:
        across = np.eye(3)[axis] * np.sign(across[axis])
    return np.asarray(across)
