"""What a run amounts to in a few numbers, gathered from its chunks as they come."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.crowd.chunk import Chunk
from crowdsim.crowd.events import OUTCOMES
from crowdsim.crowd.kd_tree import build_tree, neighbours
from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED, MISSED

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


BODY_RADIUS = 0.2
"""Radius of the disc that a body of scale 1 takes up [m]."""

_OVERLAP_AVATAR_FRAMES = 2_000_000
_FEW = 128
"""As many bodies are compared in pairs, which needs no compiled tree."""


@dataclass(frozen=True)
class CrowdStatistics:
    """A run in numbers.

    Attributes:
        avatars: Number of avatars.
        control_frames: Number of control frames.
        seconds: Their time [s].
        strikes_thrown: Strikes that reached their furthest point.
        strikes_landed: Those that landed.
        strikes_blocked: Those that a forearm or glove of the victim stopped.
        strikes_evaded: Those that would have landed on the victim as it was when the attacker decided on them.
        strikes_missed: All others.
        knock_downs: How often avatars were knocked down.
        hits_per_minute_per_avatar: Strikes landed over the minutes that avatars were present.
        overlap_share: Share of avatar-frames in which a body's disc overlaps another's.
        opponent_changes: How often an avatar took another opponent.
        transitions_per_second: Transitions from one piece of captured motion to another, an avatar and second.
    """

    avatars: int
    control_frames: int
    seconds: float
    strikes_thrown: int
    strikes_landed: int
    strikes_blocked: int
    strikes_evaded: int
    strikes_missed: int
    knock_downs: int
    hits_per_minute_per_avatar: float
    overlap_share: float
    opponent_changes: int
    transitions_per_second: float


class StatisticsCounter:
    """Counts a run's chunks as they come.

    Args:
        policies: The policies of the run.
        policy: Policy of each avatar. Shape (N,).
        scale: Scale of each avatar. Shape (N,).
        planned: Control frames planned; of many avatar-frames only every so many-th frame is looked at for overlaps.
    """

    def __init__(self, policies: Sequence[Policy], policy: ArrayLike, scale: ArrayLike, planned: int = 1) -> None:
        self._rate = float(policies[0].database.control_rate)
        self._policy, self._scale = np.asarray(policy, np.int64), np.asarray(scale, dtype=float)
        self._starts = np.concatenate([[0], np.cumsum([one.actions.action_count for one in policies])])
        self._is_transition = np.concatenate([np.asarray(one.actions.costs) > 0 for one in policies])
        self._every = max(1, -(-planned * len(self._scale) // _OVERLAP_AVATAR_FRAMES))
        self._last: tuple[Array, ...] | None = None
        self._frames = self._present = self._changes = self._transitions = 0
        self._looked = self._overlapping = 0
        self._outcomes, self._downs = np.zeros(len(OUTCOMES), np.int64), 0

    def add(self, chunk: Chunk) -> None:
        """Count one more chunk."""
        self.add_strikes(chunk.events.outcome, chunk.events.down)
        self.add_frames(chunk.variables())

    def add_strikes(self, outcomes: Array, down: Array) -> None:
        """Count more strikes, by what became of them, (S,) uint8, and whether they knocked down, (S,) bool."""
        self._outcomes += np.bincount(outcomes, minlength=len(OUTCOMES))
        self._downs += int(np.count_nonzero(down))

    def add_frames(self, rows: Mapping[str, Array]) -> None:
        """Count more control frames: what is recorded of each avatar, (n, N) each, by name."""
        names = ("action", "action_frame", "opponent")
        now = [np.asarray(rows[name]) for name in names]
        if not len(now[0]):
            return
        # Nothing is before the first frame.
        lasts = self._last or [values[:0] for values in now]
        before = [np.concatenate([last, values[:-1]]) for last, values in zip(lasts, now, strict=True)]
        here, first = now[0] >= 0, len(now[0]) - len(before[0])
        self._present += int(np.count_nonzero(here))
        action, done, opponent = (values[first:] for values in now)
        both = here[first:] & (before[0] >= 0)
        switched = both & ((action != before[0]) | (done <= before[1]))
        whose = (self._starts[self._policy] + action)[switched]
        self._transitions += int(np.count_nonzero(self._is_transition[whose]))
        known = both & (opponent != -1) & (before[2] != -1)
        self._changes += int(np.count_nonzero(known & (opponent != before[2])))
        self._last = tuple(values[-1:].copy() for values in now)
        for frame in range(-self._frames % self._every, len(here), self._every):
            there = here[frame]
            self._looked += int(np.count_nonzero(there))
            x, z = (rows[name][frame][there] for name in ("x", "z"))
            self._overlapping += int(np.count_nonzero(overlapping(x, z, self._scale[there])))
        self._frames += len(here)

    def finish(self) -> CrowdStatistics:
        """Return what has been counted."""
        minutes, landed = self._present / self._rate / 60, int(self._outcomes[LANDED])
        return CrowdStatistics(
            avatars=len(self._scale),
            control_frames=self._frames,
            seconds=self._frames / self._rate,
            strikes_thrown=int(self._outcomes.sum()),
            strikes_landed=landed,
            strikes_blocked=int(self._outcomes[BLOCKED]),
            strikes_evaded=int(self._outcomes[EVADED]),
            strikes_missed=int(self._outcomes[MISSED]),
            knock_downs=self._downs,
            hits_per_minute_per_avatar=landed / minutes if minutes else 0.0,
            overlap_share=self._overlapping / self._looked if self._looked else 0.0,
            opponent_changes=self._changes,
            transitions_per_second=self._transitions / (minutes * 60) if minutes else 0.0,
        )


def overlapping(x: ArrayLike, z: ArrayLike, scale: ArrayLike = 1.0, radius: float = BODY_RADIUS) -> Array:
    """Return whether each body's disc overlaps another's: closer than the two radii, each times its scale.

    Args:
        x: Positions [m]. Shape (N,).
        z: Likewise. Shape (N,).
        scale: Scale of each body. Shape (N,) or ().
        radius: Radius for scale 1 [m].
    """
    xs, zs = np.asarray(x, dtype=float), np.asarray(z, dtype=float)
    radii = np.broadcast_to(np.asarray(scale, dtype=float) * radius, xs.shape)
    if len(xs) < 2:
        return np.zeros(len(xs), bool)
    if len(xs) <= _FEW:
        near = np.hypot(xs[:, None] - xs, zs[:, None] - zs) < radii[:, None] + radii
        np.fill_diagonal(near, val=False)
        few: Array = near.any(axis=1)
        return few
    tree, order = build_tree(xs, zs)
    own = np.arange(len(xs), dtype=np.int32)
    counts, near = neighbours(tree, tree.xs, tree.zs, own, float(2 * radii.max()), 16)
    listed = np.arange(near.shape[1]) < counts[:, None]
    others = np.where(listed, near, 0)
    distance = np.hypot(tree.xs[:, None] - tree.xs[others], tree.zs[:, None] - tree.zs[others])
    closer = listed & (distance < radii[order][:, None] + radii[order][others])
    result = np.empty(len(xs), bool)
    result[order] = closer.any(axis=1)
    return result
