"""A stretch of a take for some avatars: where each is in its motion and on the ground at any time, its transitions."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.crowd.record import TakeData
from crowdsim.policy.alignment import HARDLY, SETTLED
from crowdsim.poses.kernels.blending import BLEND
from crowdsim.poses.kernels.columns import GAP_COLUMNS
from crowdsim.poses.kernels.foot_plants import find_foot_plants, free_feet
from crowdsim.poses.kernels.placement import find_playback
from crowdsim.poses.kernels.records import FootPlants, Moments, Playback, Posed, Rows, Steps, Transitions
from crowdsim.poses.kernels.steps import StepRules, plan_steps
from crowdsim.poses.kernels.transitions import measure_transitions
from crowdsim.poses.motion import PoseMotion
from crowdsim.poses.world import world_joints

LEAST_BLEND = 0.2
"""Least time that a blend lasts before a transition, and after it [s]."""
INTERRUPTED = 0.02, 0.3
"""How long the blend lasts before a blow that interrupts an action, and after it [s]."""
_STEP_RULES = StepRules(
    lifts_within=SETTLED[1],
    landed_within=SETTLED[0],
    wait=0.55,
    shortest=0.12,
    longest=0.17,
    highest=0.05,
    ahead=0.3,
    behind=0.65,
    drag=0.08,
    speed=1.25,
    drag_anyhow=HARDLY,
)
"""A pose sees ``feet.REACH`` seconds around it. What a foot does some time before a transition adds up with how far
after it that is settled, and vice versa, to less than that."""


class Window:
    """Control frames ``first`` to ``stop`` of a take for some avatars of one policy.

    Args:
        take: The take.
        motion: The policy's motion.
        avatars: Numbers of the avatars, ascending; their place here is their column.
        first: First control frame.
        stop: One past the last.
        threads: Threads that share the work.
    """

    def __init__(
        self, take: TakeData, motion: PoseMotion, avatars: Array, first: int, stop: int, threads: int = 1
    ) -> None:
        whole = len(avatars) == take.avatar_count

        def read(array: Any) -> Array:
            values = np.asarray(array[first:stop])
            return np.ascontiguousarray(values if whole else values[:, avatars])

        self.motion, self.avatars, self.threads = motion, avatars, threads
        self._count = take.avatar_count
        action = read(take.action).astype(np.int64)
        speeds = np.asarray(take.cast.speeds, dtype=np.float64)[avatars]
        lengths = motion.lengths[np.maximum(action, 0)].astype(np.float64)
        scales = np.asarray(take.cast.scales, dtype=np.float64)[avatars]
        self._stretches = take.cast.stretches[avatars]
        phase = np.minimum(read(take.action_frame).astype(np.float64), lengths)
        fresh = np.ones(action.shape, bool)
        # An action that starts again need not be another one; otherwise its phase advances by the speed.
        fresh[1:] = (action[1:] != action[:-1]) | (phase[1:] < phase[:-1] + 0.5 * speeds)
        present = action >= 0
        # An action that a blow interrupts, or that is broken off, ends earlier than it was captured.
        left = phase[:-1] + speeds - phase[1:]
        cut = fresh[1:] & present[1:] & present[:-1] & (left < lengths[:-1] - 0.5 / motion.frames.stride)
        lengths[:-1][cut] = np.maximum(
            np.rint(left[cut] * motion.frames.stride) / motion.frames.stride, phase[:-1][cut]
        )
        self._cut = np.concatenate([np.zeros((1, len(avatars)), bool), cut])
        self.rows = Rows(
            present=present,
            origins=motion.origins[np.maximum(action, 0)],
            lengths=lengths,
            phase=phase,
            shifts=motion.shifts[np.maximum(action, 0)],
            ground=np.stack([read(take.x), read(take.z), read(take.heading)], axis=-1).astype(np.float64),
            fresh=fresh,
            speeds=speeds,
            scales=scales,
            sizes=scales[:, None] * self._stretches,
            first=first,
            rate=float(take.control_rate),
        )

    def columns(self) -> Array:
        """Return each avatar's column in the window, -1 for those outside it. Shape (avatars of the take,)."""
        columns = np.full(self._count, -1)
        columns[self.avatars] = np.arange(len(self.avatars))
        return columns

    def playback(self, moments: Moments) -> Playback:
        """Return where avatars are.

        Between two control frames the ground transform follows the motion from the earlier one and up to the later one;
        where the two disagree, because avatars have been pushed apart, one passes into the other.
        """
        shape = (len(moments.times), len(moments.columns))
        playback = Playback(np.empty(shape, np.int32), np.empty(shape), np.empty((*shape, 3)))

        def work(low: int, high: int) -> None:
            find_playback(low, high, self.rows, self.motion.frames, moments, playback)

        share(len(moments.columns), work, threads=self.threads)
        return playback

    def world_joints(self, poses: Posed, columns: Array | None = None) -> tuple[Array, Array]:
        """Return positions (T, n, J, 3) [m] and rotations (T, n, J, 4) of joints of poses.

        Args:
            poses: Poses of avatars of the window.
            columns: Their columns, all of them when None. Shape (n,).
        """
        some = slice(None) if columns is None else columns
        scales, stretches = self.rows.scales[some], self._stretches[some]
        return world_joints(self.motion.skeleton, self.motion.segments, scales, stretches, poses)

    @cached_property
    def transitions(self) -> Transitions:
        """The transitions, measured."""
        rows, frames = self.rows, self.motion.frames
        owner, row = np.nonzero((rows.fresh & rows.present)[1:].T & rows.present[:-1].T)
        row = row + 1
        before = (rows.origins + np.rint(rows.lengths * frames.stride).astype(np.int64))[row - 1, owner]
        after = rows.origins[row, owner]
        seen = before != after
        owner, row, before, after = owner[seen], row[seen], before[seen], after[seen]
        count, joints = len(owner), self.motion.skeleton.joint_count
        transitions = Transitions(
            starts=np.searchsorted(owner, np.arange(len(self.avatars) + 1)),
            owners=owner,
            times=(rows.first + row - rows.phase[row, owner] / rows.speeds[owner]) / rows.rate,
            before=before,
            after=after,
            spans=np.where(
                self._cut[row, owner, None], INTERRUPTED, self._spans(before, after, rows.speeds[owner] * frames.rate)
            ),
            shifts=rows.shifts[row, owner],
            signs=np.empty((count, joints + 1), np.int8),
            ground=np.empty((count, 3)),
            directions=np.empty((count, 2, 2)),
        )

        def work(low: int, high: int) -> None:
            measure_transitions(low, high, rows, frames, transitions)

        share(count, work, threads=self.threads)
        return transitions

    def _spans(self, before: Array, after: Array, pace: Array) -> Array:
        """How long blends last on either side: they keep off strikes, and last longer on the other side instead."""
        strikes = self.motion.strikes
        at = np.searchsorted(strikes, np.stack([before, after]), side="right")
        padded = np.concatenate([[-(10**9)], strikes, [10**9]])
        since, until = (before - padded[at[0]]) / pace, (padded[at[1] + 1] - after) / pace
        room = np.clip(np.stack([since, until], axis=1), LEAST_BLEND, BLEND)
        half = np.minimum(room, 0.5 * BLEND)
        return np.minimum(room, np.minimum(BLEND - half[:, ::-1], 0.7 * BLEND))

    @cached_property
    def foot_plants(self) -> FootPlants:
        """When feet are planted."""
        rows, stride = self.rows, self.motion.frames.stride
        fastest = float(rows.speeds.max(initial=1.0))
        most = (len(rows.phase) * (math.ceil(fastest * stride) + 3)) // 2 + 2
        plants = FootPlants(np.empty((len(self.avatars), 2, most, 2)), np.empty((len(self.avatars), 2), np.int64))

        def work(low: int, high: int) -> None:
            find_foot_plants(low, high, rows, self.motion.frames, plants)

        share(len(self.avatars), work, threads=self.threads)
        return plants

    def free_feet(self, moments: Moments) -> Array:
        """Return how free feet are to move, from 0 to 1. Shape (T, n, 2)."""
        freedom, plants = np.empty((len(moments.times), len(moments.columns), 2)), self.foot_plants
        share(len(moments.columns), free_feet, moments, plants, freedom, threads=self.threads)
        return freedom

    @cached_property
    def steps(self) -> Steps:
        """What feet do about transitions."""
        transitions, plants = self.transitions, self.foot_plants
        count, scales, motion = len(transitions.times), self.rows.scales, self.motion
        steps = Steps(
            kinds=np.empty((count, 2), np.int8),
            moves=np.empty((count, 2, 3)),
            gaps=np.empty((count, 2, GAP_COLUMNS)),
            returns=np.empty((count, 2, 2, 4)),
        )
        share(len(self.avatars), plan_steps, transitions, plants, motion.frames, motion.legs.toes, scales, _STEP_RULES,
              motion.gait, steps, threads=self.threads)  # fmt: skip
        return steps
