"""Strikes that land touch: the arm, and where it is straight the trunk, carries the fist onto the surface it hits."""

from __future__ import annotations

from functools import partial

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.crowd.record import TakeData
from crowdsim.motion import quaternion
from crowdsim.motion.strikes import HANDS
from crowdsim.poses.contacts import PoseAt, body_points, find_surfaces, strikes_near, within
from crowdsim.poses.hits import SPANS, TOGETHER, Landed, by_column
from crowdsim.poses.kernels.columns import LOWER, MIDDLE, UPPER
from crowdsim.poses.kernels.fists import ELBOW_LEAST, LEAN, MOTION, Landings, carry_fists, swing_forearms
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.layer import Layer, Part
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.outlines import Balls, hand_balls, striker_radii
from crowdsim.poses.skins import HAND_BALLS
from crowdsim.poses.stops import find_stops
from crowdsim.poses.trunk_assist import Leans, Trunks, find_trunks, leaning_joints, plan_leans

MOST = 0.8
"""Furthest that a fist is carried [m]."""
SLOWER = 0.3
"""How much longer a fist is on its way that is carried a metre further, before a strike and after it [s]."""


class Fists(Layer):
    """Carries fists onto what they hit, as that is posed with its own fists."""

    name = "fists"
    size = 0.9
    needs = ("reactions", "fists")
    looks = LEAN + TOGETHER + MOTION, LEAN + TOGETHER + MOTION
    hops = 2

    def plan(self, part: Part) -> Landings:
        """Return where fists touch."""
        poser, hops = self.poser, part.hops + 1
        near = strikes_near(poser.landed, part)
        pose_at, struck_at = (partial(poser.joints, through=name, hops=hops) for name in self.needs)
        return plan_landings(poser.take, near.of(np.isin(near.limbs, HANDS)), part.window.columns(),
                             len(part.window.avatars), pose_at, struck_at, part.window.motion, part.hops)  # fmt: skip

    def apply(self, part: Part, poses: Posed) -> None:
        """Carry them there."""
        window, landings = part.window, part.plans[self.name]
        if len(landings.times):
            arms, legs = window.motion.arms, window.motion.legs
            share(len(part.moments.columns), carry_fists, part.moments, landings, window.rows.sizes, arms, legs,
                  leaning_joints(arms), within(part), poses, threads=window.threads)  # fmt: skip


def plan_landings(
    take: TakeData,
    near: Landed,
    columns: Array,
    count: int,
    pose_at: PoseAt,
    struck_at: PoseAt,
    motion: PoseMotion,
    hops: int,
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
        hops: How many avatars lie between them and those that are shown.
    """
    arms = motion.arms
    fists, hinges = np.full((2, len(near.times), 3), np.nan)
    trunks = Trunks(*(np.full((len(near.times), *shape), np.nan) for shape in ((3, 3), (3, 3), (3,), (3, 4), (3,))))
    offsets = np.full((len(near.times), *HAND_BALLS["gloves"][:, :3].shape), np.nan)
    thick = np.zeros(offsets.shape[:2])
    radii, bare = np.zeros(len(near.times)), take.cast.bare[near.attackers]
    for which, body, scales, positions, rotations in pose_at(near.attackers, near.times):
        rows, hands = np.arange(len(which)), near.hands[which]
        fists[which] = body_points(body, positions, rotations, scales)[3][rows, hands]
        radii[which] = striker_radii(body, hands, scales, bare[which])
        found = find_trunks(arms, hands, take.cast.arms[near.attackers[which]], positions, rotations)
        for values, one in zip(trunks, found, strict=True):
            values[which] = one
        ends = rotations[rows, arms.joints[hands, LOWER]].astype(float)
        hinges[which] = quaternion.rotate(rotations[rows, arms.joints[hands, UPPER]].astype(float), arms.hinges[hands])
        own = hand_balls(body, arms.hinges, hands, scales, bare[which])
        offsets[which], thick[which] = quaternion.rotate(ends[:, None], own.offsets), own.radii

    # A fist that misses is moved out of a body by itself; thumb and wrist may stay in it.
    thick[near.missed, 1:] = -1.0
    behind = trunks.arms[:, 2] - fists

    def shifts_to(some: Array, points: Array) -> Array:
        shifts = points - fists[some]
        shifts = shifts * np.minimum(1.0, MOST / np.maximum(np.linalg.norm(shifts, axis=-1, keepdims=True), 1e-9))
        return np.where(np.isfinite(shifts), shifts, 0.0)

    def turn_hands(some: Array, points: Array, leans: Leans) -> Array:
        """Return how hands turn whose trunks have leaned and whose fists go to points."""
        turns = np.empty((len(some), 4))
        carried, leaned = leans.carry(trunks.of(some))
        upper, middle, end = (np.ascontiguousarray(carried[:, k]) for k in (UPPER, MIDDLE, LOWER))
        swing_forearms(0, len(some), upper, middle, end, quaternion.rotate(leaned, hinges[some]),
                       quaternion.rotate(leaned, behind[some]), points, turns)  # fmt: skip
        return quaternion.multiply(turns, leaned)

    def balls_at(some: Array, points: Array) -> Balls:
        turns = turn_hands(some, points, plan_leans(trunks.of(some), ELBOW_LEAST, shifts_to(some, points)))
        return Balls(quaternion.rotate(turns[:, None], offsets[some]), thick[some])

    touched, struck = find_surfaces(take, near, fists, trunks.arms[:, 0], radii, struck_at, motion.target, balls_at)
    everyone = np.arange(len(near.times))
    shifts = shifts_to(everyone, touched)
    stopped = ~near.blocked & (~near.missed | (shifts != 0.0).any(axis=1)) & (hops == 0)
    planned = plan_leans(trunks, ELBOW_LEAST, shifts)
    turned = quaternion.rotate(turn_hands(everyone, touched, planned), behind)
    stops = find_stops(take, near, touched, touched + turned, stopped, pose_at)
    leans, moves = planned.rotations(trunks, near.hands), planned.shifts
    order, starts = by_column(columns[near.attackers], count, near.times)
    for values in (leans, moves):
        # Absent avatars have no positions.
        values[~np.isfinite(values)] = 0.0
    _lean_alike(near.attackers[order], near.hands[order], near.times[order], order, leans, moves)
    result = (
        near.times,
        near.hands,
        shifts,
        np.minimum(near.spans, SPANS + SLOWER * np.linalg.norm(shifts, axis=-1, keepdims=True)),
        fists + shifts,
        near.blocked,
        stops,
        leans,
        moves,
        struck,
    )
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
