"""Strikes that land touch: the arm, and where it is straight the trunk, carries the fist onto the surface it hits."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.strikes import LIMBS
from crowdsim.policy.rewards import TargetBody, posed_distance
from crowdsim.take.capsules import PosedBodies
from crowdsim.take.data import TakeData
from crowdsim.take.guards import guard_of, guard_points
from crowdsim.take.hits import TOGETHER, Landed, by_column
from crowdsim.take.kernels.fists import ELBOW_LEAST, JOINTS, LEAN, Landings, carry_fists
from crowdsim.take.kernels.records import Moments, Posed
from crowdsim.take.motion import PoseMotion
from crowdsim.take.outlines import GIVES, Outline, leave_capsules
from crowdsim.take.trunk_assist import leaning_joints, plan_leans
from crowdsim.take.window import Window

PoseAt = Callable[[Array, Array], list[tuple[Array, Body, Array, Array, Array]]]
"""Poses avatars (E,) at times (E,): for each policy which of them, body, scales, joint positions and rotations."""

MOST = 0.35
"""Furthest that a fist is carried [m]."""
_FACING = 0.4
"""Least cosine of the angle between the outward direction of a point that is hit and the direction to the shoulder."""
_OUT = 12
"""Times that a point goes out of head or torso."""


def surface_point(
    point: Array,
    head: Array,
    neck: Array,
    pelvis: Array,
    head_radius: Array,
    torso_radius: Array,
    origin: Array | None = None,
) -> Array:
    """Return the points of bodies' surfaces that are nearest to given points; all (E, 3), radii (E,) [m].

    A point on the head that lies in the torso, or vice versa, is no surface: such points go out of one and of
    the other until they lie on both. With ``origin`` points on the far side, as seen from there, come around: a fist
    does not go through a head to its back.
    """
    axis = pelvis - neck
    square = np.maximum(np.sum(axis * axis, axis=-1), 1e-12)
    found = np.array(point, dtype=float)
    if origin is not None:
        found = _near_side(found, head, neck, axis, square, head_radius, torso_radius, origin)
    for step in range(_OUT):
        share = np.sum((found - neck) * axis, axis=-1) / square
        centre = neck + np.clip(share, 0.0, 1.0)[:, None] * axis
        to_head, to_torso = found - head, found - centre
        far_head, far_torso = np.linalg.norm(to_head, axis=-1), np.linalg.norm(to_torso, axis=-1)
        above_head, above_torso = far_head - head_radius, far_torso - torso_radius
        on_head = (above_head <= above_torso)[:, None]
        middle = np.where(on_head, head, centre)
        out = np.where(on_head, to_head, to_torso)
        length = np.maximum(np.where(on_head[:, 0], far_head, far_torso), 1e-9)
        radius = np.where(on_head[:, 0], head_radius, torso_radius)
        surface = middle + out / length[:, None] * radius[:, None]
        inside = np.minimum(above_head, above_torso) < -1e-6
        found = np.where((inside | (step == 0))[:, None], surface, found)
    return found


def _near_side(
    point: Array,
    head: Array,
    neck: Array,
    axis: Array,
    square: Array,
    head_radius: Array,
    torso_radius: Array,
    origin: Array,
) -> Array:
    """Points that lie behind the head or torso that they are nearest to, or far in it, brought around it."""
    share = np.clip(np.sum((point - neck) * axis, axis=-1) / square, 0.0, 1.0)
    centre = neck + share[:, None] * axis
    gaps = [np.linalg.norm(point - middle, axis=-1) for middle in (head, centre)]
    on_head = gaps[0] - head_radius <= gaps[1] - torso_radius
    middle, radius = np.where(on_head[:, None], head, centre), np.where(on_head, head_radius, torso_radius)
    way, out = _unit(origin - middle), _unit(point - middle)
    ahead = np.sum(out * way, axis=-1)
    aside = _unit(out - ahead[:, None] * way)
    around = middle + radius[:, None] * (_FACING * way + math.sqrt(1.0 - _FACING**2) * aside)
    return np.where((ahead < _FACING)[:, None], around, point)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))


def body_points(body: Body, positions: Array, rotations: Array, scales: Array) -> tuple[Array, Array, Array, Array]:
    """Return head (n, 3), neck (n, 3), pelvis (n, 3) and fists and feet (n, 4, 3) of posed bodies [m]."""
    roles = body.roles
    sizes = np.asarray(scales)[:, None]
    head = positions[:, roles["head"]] + sizes * quaternion.rotate(rotations[:, roles["head"]], body.head_offset)
    ends, offsets = [roles[limb] for limb in LIMBS], np.concatenate([body.fist_offsets, body.foot_offsets])
    strikers = positions[:, ends] + sizes[..., None] * quaternion.rotate(rotations[:, ends], offsets)
    return head, positions[:, roles["neck"]], positions[:, roles["pelvis"]], strikers


def plan_landings(
    take: TakeData,
    near: Landed,
    columns: Array,
    count: int,
    pose_at: PoseAt,
    struck_at: PoseAt,
    motion: PoseMotion,
    shown: bool,
) -> Landings:
    """Find how far fists have to be carried.

    Args:
        take: The take.
        near: Landed strikes of avatars of the window.
        columns: Column of every avatar in the window. Shape (N,).
        count: Number of columns.
        pose_at: Poses avatars before any of this.
        struck_at: Poses those who are hit.
        motion: The motion of those in the window.
        shown: Whether fists stay outside of bodies as pictures show them.
    """
    arms = motion.arms
    fists, shoulders = np.full((len(near.times), 3), np.nan), np.full((len(near.times), 3), np.nan)
    posed = pose_at(near.attackers, near.times)
    for which, body, scales, positions, rotations in posed:
        rows, hands = np.arange(len(which)), near.hands[which]
        fists[which] = body_points(body, positions, rotations, scales)[3][rows, hands]
        shoulders[which] = positions[rows, arms.joints[hands, 0]]
    shifts = find_surfaces(take, near, fists, shoulders, struck_at, motion.target, shown) - fists
    length = np.linalg.norm(shifts, axis=-1, keepdims=True)
    shifts = shifts * np.minimum(1.0, MOST / np.maximum(length, 1e-9))
    shifts = np.where(np.isfinite(shifts), shifts, 0.0)
    leans, moves = np.zeros((len(near.times), JOINTS, 3)), np.zeros((len(near.times), 3))
    for which, _, _, positions, rotations in posed:
        leans[which], moves[which] = plan_leans(
            arms,
            ELBOW_LEAST,
            near.hands[which],
            shifts[which],
            take.cast.arms[near.attackers[which]],
            positions,
            rotations,
        )
    order, starts = by_column(columns[near.attackers], count, near.times)
    for values in (leans, moves):
        # Absent avatars have no positions.
        values[~np.isfinite(values)] = 0.0
    _lean_alike(near.attackers[order], near.hands[order], near.times[order], order, leans, moves)
    result = (near.times, near.hands, shifts, near.spans, fists + shifts, near.blocked, leans, moves)
    return Landings(starts, *(values[order] for values in result))


def _lean_alike(attackers: Array, hands: Array, times: Array, order: Array, leans: Array, moves: Array) -> None:
    """Let strikes that are one lean as the one of them does that leans furthest, in place."""
    sizes = np.linalg.norm(leans, axis=(1, 2)) + np.linalg.norm(moves, axis=1)
    best = order.copy()
    for away in range(1, 4):
        near = (attackers[away:] == attackers[:-away]) & (hands[away:] == hands[:-away])
        near &= times[away:] - times[:-away] <= TOGETHER
        for one, other in ((slice(away, None), slice(None, -away)), (slice(None, -away), slice(away, None))):
            further = near & (sizes[order[other]] > sizes[best[one]])
            best[one] = np.where(further, order[other], best[one])
    leans[order], moves[order] = leans[best], moves[best]


def reach_out(window: Window, landings: Landings, moments: Moments, poses: Posed, within: float = LEAN) -> None:
    """Carry fists onto what they hit, in place.

    Args:
        window: The stretch of the take.
        landings: Strikes that landed.
        moments: Who is posed, and when.
        poses: Their poses, changed.
        within: Time beyond which strikes are left out [s].
    """
    if not len(landings.times):
        return
    arms, legs, sizes = window.motion.arms, window.motion.legs, window.rows.sizes
    leaning = leaning_joints(arms)

    def work(low: int, high: int) -> None:
        carry_fists(low, high, moments, landings, sizes, arms, legs, leaning, within, poses)

    share(len(moments.columns), work, threads=window.threads)


def find_surfaces(
    take: TakeData, near: Landed, fists: Array, shoulders: Array, pose_at: PoseAt, target: TargetBody, shown: bool
) -> Array:
    """Return the nearest points on what is hit, of blocked strikes those on the arm that is in the way. Shape (E, 3).

    Scripted targets are as large as control takes them for.

    Args:
        take: The take.
        near: Strikes.
        fists: What strikes [m]. Shape (E, 3).
        shoulders: From where it comes [m]. Shape (E, 3).
        pose_at: Poses those who are hit.
        target: The body of scripted targets.
        shown: Whether the points lie outside of bodies as pictures show them.
    """
    points = np.full((len(near.times), 3), np.nan)
    people = np.flatnonzero(near.victims >= 0)
    for which, body, scales, positions, rotations in pose_at(near.victims[people], near.times[people]):
        chosen, numbers = people[which], near.victims[people[which]]
        widths, parts = take.cast.widths[numbers], body_points(body, positions, rotations, scales)[:3]
        outline = Outline(*parts, body.head_radius * scales, body.torso_radius * widths)
        touched = outline._replace(head_radius=outline.head_radius + GIVES)
        points[chosen] = surface_point(fists[chosen], *touched, origin=shoulders[chosen])
        if shown:
            build = scales, take.cast.girths[numbers], take.cast.stretches[numbers]
            bodies = PosedBodies(body, np.arange(len(which)), *build, positions[None], rotations[None])
            points[chosen] = leave_capsules(points[chosen], bodies, outline)
        # A fist that misses is left alone where it is in no body.
        gaps = posed_distance(fists[chosen], *outline)
        free = chosen[near.missed[chosen] & (gaps >= 0.0)]
        points[free] = fists[free]
        stopped = near.blocked[chosen]
        points[chosen[stopped]] = guard_points(
            near.points[chosen[stopped]],
            shoulders[chosen[stopped]],
            guard_of(body, positions[stopped], rotations[stopped], scales[stopped], widths[stopped]),
        )
    scripted = np.flatnonzero(near.victims < -1)
    if len(scripted):
        clock = near.times[scripted] * take.control_rate
        frames = np.clip(np.floor(clock + 1e-9).astype(int), 0, take.frame_count - 1)
        later = np.minimum(frames + 1, take.frame_count - 1)
        numbers = -2 - near.victims[scripted]
        low = np.stack([take.targets[int(f)][int(g)] for f, g in zip(frames, numbers, strict=True)])
        high = np.stack([take.targets[int(f)][int(g)] for f, g in zip(later, numbers, strict=True)])
        heads = low + (high - low) * np.clip(clock - frames, 0.0, 1.0)[:, None]
        sizes = take.cast.scales[near.attackers[scripted]]
        points[scripted] = surface_point(
            fists[scripted], heads, *target.under(heads, sizes), origin=shoulders[scripted]
        )
    return points
