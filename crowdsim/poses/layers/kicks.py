"""Kicks that land touch: the leg, and the pelvis above the other foot, carry the foot onto the surface it hits."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.crowd.record import TakeData
from crowdsim.motion.strikers import FEET
from crowdsim.poses.contacts import PoseAt, body_points, find_surfaces, strikes_near, within
from crowdsim.poses.hits import SPANS, TOGETHER, Landed, by_column
from crowdsim.poses.kernels.blending import BLEND
from crowdsim.poses.kernels.columns import AFTER, BEFORE, BEGIN, END
from crowdsim.poses.kernels.feet import KNEE_LEAST
from crowdsim.poses.kernels.fists import LEAN
from crowdsim.poses.kernels.kicks import CarriedFeet, carry_feet
from crowdsim.poses.kernels.records import FootPlants, Posed
from crowdsim.poses.layer import Layer, Part, Scheduler
from crowdsim.poses.outlines import striker_radii
from crowdsim.poses.window import Window

MOST = 0.35
"""Furthest that a foot is carried [m]."""
_MOST_MOVE = 0.12
"""Furthest that the pelvis goes for it [m]."""
_BACK = 0.5
"""Share of what a straight leg has to get shorter that the pelvis gives by going back."""
_MARGIN = 0.004
"""Share of a leg's length that it keeps in hand at its kick."""
_CLEAR, _LEAST = 0.04, 0.01
"""How long before a foot plant, or after it, a kicking foot is on its captured path, and least time that it leaves it
for [s]."""


class Kicks(Layer):
    """Carries feet onto what they hit, as that is posed with its own strikes."""

    name = "kicks"
    size = 0.4
    reach = BLEND
    needs: tuple[str, ...] = ("reactions", "fists")
    looks = LEAN + TOGETHER, LEAN + TOGETHER
    hops = 2

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        if not np.isin(poser.take.events.limb, FEET).any():
            self.needs = ()

    def plan(self, part: Part) -> CarriedFeet | None:
        """Return where feet touch; None without kicks."""
        near, hops = strikes_near(self.poser.landed, part), part.hops + 1
        near = near.of(np.isin(near.limbs, FEET))
        if not len(near.times):
            return None
        pose_at, struck_at = (partial(self.poser.joints, through=name, hops=hops) for name in self.needs)
        return plan_kicks(self.poser.take, near, part.window.columns(), pose_at, struck_at, part.window)

    def apply(self, part: Part, poses: Posed) -> None:
        """Carry them there."""
        kicks, window = part.plans[self.name], part.window
        if kicks is not None:
            share(len(part.moments.columns), carry_feet, part.moments, kicks, window.rows.sizes, window.motion.legs,
                  within(part), poses, threads=window.threads)  # fmt: skip


def plan_kicks(
    take: TakeData, near: Landed, columns: Array, pose_at: PoseAt, struck_at: PoseAt, window: Window
) -> CarriedFeet:
    """Find how far feet have to be carried, and what the pelvis gives.

    Args:
        take: The take.
        near: Landed kicks of avatars of the window.
        columns: Column of every avatar in the window. Shape (N,).
        pose_at: Poses avatars before any of this.
        struck_at: Poses those who are hit.
        window: The stretch of the take.
    """
    joints, sides = window.motion.legs.joints, near.hands
    feet, limbs = np.full((len(near.times), 3), np.nan), np.full((len(near.times), 3, 3), np.nan)
    radii, bare = np.zeros(len(near.times)), take.cast.bare[near.attackers]
    for which, body, scales, positions, rotations in pose_at(near.attackers, near.times):
        rows = np.arange(len(which))
        feet[which] = body_points(body, positions, rotations, scales)[3][rows, near.limbs[which]]
        radii[which] = striker_radii(body, near.limbs[which], scales, bare[which])
        limbs[which] = positions[rows[:, None], joints[sides[which]]]
    touched, struck = find_surfaces(take, near, feet, limbs[:, 0], radii, struck_at, window.motion.target)
    shifts = touched - feet
    length = np.linalg.norm(shifts, axis=-1, keepdims=True)
    shifts = shifts * np.minimum(1.0, MOST / np.maximum(length, 1e-9))
    # Absent avatars have no positions.
    shifts = np.where(np.isfinite(shifts), shifts, 0.0)
    moves = _plan_moves(limbs, shifts)
    spans = np.minimum(near.spans, SPANS)
    spans = np.minimum(spans, _in_the_air(near.times, columns[near.attackers], sides, window.foot_plants))
    order, starts = by_column(columns[near.attackers], len(window.avatars), near.times)
    values = (near.times, sides, shifts, np.maximum(spans, _LEAST), moves, struck)
    return CarriedFeet(starts, *(value[order] for value in values))


def _plan_moves(limbs: Array, shifts: Array) -> Array:
    """How far the pelvis goes for legs that are too short, or too straight to get shorter. (E, 3).

    Args:
        limbs: Hip, knee and ankle [m]. Shape (E, 3, 3).
        shifts: How far the ankle is to go [m]. Shape (E, 3).
    """
    hip, knee, ankle = np.moveaxis(limbs, 1, 0)
    a, b = np.linalg.norm(knee - hip, axis=-1), np.linalg.norm(ankle - knee, axis=-1)
    longest = np.sqrt(a * a + b * b + 2.0 * a * b * math.cos(KNEE_LEAST)) - _MARGIN * (a + b)
    now, way = np.linalg.norm(ankle - hip, axis=-1), ankle + shifts - hip
    wanted = np.linalg.norm(way, axis=-1)
    straight = np.clip((now / longest - 0.8) / 0.2, 0.0, 1.0)
    lack = np.where(
        wanted > now, np.maximum(wanted - np.maximum(longest, now), 0.0), _BACK * straight**2 * (wanted - now)
    )
    level = way * np.array([1.0, 0.0, 1.0])
    across = np.linalg.norm(level, axis=-1)
    # Over the ground it takes the more, the steeper the leg.
    go = np.clip(lack * wanted / np.maximum(across, 0.5 * wanted), -_MOST_MOVE, _MOST_MOVE)
    moves = level / np.maximum(across, 1e-9)[:, None] * go[:, None]
    # The other leg may be straight: the hip goes along a circle about its foot.
    moves[:, 1] = -0.5 * go * go / np.maximum(a + b, 1e-9)
    return np.where(np.isfinite(moves), moves, 0.0)


def _in_the_air(times: Array, columns: Array, sides: Array, plants: FootPlants) -> Array:
    """How long before and after kicks the kicking foot is off the floor [s]. Shape (E, 2)."""
    spans, counts = plants.spans[columns, sides], plants.counts[columns, sides]
    there = np.arange(spans.shape[1]) < counts[:, None]
    since = np.where(there & (spans[..., END] <= times[:, None]), times[:, None] - spans[..., END], np.inf)
    until = np.where(there & (spans[..., BEGIN] >= times[:, None]), spans[..., BEGIN] - times[:, None], np.inf)
    planted = np.any(there & (spans[..., BEGIN] < times[:, None]) & (spans[..., END] > times[:, None]), axis=1)
    result = np.empty((len(times), 2))
    result[:, BEFORE], result[:, AFTER] = since.min(axis=1, initial=np.inf), until.min(axis=1, initial=np.inf)
    return np.where(np.asarray(planted)[:, None], 0.0, result - _CLEAR)
