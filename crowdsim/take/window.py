"""A stretch of a take for some avatars: where each is in its motion and on the ground at any time, and its cuts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.policy.alignment import HARDLY, SETTLED
from crowdsim.take.data import TakeData
from crowdsim.take.motion import PoseMotion
from crowdsim.take.window_kernels import find_stands, measure_cuts, place_avatars, plan_falls
from crowdsim.take.workers import share

BLEND = 0.8
"""Length of the blend over a cut, half before it and half after where no strike is near [s]."""
LEAST_BLEND = 0.1
"""Least time that it lasts before a cut, and after it [s]."""
FALLS = (SETTLED[1], SETTLED[0], 0.55, 0.12, 0.17, 0.05, 0.3, 0.65, 0.08, 1.25, HARDLY)
"""What feet do about cuts: time after a cut in which they come up, or before it in which they came down, so that they
need no step [s]; time between a cut and a step [s]; how long a step lasts at the least and at the most [s]; how high it
is at the most [m]; time before a cut from which on feet are dragged a little way, and time after it up to which they
are [s]; furthest that they are dragged [m]; mean speed of feet in the air
that is never exceeded for a cut [m/s]; how far they are dragged anyhow before they step [m].

A pose sees a second around it. What a foot does some time before a cut adds up with how far after it that is settled,
and the other way round, to less than that.
"""

STEPS = 2
"""The kind of fall that is a step."""


class Rows(NamedTuple):
    """Control frames of a take for compiled code; R rows, n avatars.

    Attributes:
        present: Whether each avatar is there. Shape (R, n), bool.
        origins: Playback frame at which its action starts. Shape (R, n), int64.
        lengths: Length of its action [control frames]. Shape (R, n).
        phase: How much of it is done [control frames]. Shape (R, n).
        shifts: Where the ground transform of its first frame lies when it starts, as seen from the avatar's. Shape
            (R, n, 3).
        ground: Ground transform. Shape (R, n, 3).
        fresh: Whether its action began on the way to this row. Shape (R, n), bool.
        speeds: Motion frames in a control frame. Shape (n,).
        scales: Size of each body. Shape (n,).
        first: Control frame of the first row.
        rate: Control frames a second.
    """

    present: Array
    origins: Array
    lengths: Array
    phase: Array
    shifts: Array
    ground: Array
    fresh: Array
    speeds: Array
    scales: Array
    first: int
    rate: float


@dataclass(frozen=True)
class Places:
    """Where avatars are at T times; n of them.

    Attributes:
        frames: Playback frame; -1 while absent. Shape (T, n), int32.
        fractions: How far on to the next playback frame. Shape (T, n).
        ground: Ground transform. Shape (T, n, 3).
    """

    frames: Array
    fractions: Array
    ground: Array


class Cuts(NamedTuple):
    """Where motion does not go on as captured, by avatar and time; C cuts of n avatars, J joints.

    Attributes:
        starts: Cuts of avatar i are ``starts[i]`` up to ``starts[i + 1]``. Shape (n + 1,).
        owners: Avatar of each cut, a column of the window. Shape (C,).
        times: When [s]. Shape (C,).
        before: Playback frame that the cut leaves. Shape (C,).
        after: Playback frame that it goes on from. Shape (C,).
        spans: How long before and after the cut the blend over it lasts [s]. Shape (C, 2).
        signs: See ``measure_cuts``. Shape (C, J + 1).
        shifts: Where the ground transform of the motion gone on with lies, as seen from that of the motion left. Shape
            (C, 3).
        places: See ``measure_cuts``. Shape (C, 3).
        looks: Likewise. Shape (C, 2, 2).
        gaps: Likewise. Shape (C, 2, 9).
    """

    starts: Array
    owners: Array
    times: Array
    before: Array
    after: Array
    spans: Array
    signs: Array
    shifts: Array
    places: Array
    looks: Array
    gaps: Array


class Stands(NamedTuple):
    """When feet are planted; n avatars.

    Attributes:
        spans: Beginning and end of each stand, in order [s]. Shape (n, 2, most, 2).
        counts: How many each foot has. Shape (n, 2).
    """

    spans: Array
    counts: Array


class Falls(NamedTuple):
    """What feet do about cuts; C cuts.

    Attributes:
        kinds: See ``plan_falls``. Shape (C, 2), int8.
        moves: Likewise. Shape (C, 2, 3).
    """

    kinds: Array
    moves: Array


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
            return values if whole else values[:, avatars]

        self.motion, self.avatars, self.threads = motion, avatars, threads
        action = read(take.action).astype(np.int64)
        speeds = np.asarray(take.cast.speeds, dtype=np.float64)[avatars]
        lengths = motion.lengths[np.maximum(action, 0)].astype(np.float64)
        phase = np.minimum(read(take.action_frame).astype(np.float64), lengths)
        fresh = np.ones(action.shape, bool)
        # An action that starts anew need not be another one; what goes on goes on by the speed.
        fresh[1:] = (action[1:] != action[:-1]) | (phase[1:] < phase[:-1] + 0.5 * speeds)
        self.rows = Rows(
            present=action >= 0,
            origins=motion.origins[np.maximum(action, 0)],
            lengths=lengths,
            phase=phase,
            shifts=motion.shifts[np.maximum(action, 0)],
            ground=np.stack([read(take.x), read(take.z), read(take.heading)], axis=-1).astype(np.float64),
            fresh=fresh,
            speeds=speeds,
            scales=np.asarray(take.cast.scales, dtype=np.float64)[avatars],
            first=first,
            rate=float(take.control_rate),
        )

    def place(self, times: Array, columns: Array) -> Places:
        """Return where the avatars in ``columns`` (n,) are at times (T, n) or (T, 1).

        Between two control frames the ground transform follows the motion from the earlier one and up to the later one;
        where the two disagree, because avatars have been pushed apart, one passes into the other.
        """
        shape = (len(times), len(columns))
        frames, fractions, ground = np.empty(shape, np.int32), np.empty(shape), np.empty((*shape, 3))

        def work(low: int, high: int) -> None:
            place_avatars(self.rows, self.motion.frames, low, high, columns, times, frames, fractions, ground)

        share(self.threads, len(columns), work)
        return Places(frames, fractions, ground)

    def cuts(self) -> Cuts:
        """Return the cuts, measured."""
        rows, frames = self.rows, self.motion.frames
        owner, row = np.nonzero((rows.fresh & rows.present)[1:].T & rows.present[:-1].T)
        row = row + 1
        before = (rows.origins + rows.lengths.astype(np.int64) * frames.stride)[row - 1, owner]
        after = rows.origins[row, owner]
        seen = before != after
        owner, row, before, after = owner[seen], row[seen], before[seen], after[seen]
        times = (rows.first + row - rows.phase[row, owner] / rows.speeds[owner]) / rows.rate
        count, joints = len(owner), self.motion.skeleton.joint_count
        cuts = Cuts(
            starts=np.searchsorted(owner, np.arange(len(self.avatars) + 1)),
            owners=owner,
            times=times,
            before=before,
            after=after,
            spans=self._spans(before, after, rows.speeds[owner] * frames.rate),
            signs=np.empty((count, joints + 1), np.int8),
            shifts=rows.shifts[row, owner],
            places=np.empty((count, 3)),
            looks=np.empty((count, 2, 2)),
            gaps=np.empty((count, 2, 9)),
        )

        def work(low: int, high: int) -> None:
            measure_cuts(rows, frames, self.motion.legs.toes, low, high, *cuts[1:5], *cuts[6:])

        share(self.threads, count, work)
        return cuts

    def _spans(self, before: Array, after: Array, pace: Array) -> Array:
        """How long blends last on either side: they keep off strikes, and last longer on the other side instead."""
        strikes = self.motion.strikes
        at = np.searchsorted(strikes, np.stack([before, after]), side="right")
        padded = np.concatenate([[-(10**9)], strikes, [10**9]])
        since, until = (before - padded[at[0]]) / pace, (padded[at[1] + 1] - after) / pace
        room = np.clip(np.stack([since, until], axis=1), LEAST_BLEND, BLEND)
        half = np.minimum(room, 0.5 * BLEND)
        return np.minimum(room, np.minimum(BLEND - half[:, ::-1], 0.7 * BLEND))

    def stands(self) -> Stands:
        """Return when feet are planted."""
        rows, stride = self.rows, self.motion.frames.stride
        fastest = float(rows.speeds.max(initial=1.0))
        most = (len(rows.phase) * (math.ceil(fastest * stride) + 3)) // 2 + 2
        spans = np.empty((len(self.avatars), 2, most, 2))
        counts = np.empty((len(self.avatars), 2), np.int64)

        def work(low: int, high: int) -> None:
            find_stands(rows, self.motion.frames, low, high, spans, counts)

        share(self.threads, len(self.avatars), work)
        return Stands(spans, counts)

    def falls(self, cuts: Cuts, stands: Stands) -> Falls:
        """Return what feet do about cuts."""
        rows = self.rows
        falls = Falls(np.empty((len(cuts.times), 2), np.int8), np.empty((len(cuts.times), 2, 3)))

        def work(low: int, high: int) -> None:
            plan_falls(cuts, stands, self.motion.frames, rows.scales, low, high, FALLS, self.motion.gait, *falls)

        share(self.threads, len(self.avatars), work)
        return falls
