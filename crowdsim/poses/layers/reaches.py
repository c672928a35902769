"""Strikes of elbows, knees, heads and props touch: joints above what strikes turn until it lies on what it hits."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.crowd.record import TakeData
from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.strikers import HANDS_AND_FEET, SIDES, Kind
from crowdsim.poses.contacts import PoseAt, find_surfaces, strikes_near, within
from crowdsim.poses.hits import SPANS, TOGETHER, Landed, by_column
from crowdsim.poses.kernels.fists import LEAN
from crowdsim.poses.kernels.reaches import Reaches as Turns
from crowdsim.poses.kernels.reaches import reach_out
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.layer import Layer, Part, Scheduler
from crowdsim.poses.motion import PoseMotion

MOST = 0.9
"""Furthest that something that strikes is carried [m]."""
_CHAINS = {
    Kind.PROP: (("hand", 1.0), ("elbow", 0.6), ("shoulder", 1.0), ("chest", 0.06), ("spine", 0.05)),
    Kind.ELBOW: (("shoulder", 1.0), ("chest", 0.2), ("spine", 0.2)),
    Kind.KNEE: (("hip", 0.8),),
    Kind.HEAD: (("neck", 0.3), ("chest", 0.3), ("spine", 0.4)),
}
"""Joints that turn, from what strikes to the trunk, and how easily each does."""
_JOINTS, _ROUNDS = 5, 30
_DAMPED, _STEP = 1e-3, 0.2
"""Damping [m2], and most that a joint turns in a round [rad]."""
_MOST_TURN = math.radians(70.0)
"""Most that a joint turns [rad]."""


class Reaches(Layer):
    """Carries elbows, knees, heads and props onto what they hit, as that is posed with its own fists."""

    name = "reaches"
    size = 0.4
    needs: tuple[str, ...] = ("reactions", "fists")
    looks = LEAN + TOGETHER, LEAN + TOGETHER
    hops = 2

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        if np.isin(poser.take.events.limb, HANDS_AND_FEET).all():
            self.needs = ()

    def plan(self, part: Part) -> Turns | None:
        """Return which joints turn; None without such strikes."""
        near, hops = strikes_near(self.poser.landed, part), part.hops + 1
        near = near.of(~np.isin(near.limbs, HANDS_AND_FEET))
        if not len(near.times):
            return None
        pose_at, struck_at = (partial(self.poser.joints, through=name, hops=hops) for name in self.needs)
        window = part.window
        return plan_reaches(
            self.poser.take, near, window.columns(), len(window.avatars), pose_at, struck_at, window.motion
        )

    def apply(self, part: Part, poses: Posed) -> None:
        """Turn them."""
        turns = part.plans[self.name]
        if turns is not None:
            share(len(part.moments.columns), reach_out, part.moments, turns, within(part), poses,
                  threads=part.window.threads)  # fmt: skip


def plan_reaches(
    take: TakeData,
    near: Landed,
    columns: Array,
    count: int,
    pose_at: PoseAt,
    struck_at: PoseAt,
    motion: PoseMotion,
) -> Turns:
    """Find how joints turn for what strikes.

    Args:
        take: The take.
        near: Landed strikes of neither hands nor feet of avatars of the window.
        columns: Column of every avatar in the window. Shape (N,).
        count: Number of columns.
        pose_at: Poses avatars before any of this.
        struck_at: Poses those who are hit.
        motion: The motion of those in the window.
    """
    body, parents = motion.body, np.asarray(motion.skeleton.parents)
    rows = body.strikers[near.limbs]
    joints, shares = chains_of(body, near.limbs)
    points, radii = np.full((len(near.times), 3), np.nan), np.zeros(len(near.times))
    pivots = np.full((len(near.times), _JOINTS, 3), np.nan)
    frames = np.zeros((len(near.times), _JOINTS, 4))
    for which, _, scales, positions, rotations in pose_at(near.attackers, near.times):
        at, own = np.arange(len(which)), rows[which]
        offsets = quaternion.rotate(rotations[at, own["joint"]].astype(float), own["offset"])
        points[which] = positions[at, own["joint"]] + scales[:, None] * offsets
        radii[which] = own["radius"] * scales
        chosen = np.maximum(joints[which], 0)
        pivots[which] = positions[at[:, None], chosen]
        frames[which] = rotations[at[:, None], np.maximum(parents[chosen], 0)]
    last = np.argmax(np.cumsum(joints >= 0, axis=1), axis=1)
    origins = pivots[np.arange(len(last)), last]
    goals, _ = find_surfaces(take, near, points, origins, radii, struck_at, motion.target)
    shifts = goals - points
    length = np.linalg.norm(shifts, axis=1, keepdims=True)
    shifts = shifts * np.minimum(1.0, MOST / np.maximum(length, 1e-9))
    turns = turn_chain(pivots, points, points + shifts, np.where(joints >= 0, shares, 0.0))
    # A joint turns in the frame of its parent, which those that turn above it carry along.
    above = np.zeros_like(turns)
    above[..., 0] = 1.0
    for k in range(_JOINTS - 2, -1, -1):
        is_there = (joints[:, k + 1] >= 0)[:, None]
        above[:, k] = np.where(is_there, turns[:, k + 1], above[:, k + 1])
    own = quaternion.multiply(quaternion.conjugate(above), turns)
    local = quaternion.multiply(quaternion.conjugate(frames), quaternion.multiply(own, frames))
    vectors = quaternion.to_rotation_vector(local)
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    vectors = vectors * np.minimum(1.0, _MOST_TURN / np.maximum(size, 1e-9))
    # Absent avatars have no positions.
    vectors = np.where(np.isfinite(vectors), vectors, 0.0)
    order, starts = by_column(columns[near.attackers], count, near.times)
    return Turns(starts, *(values[order] for values in (near.times, np.minimum(near.spans, SPANS), joints, vectors)))


def chains_of(body: Body, limbs: Array) -> tuple[Array, Array]:
    """Return the joints that turn for strikes of limbs (E,), -1 for none, and their shares. Shapes (E, 4)."""
    joints, shares = np.full((len(limbs), _JOINTS), -1), np.zeros((len(limbs), _JOINTS))
    for row, limb in enumerate(limbs):
        striker, done = body.strikers[limb], set[int]()
        for role, part in _CHAINS[Kind(int(striker["kind"]))]:
            name = role if role in body.roles else f"{SIDES[int(striker['side']) % 2]}_{role}"
            joint = body.roles[name]
            if joint not in done:
                joints[row, len(done)], shares[row, len(done)] = joint, part
                done.add(joint)
    return joints, shares


def turn_chain(pivots: Array, points: Array, goals: Array, shares: Array) -> Array:
    """Turn chains of joints so that points go to goals, by damped least squares (Wampler, 1986).

    Args:
        pivots: Positions of joints, from the end of the chain on [m]. Shape (E, C, 3).
        points: Points at their ends [m]. Shape (E, 3).
        goals: Where these are to go [m]. Shape (E, 3).
        shares: How easily each joint turns; 0 for joints that are not there. Shape (E, C).

    Returns:
        How far each joint has turned in the world with those that turn above it. Shape (E, C, 4).
    """
    pivots, points = pivots.copy(), points.copy()
    turns = np.zeros((*shares.shape, 4))
    turns[..., 0] = 1.0
    there: Array = np.all(np.isfinite(points) & np.isfinite(goals), axis=1)
    ease = np.where(there[:, None], shares, 0.0)[..., None]
    for _ in range(_ROUNDS):
        arms = np.where(ease > 0.0, points[:, None] - pivots, 0.0)
        ways = np.where(there[:, None], goals - points, 0.0)
        squares = np.sum(ease * arms * arms, axis=(1, 2))[:, None, None] * np.eye(3)
        outer = np.einsum("eki,ekj->eij", ease * arms, arms)
        pulls = np.linalg.solve(squares - outer + _DAMPED * np.eye(3), ways[..., None])[..., 0]
        steps = ease * np.cross(arms, pulls[:, None])
        sizes = np.linalg.norm(steps, axis=-1, keepdims=True).max(axis=1, keepdims=True)
        steps = quaternion.from_rotation_vector(steps * np.minimum(1.0, _STEP / np.maximum(sizes, 1e-12)))
        for k in range(shares.shape[1]):
            points = pivots[:, k] + quaternion.rotate(steps[:, k], points - pivots[:, k])
            below = pivots[:, k, None] + quaternion.rotate(steps[:, k, None], pivots[:, :k] - pivots[:, k, None])
            pivots[:, :k] = below
            turns[:, : k + 1] = quaternion.multiply(steps[:, k, None], turns[:, : k + 1])
    return turns
