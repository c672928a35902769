"""Mirror images of clips, so that an orthodox boxer is a southpaw too."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.joint_names import split_name
from crowdsim.motion.skeleton import Clip, Skeleton

Array = NDArray[Any]


def mirrored(clip: Clip, body: Body) -> Clip:
    """Return the mirror image of a clip, left and right exchanged, on the same skeleton.

    The world is mirrored at x = 0 and every joint takes the motion of its counterpart. Where the rest pose is symmetric
    this is exact; a limb that differs from its counterpart keeps its own lengths.
    """
    partner = mirror_partners(clip.skeleton, body)
    lateral = _lateral_axis(clip.skeleton, body)
    # A turn mirrored at a plane keeps its part about the plane's normal and loses the sign of the rest.
    signs = -np.ones(4)
    signs[[0, 1 + lateral]] = 1.0
    rotations = clip.rotations[:, partner] * signs
    world = np.array([1.0, 1.0, -1.0, -1.0])
    root = clip.rotations[:, 0] * world
    if lateral != 0:
        # The world's mirror and the rest pose's are different planes: together they are half a turn about the third.
        turn = np.zeros(4)
        turn[1 + 3 - lateral] = 1.0
        root = quaternion.multiply(root, turn)
    rotations[:, 0] = root
    flip = np.ones(3)
    flip[lateral] = -1.0
    moved = clip.translations
    positions = clip.root_positions * np.array([-1.0, 1.0, 1.0])
    if moved is not None:
        moved = moved[:, partner] * flip
        moved[:, 0] = positions
    return replace(clip, name=f"{clip.name}~mirror", root_positions=positions, rotations=rotations, translations=moved)


def mirror_partners(skeleton: Skeleton, body: Body) -> Array:
    """Return each joint's counterpart on the other side, itself for joints of the middle. Shape (J,)."""
    flip = np.ones(3)
    flip[_lateral_axis(skeleton, body)] = -1.0
    partner = np.arange(skeleton.joint_count)
    names = [split_name(name) for name in skeleton.names]
    for joint in range(skeleton.joint_count):
        ours, theirs = skeleton.children(joint), skeleton.children(int(partner[joint]))
        if len(ours) != len(theirs) or not ours:
            continue
        gaps = np.linalg.norm(skeleton.offsets[ours][:, None] * flip - skeleton.offsets[theirs][None], axis=-1)
        for row, a in enumerate(ours):
            side, words = names[a]
            opposite = (None if side is None else 1 - side, words)
            for column, b in enumerate(theirs):
                if names[b] != opposite:
                    gaps[row, column] += 0.5 * body.height
        rows, columns = linear_sum_assignment(gaps)
        for row, match in zip(rows, columns, strict=True):
            partner[ours[row]] = theirs[match]
    return partner


def _lateral_axis(skeleton: Skeleton, body: Body) -> int:
    """Axis of the rest pose that runs from the right hip to the left: 0, 1 or 2."""
    rest = skeleton.rest_positions()
    across = rest[body.roles["left_hip"]] - rest[body.roles["right_hip"]]
    return int(np.argmax(np.abs(across)))
