"""Hits show: a landed strike throws head and trunk back along the blow, and they spring back, over the motion.

A strike that is blocked pushes them a third as far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.strikers import LEGS
from crowdsim.poses.contacts import PoseAt, body_points
from crowdsim.poses.down_state import falls_soon
from crowdsim.poses.hits import Landed, by_column
from crowdsim.poses.kernels.columns import HEAD, TORSO
from crowdsim.poses.kernels.reactions import LENGTH, RISE, ROUNDS, Blows, Trunk, show_reactions, strengthen
from crowdsim.poses.kernels.records import Posed
from crowdsim.poses.layer import Layer, Part, Scheduler
from crowdsim.poses.limbs import chain_of
from crowdsim.poses.motion import PoseMotion

_TYPICAL_SPEED, _STRONGEST = 8.0, 1.6
_SWING, _KICK = 0.05, 0.1
"""Time over which the direction of a fist, and of a foot, is measured [s]."""
_NEAR_HEAD = 0.12
_BLOCKED = 1.0 / 3.0
"""Share of a blow that gets through the arm that blocks it."""
_GIVES = {"spine": (0.13, 0.19), "chest": (0.11, 0.1), "neck": (0.02, 0.0), "head": (0.0, 0.0)}
"""Joints that yield, and by how much in a strike of typical speed to the head and to the torso [rad]."""

_LATE = 0.35
"""How far back blows count further away [s]."""
FallsAt = Callable[[Array, Array], Array]


def build_trunk(motion: PoseMotion) -> Trunk:
    """Return the joints of a body that yield to strikes."""
    body, skeleton = motion.body, motion.skeleton
    chain = chain_of(skeleton, [body.roles["head"]])
    gives, gains = np.zeros((len(chain), 2)), np.zeros(2)
    ends = [*np.asarray(skeleton.offsets, dtype=float)[chain[1:]], np.asarray(body.head_offset, dtype=float)]
    for role, give in _GIVES.items():
        # A joint with two roles yields for both.
        gives[chain == body.roles[role]] += give
    for at in range(len(chain)):
        gains += gives[at] * np.linalg.norm(np.sum(ends[at:], axis=0))
    return Trunk(np.asarray(skeleton.parents, dtype=np.int64), chain, gives, gains)


class Reactions(Layer):
    """Blows throw head and trunk back."""

    name = "reactions"
    size = 0.6
    reading = 0.2
    needs = ("separation",)
    looks = (ROUNDS + 1) * LENGTH + _KICK, RISE

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        self._trunks = [build_trunk(motion) for motion in poser.motions]
        self._planner: BlowPlanner | None = None

    def prepare(self, avatars: Array, first: float, last: float) -> None:
        """Find out about what hits avatars."""
        if self.poser.reactions:
            columns = np.full(self.poser.take.avatar_count, -1)
            columns[avatars] = np.arange(len(avatars))
            self._known().plan(columns, len(avatars), first, last)

    def plan(self, part: Part) -> Blows | None:
        """Return what hits avatars; None where nothing shows."""
        if not self.poser.reactions:
            return None
        blows = self._known().plan(part.window.columns(), len(part.window.avatars), *part.span)
        return blows if len(blows.times) else None

    def apply(self, part: Part, poses: Posed) -> None:
        """Add the reactions."""
        blows, trunk, recent = part.plans[self.name], self._trunks[part.policy], _LATE if part.hops > 1 else LENGTH
        if blows is not None:
            share(len(part.moments.columns), show_reactions, part.moments, blows, trunk, recent, poses,
                  threads=part.window.threads)  # fmt: skip

    def _known(self) -> BlowPlanner:
        """What is known of the strikes that land."""
        poser = self.poser
        if self._planner is None or self._planner.landed is not poser.landed:
            falls = partial(falls_soon, poser.take, poser.motions)
            pose_at = partial(poser.joints, through=self.needs[0], hops=1)
            self._planner = BlowPlanner(poser.landed, pose_at, self._trunks, poser.take.cast.policies, falls)
        return self._planner


class BlowPlanner:
    """Finds what hits avatars; what it has found it keeps.

    Args:
        landed: The take's landed and blocked strikes.
        pose_at: Returns the joints of avatars with blends and separation alone.
        trunks: The joints that yield, policy by policy.
        policies: Policy of each avatar. Shape (N,).
        falls: Returns which avatars (E,) are down at times (E,) [s], or will be at once: blows do not show on them.
    """

    def __init__(
        self, landed: Landed, pose_at: PoseAt, trunks: Sequence[Trunk], policies: Array, falls: FallsAt
    ) -> None:
        self.landed, self._pose_at, self._trunks, self._policies = landed, pose_at, trunks, policies
        count = len(landed.times)
        self._known, self._shows = np.zeros(count, bool), (landed.victims >= 0) & ~landed.again & ~landed.missed
        self._axes, self._parts = np.zeros((count, 3)), np.zeros(count, np.int64)
        self._gains, self._own = np.zeros(count), np.zeros(count)
        self._falls = falls

    def plan(self, columns: Array, count: int, first: float, last: float) -> Blows:
        """Return what hits avatars of a window.

        Args:
            columns: Column of every avatar in the window, -1 for those that are not in it. Shape (N,).
            count: Number of columns.
            first: First time that is posed [s].
            last: Last time that is posed [s].
        """
        low, high = np.searchsorted(self.landed.times, (first - (ROUNDS + 1) * LENGTH, last))
        near = np.arange(low, high)[self._shows[low:high]]
        near = near[columns[self.landed.victims[near]] >= 0]
        self._find(near[~self._known[near]])
        near = near[self._shows[near]]
        times = self.landed.times[near]
        order, starts = by_column(columns[self.landed.victims[near]], count, times)
        near, times = near[order], times[order]
        blows = Blows(starts, times, self._axes[near], self._parts[near])
        return blows._replace(axes=strengthen(blows, self._gains[near], self._own[near]))

    def _find(self, fresh: Array) -> None:
        """Find out about strikes, given by number (E,)."""
        if not len(fresh):
            return
        near = self.landed.of(fresh)
        self._shows[fresh] = ~self._falls(near.victims, near.times)
        swings = np.where(np.isin(near.limbs, LEGS), _KICK, _SWING)
        heads, sizes, radii = self._heads(near.victims, near.times)
        moved = np.nan_to_num(self._heads(near.victims, near.times + RISE)[0] - heads)[:, ::2]
        now, places = self._strikers(near.attackers, near.times, near.limbs)
        before, _ = self._strikers(near.attackers, near.times - swings, near.limbs)
        # A fist pushes along its way, and away from who strikes: a hook does both.
        fists, apart = (_unit(np.nan_to_num(way)[:, ::2]) for way in (now - before, heads - places))
        ways = _unit(2.0 * fists + apart)
        strengths = np.minimum(near.speeds / _TYPICAL_SPEED, _STRONGEST) * np.where(near.blocked, _BLOCKED, 1.0)
        # Up cross direction: rotation about it tips upright vectors in the direction.
        self._axes[fresh] = np.stack([ways[:, 1], np.zeros(len(ways)), -ways[:, 0]], axis=1) * strengths[:, None]
        self._parts[fresh] = parts = np.where(np.linalg.norm(near.points - heads, axis=1) < radii, HEAD, TORSO)
        gains = np.array([trunk.gains for trunk in self._trunks])
        # Blows without a gain are not strengthened: what an arm stops need not be seen in the head.
        self._gains[fresh] = np.where(near.blocked, 0.0, gains[self._policies[near.victims], parts] * sizes)
        self._own[fresh] = np.min([np.sum(moved * way, axis=1) for way in (ways, fists, apart)], axis=0)
        self._known[fresh] = True

    def _heads(self, avatars: Array, times: Array) -> tuple[Array, Array, Array]:
        """Return heads of avatars (E,) at times (E,), sizes of bodies, and how near a head a blow hits it.

        Positions are NaN while absent. Shapes (E, 3), (E,) and (E,) [m].
        """
        heads, sizes, radii = np.full((len(times), 3), np.nan), np.ones(len(times)), np.zeros(len(times))
        for which, body, scales, positions, rotations in self._pose_at(avatars, times):
            heads[which] = body_points(body, positions, rotations, scales)[0]
            sizes[which], radii[which] = scales, (body.head_radius + _NEAR_HEAD) * scales
        return heads, sizes, radii

    def _strikers(self, avatars: Array, times: Array, limbs: Array) -> tuple[Array, Array]:
        """Return fists or feet of avatars (E,) at times (E,), and their pelvises [m]. Both of shape (E, 3)."""
        strikers, pelvises = np.full((2, len(times), 3), np.nan)
        for which, body, scales, positions, rotations in self._pose_at(avatars, times):
            _, _, pelvises[which], found = body_points(body, positions, rotations, scales)
            strikers[which] = found[np.arange(len(which)), limbs[which]]
        return strikers, pelvises


def _unit(vectors: Array) -> Array:
    """Vectors (n, 2) of length 1, or 0."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), 0.0)
