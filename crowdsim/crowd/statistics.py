"""What a run amounts to in a few numbers, gathered from its chunks as they come."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.crowd.chunk import Chunk
from crowdsim.crowd.events import OUTCOMES
from crowdsim.crowd.kd_tree import build_tree
from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED, MISSED
from crowdsim.crowd.kernels.statistics import count_frames, find_overlaps
from crowdsim.crowd.workers import Workers

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


BODY_RADIUS = 0.2
"""Radius of the disc that a body of scale 1 takes up [m]."""

_OVERLAP_AVATAR_FRAMES = 2_000_000
_AVATARS = 16_384
"""Fewest avatars whose counting is worth a range of its own."""
_FEW, _PAIRS_AT_ONCE = 128, 1_000_000
"""As many bodies are compared in pairs, which needs no compiled tree; and pairs that are compared at once."""


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
        threads: Threads that count.
    """

    def __init__(
        self, policies: Sequence[Policy], policy: ArrayLike, scale: ArrayLike, planned: int = 1, threads: int = 1
    ) -> None:
        self._rate, self._threads = float(policies[0].database.control_rate), threads
        self._scale = np.asarray(scale, dtype=float)
        starts = np.concatenate([[0], np.cumsum([one.actions.action_count for one in policies])])
        self._first_action = starts[np.asarray(policy, np.int64)].astype(np.int32)
        self._is_transition = np.concatenate([np.asarray(one.actions.costs) > 0 for one in policies])
        self._every = max(1, -(-planned * len(self._scale) // _OVERLAP_AVATAR_FRAMES))
        # Nothing is before the first frame.
        self._last_done = np.zeros(len(self._scale), np.float32)
        self._last_shown = np.full((2, len(self._scale)), -1, np.int32)
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
        action, opponent = (np.ascontiguousarray(rows[name], np.int32) for name in ("action", "opponent"))
        done = np.ascontiguousarray(rows["action_frame"], np.float32)
        counts: list[Array] = []

        def count(first: int, last: int) -> None:
            found = np.empty(3, np.int64)
            count_frames(
                action, done, opponent, self._first_action, self._is_transition, first, last, self._last_done,
                self._last_shown, found,
            )  # fmt: skip
            counts.append(found)

        share(len(self._scale), count, threads=self._threads, least=_AVATARS)
        present, transitions, changes = np.sum([np.zeros(3, np.int64), *counts], axis=0).tolist()
        self._present, self._transitions = self._present + present, self._transitions + transitions
        self._changes += changes
        some = slice(-self._frames % self._every, None, self._every)
        here = action[some] >= 0
        self._looked += int(np.count_nonzero(here))
        x, z = (np.where(here, rows[name][some], np.nan) for name in ("x", "z"))
        self._overlapping += int(np.count_nonzero(overlapping(x, z, self._scale, threads=self._threads)))
        self._frames += len(action)

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


def overlapping(
    x: ArrayLike, z: ArrayLike, scale: ArrayLike = 1.0, radius: float = BODY_RADIUS, threads: int = 1
) -> Array:
    """Return whether each body's disc overlaps another's: closer than the two radii, each times its scale.

    Of many bodies, each is compared with the sixteen nearest.

    Args:
        x: Positions, NaN of absent bodies [m]. Shape (T, N) or (N,).
        z: Likewise.
        scale: Scale of each body. Shape (N,) or ().
        radius: Radius for scale 1 [m].
        threads: Threads that compare many bodies.
    """
    xs, zs = np.asarray(x, dtype=float), np.asarray(z, dtype=float)
    count = xs.shape[-1]
    radii = np.ascontiguousarray(np.broadcast_to(np.asarray(scale, dtype=float) * radius, count))
    result = np.zeros(xs.shape, bool)
    rows = tuple(values.reshape(xs.size // max(count, 1), count) for values in (xs, zs, result))
    if count <= _FEW:
        at_once = max(_PAIRS_AT_ONCE // max(count * count, 1), 1)
        for low in range(0, len(rows[0]), at_once):
            own_x, own_z, found = (values[low : low + at_once] for values in rows)
            apart = np.hypot(own_x[:, :, None] - own_x[:, None], own_z[:, :, None] - own_z[:, None])
            found[:] = ((apart < radii[:, None] + radii) & ~np.eye(count, dtype=bool)).any(axis=2)
        return result
    for own_x, own_z, found in zip(*rows, strict=True):
        here = np.isfinite(own_x)
        found[here] = _overlapping_of_many(own_x[here], own_z[here], radii[here], threads)
    return result


def _overlapping_of_many(x: Array, z: Array, radii: Array, threads: int) -> Array:
    """Return whether each body (n,) overlaps one of the sixteen nearest."""
    result = np.zeros(len(x), bool)
    if len(x) > 1:
        greatest = float(radii.max())
        with Workers(threads) as workers:
            tree, order = build_tree(x, z, workers=workers)
            workers.each(lambda first, last: find_overlaps(tree, order, radii, greatest, first, last, result), len(x))
    return result
