"""Strikes that land touch: the arm, and where it is straight the spine, carries the fist onto the surface it hits."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.ik import reach_with_joints
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.take.motion import PoseMotion

Array = NDArray[Any]

BEFORE, AFTER = 0.16, 0.26
"""How long before and after a strike the arm leaves its captured way [s]."""
MOST = 0.35
"""Furthest that a fist is carried [m]; a strike that would need more shows where the fist comes to lie."""
ELBOW_LIMITS = (np.deg2rad(3.0), np.deg2rad(155.0))
_SPINE_SHARE = 1.0
_SIDES = ("left", "right")


@dataclass(frozen=True)
class Landings:
    """Strikes of a window that landed, by attacker's column and time; E strikes.

    Attributes:
        columns: Column of each attacker in its window. Shape (E,).
        times: When [s]. Shape (E,).
        hands: 0 left, 1 right. Shape (E,).
        shifts: How far the fist has to be carried then [m]. Shape (E, 3).
    """

    columns: Array
    times: Array
    hands: Array
    shifts: Array


def surface_point(
    point: Array, head: Array, neck: Array, pelvis: Array, head_radius: Array, torso_radius: Array
) -> Array:
    """Return the points of bodies' surfaces that are nearest to given points; all (E, 3), radii (E,) [m]."""
    axis = pelvis - neck
    share = np.sum((point - neck) * axis, axis=-1) / np.maximum(np.sum(axis * axis, axis=-1), 1e-12)
    centre = neck + np.clip(share, 0.0, 1.0)[:, None] * axis
    to_head, to_torso = point - head, point - centre
    far_head = np.linalg.norm(to_head, axis=-1)
    far_torso = np.linalg.norm(to_torso, axis=-1)
    on_head = (far_head - head_radius <= far_torso - torso_radius)[:, None]
    middle = np.where(on_head, head, centre)
    out = np.where(on_head, to_head, to_torso)
    length = np.maximum(np.where(on_head[:, 0], far_head, far_torso), 1e-9)
    radius = np.where(on_head[:, 0], head_radius, torso_radius)
    return np.asarray(middle + out / length[:, None] * radius[:, None])


def body_points(body: Body, positions: Array, turns: Array) -> tuple[Array, Array, Array, Array]:
    """Return head (n, 3), neck (n, 3), pelvis (n, 3) and fists (n, 2, 3) of posed bodies [m]."""
    roles = body.roles
    head = positions[:, roles["head"]] + quaternion.rotate(turns[:, roles["head"]], body.head_offset)
    hands = [roles["left_hand"], roles["right_hand"]]
    fists = positions[:, hands] + quaternion.rotate(turns[:, hands], body.fist_offsets)
    return head, positions[:, roles["neck"]], positions[:, roles["pelvis"]], fists


def carry_fists(
    motion: PoseMotion, scales: Array, landings: Landings, times: Array, roots: Array, rotations: Array
) -> None:
    """Carry fists onto what they hit, in place.

    Args:
        motion: The policy's motion.
        scales: Size of each body. Shape (n,).
        landings: Strikes that landed.
        times: Shape (T,) [s].
        roots: Places of the roots [m]. Shape (T, n, 3).
        rotations: Local rotations. Shape (T, n, J, 4), changed.
    """
    if not len(landings.times):
        return
    count, joints = rotations.shape[1:3]
    rows, strikes = _active(landings, times)
    if not len(rows):
        return
    columns = landings.columns[strikes]
    weights = _bump(times[rows] - landings.times[strikes])
    flat, flat_roots = rotations.reshape(-1, joints, 4), roots.reshape(-1, 3)
    # A pose that two strikes of a hand reach for, one going and one coming, goes towards both.
    for hand, side in enumerate(_SIDES):
        ours = landings.hands[strikes] == hand
        if not ours.any():
            continue
        poses, inverse = np.unique(rows[ours] * count + columns[ours], return_inverse=True)
        shift = np.zeros((len(poses), 3))
        np.add.at(shift, inverse, landings.shifts[strikes[ours]] * weights[ours, None])
        there = np.isfinite(flat_roots[poses, 0])
        poses, shift = poses[there], shift[there]
        sizes = scales[poses % count]
        local = flat[poses]
        places = (flat_roots[poses] / sizes[:, None]).astype(np.float32)
        flat[poses] = _reach(motion, side, hand, local, places, shift / sizes[:, None])


def _active(landings: Landings, times: Array) -> tuple[Array, Array]:
    """Pairs of a time's row and a strike that shows then."""
    first = np.searchsorted(times, landings.times - BEFORE, side="right")
    stop = np.searchsorted(times, landings.times + AFTER, side="left")
    counts = np.maximum(stop - first, 0)
    strikes = np.repeat(np.arange(len(counts)), counts)
    rows = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
    return rows, strikes


def _bump(apart: Array) -> Array:
    """1 at the strike, 0 with no speed and no acceleration at its ends."""
    s = np.clip(1.0 - np.where(apart < 0.0, -apart / BEFORE, apart / AFTER), 0.0, 1.0)
    return np.asarray(s * s * s * (10.0 - 15.0 * s + 6.0 * s * s))


def _reach(motion: PoseMotion, side: str, hand: int, local: Array, places: Array, shift: Array) -> Array:
    """Local rotations with one hand shifted: the spine leans for what the arm cannot reach, then the arm bends."""
    body, skeleton = motion.body, motion.skeleton
    roles = body.roles
    limb = (roles[f"{side}_shoulder"], roles[f"{side}_elbow"], roles[f"{side}_hand"])
    positions, turns = forward_kinematics(skeleton, places, local, parallel=False)
    wrist = positions[:, limb[2]].astype(float)
    # The hand keeps its turn in the world, so that the fist goes as far as the wrist does.
    targets = wrist + shift
    lengths = [np.linalg.norm(positions[:, b] - positions[:, a], axis=1) for a, b in pairwise(limb)]
    longest = 0.998 * (lengths[0] + lengths[1])
    for _ in range(2):
        shoulder = positions[:, limb[0]].astype(float)
        way = targets - shoulder
        far = np.linalg.norm(way, axis=1)
        lack = np.maximum(0.0, far - longest)
        if not (lack > 1e-4).any():
            break
        local = _lean(motion, local, positions, turns, limb[0], way / np.maximum(far, 1e-9)[:, None] * lack[:, None])
        positions, turns = forward_kinematics(skeleton, places, local, parallel=False)
    hinge = np.zeros(3)
    return reach_with_joints(skeleton, local, positions, turns, limb, targets, hinge, ELBOW_LIMITS)


def _lean(motion: PoseMotion, local: Array, positions: Array, turns: Array, shoulder: int, lack: Array) -> Array:
    """Turn the spine so that the shoulder goes by ``lack`` [m], half at its lower end and half at the chest."""
    roles = motion.body.roles
    local = local.copy()
    joints = [roles["spine"]] if roles["spine"] == roles["chest"] else [roles["spine"], roles["chest"]]
    for joint in joints:
        arm = positions[:, shoulder].astype(float) - positions[:, joint]
        spin = np.cross(arm, lack * (_SPINE_SHARE / len(joints))) / np.maximum(np.sum(arm * arm, axis=1), 1e-6)[:, None]
        turn = quaternion.from_rotation_vector(spin)
        parent = int(motion.skeleton.parents[joint])
        before = turns[:, parent].astype(float)
        inside = quaternion.multiply(quaternion.conjugate(before), quaternion.multiply(turn, before))
        local[:, joint] = quaternion.multiply(inside, local[:, joint])
    return local
