"""Hits show: a landed strike throws head and trunk back along the blow, and they spring back, over the motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.take.kernels.reactions import LENGTH, Blows, Trunk, show_reactions
from crowdsim.take.kernels.records import Moments, Playback, Posed
from crowdsim.take.landed import Landed, by_column
from crowdsim.take.motion import PoseMotion, chain_of
from crowdsim.take.window import Window

PlaceAt = Callable[[Array, Array], list[tuple[Array, PoseMotion, Array, Playback]]]
"""Of avatars (E,) at times (E,): for each policy which of them, its motion, scales, and playback of shape (1, n)."""

_TYPICAL_SPEED, _STRONGEST = 8.0, 1.6
_SWING = 0.05
"""Time over which the direction of a fist is measured [s]."""
_NEAR_HEAD = 0.12
_GIVES = {"spine": (0.07, 0.17), "chest": (0.07, 0.12), "neck": (0.14, 0.06), "head": (0.2, 0.07)}
"""Joints that yield, and by how much in a strike of typical speed to the head and to the torso [rad]."""


def build_trunk(motion: PoseMotion) -> Trunk:
    """Return the joints of a body that yield to strikes."""
    roles = motion.body.roles
    chain = chain_of(motion.skeleton, [roles["head"]])
    gives = np.zeros((len(chain), 2))
    for role, give in _GIVES.items():
        # A joint with two roles yields for both.
        gives[chain == roles[role]] += give
    return Trunk(np.asarray(motion.skeleton.parents, dtype=np.int64), chain, gives)


def plan_blows(landed: Landed, columns: Array, count: int, first: float, last: float, place_at: PlaceAt) -> Blows:
    """Find what hits avatars of a window.

    Args:
        landed: The take's landed strikes.
        columns: Column of every avatar in the window, -1 for those that are not in it. Shape (N,).
        count: Number of columns.
        first: First time that is posed [s].
        last: Last time that is posed [s].
        place_at: Returns the playback of avatars.
    """
    near = landed.between(first - LENGTH, last)
    near = near.of((near.victims >= 0) & ~near.again & ~near.missed)
    near = near.of(columns[near.victims] >= 0)
    axes = np.zeros((len(near.times), 3))
    for which, motion, scales, playback in place_at(near.attackers, near.times):
        frames, hands = playback.frames[0], near.hands[which]
        now = np.maximum(frames, 0)
        before = np.maximum(now - round(_SWING * motion.frames.rate), motion.frames.bounds[now, 0])
        direction = (motion.fists[now, hands] - motion.fists[before, hands]).astype(float) * scales[:, None]
        heading = playback.ground[0, :, 2]
        cos, sin = np.cos(heading), np.sin(heading)
        x, z = direction[:, 0] * cos + direction[:, 2] * sin, direction[:, 2] * cos - direction[:, 0] * sin
        length = np.hypot(x, z)
        strength = np.minimum(near.speeds[which] / _TYPICAL_SPEED, _STRONGEST) / np.maximum(length, 1e-6)
        strength = np.where((length > 1e-6) & (frames >= 0), strength, 0.0)
        # Up cross direction: rotation about it tips upright vectors in the direction.
        axes[which, 0], axes[which, 2] = z * strength, -x * strength
    parts = np.ones(len(near.times), np.int64)
    for which, motion, scales, playback in place_at(near.victims, near.times):
        head = motion.trunks[np.maximum(playback.frames[0], 0), 0].astype(float) * scales[:, None]
        ground = playback.ground[0]
        cos, sin = np.cos(ground[:, 2]), np.sin(ground[:, 2])
        x = ground[:, 0] + head[:, 0] * cos + head[:, 2] * sin
        z = ground[:, 1] - head[:, 0] * sin + head[:, 2] * cos
        gap = np.linalg.norm(near.points[which] - np.stack([x, head[:, 1], z], axis=1), axis=1)
        parts[which] = np.where(gap < (motion.body.head_radius + _NEAR_HEAD) * scales, 0, 1)
    order, starts = by_column(columns[near.victims], count, near.times)
    return Blows(starts, near.times[order], axes[order], parts[order])


def give_way(
    window: Window, blows: Blows, trunk: Trunk, moments: Moments, poses: Posed, recent: float = LENGTH
) -> None:
    """Add reactions to poses, in place.

    Args:
        window: The stretch of the take.
        blows: Strikes that landed.
        trunk: The joints that yield.
        moments: Who is posed, and when.
        poses: Their poses; rotations are changed.
        recent: Time after which blows are left out [s].
    """
    if not len(blows.times):
        return

    def work(low: int, high: int) -> None:
        show_reactions(low, high, moments, blows, trunk, recent, poses)

    share(len(moments.columns), work, threads=window.threads)
