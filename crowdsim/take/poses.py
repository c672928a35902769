"""Poses of a take: from what was recorded to joint rotations at any frame rate.

A pose is a pure function of the take and the policies. It depends on no more than ``REACH`` seconds of the take before
and after its time, so that any range of frames, posed alone, gives the same bytes as the whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.errors import TakeError
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.take.pose_kernels import blend_poses, measure_cuts
from crowdsim.take.take import Take

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

Array = NDArray[Any]

REACH = 1.0
"""How far a pose looks around its time in the take [s]."""
BLEND = 0.4
"""Length of the blend over a cut, half before it and half after [s]."""
_SNAP = 1e-4


@dataclass(frozen=True)
class Poses:
    """Poses of the avatars of one policy over T times; n avatars, J joints.

    Attributes:
        policy: Index of the policy in the take.
        avatars: Numbers of the avatars. Shape (n,).
        skeleton: Their skeleton, unscaled.
        scales: Size of each body. Shape (n,).
        root_positions: Place of the root in the world [m]; NaN while absent. Shape (T, n, 3), float32.
        rotations: Local joint rotations, the root's in the world; NaN while absent. Shape (T, n, J, 4), float32.
        ground: Ground transform. Shape (T, n, 3), float64.
    """

    policy: int
    avatars: Array
    skeleton: Skeleton
    scales: Array
    root_positions: Array
    rotations: Array
    ground: Array

    def at(self, time: int) -> Poses:
        """Return the poses of one of the times."""
        here = slice(time, time + 1)
        return replace(
            self,
            root_positions=self.root_positions[here],
            rotations=self.rotations[here],
            ground=self.ground[here],
        )

    def joints(self) -> tuple[Array, Array]:
        """Return places (T, n, J, 3) [m] and rotations (T, n, J, 4) of all joints in the world."""
        times, count, joints = self.rotations.shape[:3]
        flat = self.rotations.reshape(-1, joints, 4)
        places, turns = forward_kinematics(self.skeleton, np.zeros((len(flat), 3), np.float32), flat, parallel=False)
        places = places.reshape(times, count, joints, 3) * self.scales[:, None, None].astype(np.float32)
        return places + self.root_positions[:, :, None], turns.reshape(times, count, joints, 4)


@dataclass(frozen=True)
class _Motion:
    """A policy's motion as poses need it."""

    skeleton: Skeleton
    stride: int
    rate: float
    rotations: Array
    roots: Array
    ground: Array
    clip_first: Array
    clip_last: Array
    origins: Array
    lengths: Array


def _prepare(policy: Policy) -> _Motion:
    database, graph = policy.database, policy.graph
    stride = database.stride
    headings = quaternion.about_y(-database.ground[:, 2]).astype(np.float32)
    rotations = np.array(database.rotations, dtype=np.float32)
    rotations[:, 0] = quaternion.multiply(headings, rotations[:, 0])
    starts = np.asarray(database.clip_starts, dtype=np.int64) * stride
    clip = np.searchsorted(starts, np.arange(starts[-1]), side="right") - 1
    return _Motion(
        skeleton=database.skeleton,
        stride=stride,
        rate=database.playback_rate,
        rotations=rotations,
        roots=ground.to_local(database.ground, database.root_positions).astype(np.float32),
        ground=np.asarray(database.ground, dtype=np.float64),
        clip_first=starts[clip].astype(np.int64),
        clip_last=(starts[clip + 1] - 1).astype(np.int64),
        origins=(np.asarray(graph.action_first, dtype=np.int64) - 1) * stride,
        lengths=np.asarray(graph.action_lengths, dtype=np.int64),
    )


class PoseSampler:
    """Poses a take, any range of frames at any rate.

    Args:
        take: The take.
        policies: Its policies, in the order of ``take.cast.policy_names``.
        threads: Threads that share the work; the result does not depend on them.

    Raises:
        TakeError: The policies are not those that the take was recorded with.
    """

    def __init__(self, take: Take, policies: Sequence[Policy], threads: int = 1) -> None:
        names = take.cast.policy_names
        if len(policies) != len(names):
            raise TakeError(f"{len(policies)} policies given, the take has {len(names)}: {', '.join(names)}")
        for policy, name, fingerprint in zip(policies, names, take.fingerprints, strict=True):
            if policy.fingerprint != fingerprint:
                raise TakeError(
                    f"policy {name!r} is not the one that the take was recorded with (fingerprint "
                    f"{policy.fingerprint[:12]}, expected {fingerprint[:12]}); run the scenario again"
                )
        self.take = take
        self.policies = tuple(policies)
        self._motions = [_prepare(policy) for policy in policies]
        self._threads = threads

    def sample(self, start: int, stop: int, fps: float, avatars: Array | None = None) -> list[Poses]:
        """Return the poses of output frames ``start`` to ``stop`` at ``fps``, one item a policy that has avatars.

        Args:
            start: First output frame.
            stop: One past the last.
            fps: Output frames a second.
            avatars: Numbers of the avatars, ascending; all when None.
        """
        numbers = np.arange(self.take.avatar_count) if avatars is None else np.asarray(avatars)
        owners = self.take.cast.policies[numbers]
        times = np.arange(start, stop) / fps
        return [
            self._sample_policy(index, numbers[owners == index], times)
            for index in range(len(self._motions))
            if (owners == index).any()
        ]

    def present(self, avatar: int, start: int, stop: int, fps: float) -> int:
        """Return in how many of the output frames ``start`` to ``stop`` an avatar is there."""
        control = np.floor(np.arange(start, stop) / fps * self.take.control_rate + 1e-9).astype(np.int64)
        control = np.clip(control, 0, self.take.frame_count - 1)
        action = np.asarray(self.take.action[int(control[0]) : int(control[-1]) + 1, avatar])
        return int(np.count_nonzero(action[control - control[0]] >= 0))

    def _sample_policy(self, index: int, avatars: Array, times: Array) -> Poses:
        motion, take, rate = self._motions[index], self.take, self.take.control_rate
        first = max(0, int(np.floor((times[0] - REACH) * rate)))
        stop = min(take.frame_count, int(np.ceil((times[-1] + REACH) * rate)) + 2)
        window = _Window(take, motion, avatars, first, stop)
        frames, fractions, grounds = window.place(times)
        cuts = window.cuts()
        roots = np.empty((*frames.shape, 3), np.float32)
        joints = motion.skeleton.joint_count
        rotations = np.empty((*frames.shape, joints, 4), np.float32)

        def blend(low: int, high: int) -> None:
            blend_poses(low, high, frames, fractions, grounds, times, motion.rotations, motion.roots, cuts.offsets,
                        cuts.times, cuts.turns, cuts.turn_rates, cuts.moves, BLEND / 2, window.scales, roots,
                        rotations)  # fmt: skip

        count = len(avatars)
        parts = min(self._threads, count)
        if parts > 1:
            edges = np.linspace(0, count, parts + 1).astype(int)
            with ThreadPoolExecutor(parts) as pool:
                list(pool.map(blend, edges[:-1], edges[1:]))
        else:
            blend(0, count)
        return Poses(index, avatars, motion.skeleton, take.cast.scales[avatars], roots, rotations, grounds)


@dataclass(frozen=True)
class _Cuts:
    """Cuts of some avatars, by avatar and time, with what ``measure_cuts`` makes of them."""

    offsets: Array
    times: Array
    turns: Array
    turn_rates: Array
    moves: Array


class _Window:
    """A stretch of a take for some avatars, as numpy arrays."""

    def __init__(self, take: Take, motion: _Motion, avatars: Array, first: int, stop: int) -> None:
        whole = len(avatars) == take.avatar_count

        def read(array: Any) -> Array:
            values = np.asarray(array[first:stop])
            return values if whole else values[:, avatars]

        self.motion, self.first, self.rate = motion, first, take.control_rate
        self.action = read(take.action).astype(np.int64)
        self.scales = np.asarray(take.cast.scales, dtype=np.float64)[avatars]
        self.speeds = np.asarray(take.cast.speeds, dtype=np.float64)[avatars]
        self.present = self.action >= 0
        action = np.where(self.present, self.action, 0)
        self.lengths = motion.lengths[action].astype(np.float64)
        self.origins = motion.origins[action]
        self.phase = np.minimum(read(take.action_frame).astype(np.float64), self.lengths)
        self.ground = np.stack([read(take.x), read(take.z), read(take.heading)], axis=-1).astype(np.float64)
        fresh = np.ones(self.action.shape, bool)
        fresh[1:] = (self.action[1:] != self.action[:-1]) | (self.phase[1:] < self.phase[:-1])
        self.fresh = fresh

    def _frame(self, phase: Array, origins: Array) -> Array:
        """Playback frames, whole and parts, of phases of actions."""
        return origins + phase * self.motion.stride

    def _ground_at(self, frame: Array) -> Array:
        low = np.floor(frame).astype(np.int64)
        part = (frame - low)[..., None]
        high = np.minimum(low + 1, len(self.motion.ground) - 1)
        return self.motion.ground[low] * (1.0 - part) + np.where(part > 0, self.motion.ground[high] * part, 0.0)

    def _step(self, start: Array, end: Array) -> Array:
        """Ground transform from one playback frame of a clip to another, for each avatar's size."""
        step = ground.compose(ground.inverse(self._ground_at(start)), self._ground_at(end))
        step[..., :2] *= self.scales[:, None]
        return step

    def place(self, times: Array) -> tuple[Array, Array, Array]:
        """Return the playback frame, how far on to the next one, and the ground transform of avatars at times.

        Between two control frames the ground transform follows the motion from the earlier one and up to the later one;
        where the two disagree, because avatars have been pushed apart, one passes into the other.
        """
        clock = times * self.rate - self.first
        before = np.clip(np.floor(clock + 1e-9).astype(np.int64), 0, len(self.action) - 1)
        after = np.minimum(before + 1, len(self.action) - 1)
        part = np.clip(clock - before, 0.0, 1.0)[:, None]
        part = np.where(part < 1e-9, 0.0, part)
        cut = self.fresh[after] & (after > before)[:, None]
        # The action that starts at the later frame has begun before it, by as much as its phase there.
        began = np.where(cut, 1.0 - self.phase[after] / self.speeds, 2.0)
        new = part >= began
        phase_old = np.minimum(self.phase[before] + part * self.speeds, self.lengths[before])
        phase_new = np.clip((part - began) * self.speeds, 0.0, self.lengths[after])
        frame = np.where(new, self._frame(phase_new, self.origins[after]), self._frame(phase_old, self.origins[before]))
        whole = np.floor(frame + _SNAP).astype(np.int64)
        fraction = frame - whole
        fraction = np.where(fraction < _SNAP, 0.0, fraction)
        end_old = self._frame(self.lengths[before], self.origins[before])
        start_new = self._frame(np.zeros_like(self.lengths[after]), self.origins[after])
        here = self._frame(self.phase[before], self.origins[before])
        there = self._frame(self.phase[after], self.origins[after])
        exact = whole + fraction
        over = ground.compose(self._step(here, end_old), self._step(start_new, np.where(new, exact, start_new)))
        forward = np.where(new[..., None], over, self._step(here, np.where(new, here, exact)))
        back = ground.compose(self._step(there, start_new), self._step(end_old, np.where(new, end_old, exact)))
        apart = cut & ~new
        within = self._step(there, np.where(apart, there, exact))
        backward = np.where(apart[..., None], back, within)
        ahead = ground.compose(self.ground[before], forward)
        behind = ground.compose(self.ground[after], backward)
        usable = (self.present[before] & self.present[after] & (after > before)[:, None])[..., None]
        gap = behind - ahead
        gap[..., 2] = ground.wrap(gap[..., 2])
        placed = ahead + np.where(usable, gap * part[..., None], 0.0)
        absent = ~self.present[before]
        return np.where(absent, -1, whole).astype(np.int32), fraction, placed

    def cuts(self) -> _Cuts:
        """Return the places where motion does not go on as captured, measured."""
        motion = self.motion
        avatar, row = np.nonzero((self.fresh & self.present)[1:].T)
        row = row + 1
        was = self.present[row - 1, avatar]
        avatar, row = avatar[was], row[was]
        before = (self.origins + self.lengths.astype(np.int64) * motion.stride)[row - 1, avatar]
        after = self.origins[row, avatar]
        seen = before != after
        avatar, row, before, after = avatar[seen], row[seen], before[seen], after[seen]
        speeds = self.speeds[avatar]
        times = (self.first + row - self.phase[row, avatar] / speeds) / self.rate
        joints = motion.skeleton.joint_count
        turns = np.empty((len(avatar), joints, 3))
        turn_rates = np.empty((len(avatar), joints, 3))
        moves = np.empty((len(avatar), 2, 3))
        bounds = np.stack([before, after], axis=1)
        measure_cuts(before, after, speeds, self.scales[avatar], motion.rate, motion.rotations, motion.roots,
                     motion.clip_first[bounds], motion.clip_last[bounds], turns, turn_rates, moves)  # fmt: skip
        offsets = np.searchsorted(avatar, np.arange(self.action.shape[1] + 1))
        return _Cuts(offsets, times, turns, turn_rates, moves)
