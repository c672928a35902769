"""Landed strikes of a take: who hits whom when, and where fist and surface are in the poses before they meet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.motion.body import Body
from crowdsim.take.fists import AFTER, BEFORE, MOST, Landings, body_points, surface_point
from crowdsim.take.reactions import LENGTH, Blows
from crowdsim.take.take import Take

Array = NDArray[Any]
PoseAt = Callable[[Array, Array], list[tuple[Array, Body, Array, Array, Array]]]
"""Poses avatars (E,) at times (E,): for each policy which of them, body, scales, joint positions and rotations."""

_SWING = 0.05
"""Time over which the way of a fist is measured [s]."""
_TARGET_HEAD, _TARGET_TORSO, _TARGET_DROP = 0.105, 0.15, 0.6


@dataclass(frozen=True)
class Landed:
    """Landed strikes in order of time; E strikes.

    Attributes:
        times: When [s]. Shape (E,).
        attackers: Shape (E,).
        victims: Shape (E,); below -1 a scripted target.
        hands: Shape (E,).
        speeds: Shape (E,) [m/s].
    """

    times: Array
    attackers: Array
    victims: Array
    hands: Array
    speeds: Array

    def between(self, first: float, last: float) -> Landed:
        """Return those from ``first`` to ``last`` [s]."""
        low, high = np.searchsorted(self.times, (first, last))
        return Landed(*(getattr(self, name)[low:high] for name in self.__dataclass_fields__))

    def of(self, chosen: Array) -> Landed:
        """Return some of them, by index or by mask."""
        return Landed(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


def find_landed(take: Take) -> Landed:
    """Return a take's landed strikes."""
    events = take.events
    landed = np.flatnonzero(np.asarray(events.landed, dtype=bool))
    times = np.asarray(events.frame, dtype=np.float64)[landed] / take.control_rate
    order = landed[np.argsort(times, kind="stable")]
    return Landed(
        times=np.sort(times, kind="stable"),
        attackers=np.asarray(events.attacker)[order].astype(np.int64),
        victims=np.asarray(events.victim)[order].astype(np.int64),
        hands=np.asarray(events.hand)[order].astype(np.int64),
        speeds=np.asarray(events.speed)[order].astype(np.float64),
    )


def plan_landings(take: Take, landed: Landed, columns: Array, first: float, last: float, pose_at: PoseAt) -> Landings:
    """Find how far fists have to be carried.

    Args:
        take: The take.
        landed: Its landed strikes.
        columns: Column of every avatar in the window, -1 for those that are not in it. Shape (N,).
        first: First time that is posed [s].
        last: Last time that is posed [s].
        pose_at: Poses avatars before any of this.
    """
    near = landed.between(first - AFTER, last + BEFORE)
    near = near.of(columns[near.attackers] >= 0)
    fists = _fists(near, near.times, pose_at)
    shifts = _surfaces(take, near, fists, pose_at) - fists
    length = np.linalg.norm(shifts, axis=-1, keepdims=True)
    shifts = shifts * np.minimum(1.0, MOST / np.maximum(length, 1e-9))
    shifts = np.where(np.isfinite(shifts), shifts, 0.0)
    return Landings(columns[near.attackers], near.times, near.hands, shifts)


def plan_blows(landed: Landed, columns: Array, first: float, last: float, pose_at: PoseAt) -> Blows:
    """Find what hits avatars of a window; arguments as of ``plan_landings``."""
    near = landed.between(first - LENGTH, last)
    near = near.of(near.victims >= 0)
    near = near.of(columns[near.victims] >= 0)
    fists = _fists(near, near.times, pose_at)
    ways = fists - _fists(near, near.times - _SWING, pose_at)
    ways[:, 1] = 0.0
    length = np.linalg.norm(ways, axis=-1, keepdims=True)
    ways = np.where(np.isfinite(ways) & (length > 1e-6), ways / np.maximum(length, 1e-9), 0.0)
    on_head = np.zeros(len(near.times), bool)
    for which, body, scales, positions, turns in pose_at(near.victims, near.times):
        head, _, _, _ = body_points(body, positions, turns)
        on_head[which] = np.linalg.norm(fists[which] - head, axis=-1) < body.head_radius * scales + 0.12 * scales
    return Blows(columns[near.victims], near.times, ways, near.speeds, on_head)


def _fists(near: Landed, times: Array, pose_at: PoseAt) -> Array:
    places = np.full((len(times), 3), np.nan)
    for which, body, _, positions, turns in pose_at(near.attackers, times):
        fists = body_points(body, positions, turns)[3]
        places[which] = fists[np.arange(len(which)), near.hands[which]]
    return places


def _surfaces(take: Take, near: Landed, fists: Array, pose_at: PoseAt) -> Array:
    """Nearest points on what is hit. Shape (E, 3)."""
    points = np.full((len(near.times), 3), np.nan)
    people = np.flatnonzero(near.victims >= 0)
    for which, body, scales, positions, turns in pose_at(near.victims[people], near.times[people]):
        head, neck, pelvis, _ = body_points(body, positions, turns)
        chosen = people[which]
        points[chosen] = surface_point(
            fists[chosen], head, neck, pelvis, body.head_radius * scales, body.torso_radius * scales
        )
    scripted = np.flatnonzero(near.victims < -1)
    if len(scripted):
        frames = np.clip(np.round(near.times[scripted] * take.control_rate).astype(int), 0, take.frame_count - 1)
        heads = np.stack(
            [take.targets[int(f)][-2 - int(v)] for f, v in zip(frames, near.victims[scripted], strict=True)]
        )
        neck, pelvis = heads - [0.0, 0.16, 0.0], heads - [0.0, _TARGET_DROP, 0.0]
        size = np.ones(len(scripted))
        points[scripted] = surface_point(
            fists[scripted], heads, neck, pelvis, size * _TARGET_HEAD, size * _TARGET_TORSO
        )
    return points
