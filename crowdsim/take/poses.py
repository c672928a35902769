"""Poses of a take: from what was recorded to joint rotations at any frame rate.

A pose is a pure function of the take and the policies. It depends on no more than ``REACH`` seconds of the take before
and after its time, so that any range of frames, posed alone, gives the same bytes as the whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import TakeError
from crowdsim.motion import ground
from crowdsim.motion.body import Body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.policy.rewards import posed_distance
from crowdsim.take.data import TakeData
from crowdsim.take.feet import hold_feet
from crowdsim.take.fists import PoseAt, plan_landings, reach_out
from crowdsim.take.landed import LEAN, find_landed
from crowdsim.take.motion import PoseMotion, prepare_motion
from crowdsim.take.pose_kernels import blend_poses
from crowdsim.take.reactions import LENGTH, build_trunk, give_way, plan_blows
from crowdsim.take.window import BLEND, Cuts, Places, Window
from crowdsim.take.workers import share

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_Pose = Callable[[Window, int, Array, Array], tuple[Array, Array]]
"""Poses roots and rotations in a window, of a policy, at moments (1, E), of the avatars in columns (E,)."""

REACH = 1.0
"""How far a pose looks around its time in the take [s]."""
_BLOCK, _AROUND = 8.0, 3.0
"""Length of stretches that are searched for buried fists at once, and how far around what is posed [s]."""
_NECK, _NEAR = 0.3, 0.05
"""Where necks are between head and pelvis, and how near fists that miss may be to be looked at closely [m]."""
_LATE, _CLOSE_BY = 0.35, 0.12
"""Where it finds out where fists go of those who are struck: how far it looks back for blows, and around for strikes of
those whom they strike in turn [s]."""


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


class PoseSampler:
    """Poses a take, any range of frames at any rate.

    Args:
        take: The take.
        policies: Its policies, in the order of ``take.cast.policy_names``.
        threads: Threads that share the work; the result does not depend on them.
        reactions: Whether landed strikes move those whom they hit; as the take says when None.

    Raises:
        TakeError: The policies are not those that the take was recorded with.
    """

    def __init__(
        self, take: TakeData, policies: Sequence[Policy], threads: int = 1, reactions: bool | None = None
    ) -> None:
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
        self.motions = [prepare_motion(policy) for policy in policies]
        self._trunks = [build_trunk(motion) for motion in self.motions]
        self._threads = threads
        self._reactions = take.reactions if reactions is None else reactions
        self._landed = find_landed(take)
        self._buried = np.zeros(len(take.events.frame), bool)
        self._searched: set[int] = set()

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
        if len(times):
            self._look_for_buried(float(times[0]), float(times[-1]))
        return [
            self._sample_policy(index, numbers[owners == index], times)
            for index in range(len(self.motions))
            if (owners == index).any()
        ]

    def captured(self, start: int, stop: int, fps: float, avatars: Array | None = None) -> list[Poses]:
        """Return what the capture has there, without blends or anything else; arguments as of ``sample``.

        It is what poses are held against: at cuts it jumps.
        """
        numbers = np.arange(self.take.avatar_count) if avatars is None else np.asarray(avatars)
        owners = self.take.cast.policies[numbers]
        times = (np.arange(start, stop) / fps)[:, None]
        told = []
        for index, motion in enumerate(self.motions):
            mine = numbers[owners == index]
            if not len(mine):
                continue
            columns = np.arange(len(mine))
            window = self.window(index, mine, times)
            places = window.place(times, columns)
            cuts = window.cuts()._replace(starts=np.zeros(len(mine) + 1, np.int64))
            roots, rotations = self._blend(window, cuts, places, times, columns)
            scales = self.take.cast.scales[mine]
            told.append(Poses(index, mine, motion.skeleton, scales, roots, rotations, places.ground))
        return told

    def present(self, avatar: int, start: int, stop: int, fps: float) -> int:
        """Return in how many of the output frames ``start`` to ``stop`` an avatar is there."""
        control = np.floor(np.arange(start, stop) / fps * self.take.control_rate + 1e-9).astype(np.int64)
        control = np.clip(control, 0, self.take.frame_count - 1)
        action = np.asarray(self.take.action[int(control[0]) : int(control[-1]) + 1, avatar])
        return int(np.count_nonzero(action[control - control[0]] >= 0))

    def _look_for_buried(self, first: float, last: float) -> None:
        """Find strikes around a range of times [s] that miss avatars because they are too deep in them."""
        blocks = range(max(0, int((first - _AROUND) // _BLOCK)), int((last + _AROUND) // _BLOCK) + 1)
        fresh = [block for block in blocks if block not in self._searched]
        self._searched.update(fresh)
        if any([self._mark_buried(block * _BLOCK, (block + 1) * _BLOCK) for block in fresh]):
            self._landed = find_landed(self.take, self._buried)

    def _mark_buried(self, first: float, last: float) -> bool:
        """Mark those of a range of times, nearly, since some others may be among them; whether there are any."""
        events = self.take.events
        times = np.asarray(events.frame, dtype=np.float64) / self.take.control_rate
        missed = ~np.asarray(events.landed, dtype=bool) & (np.asarray(events.victim) >= 0)
        some = np.flatnonzero(missed & (times >= first) & (times < last))
        points = np.asarray(events.point, dtype=np.float64).reshape(-1, 3)[some]
        victims = np.asarray(events.victim)[some].astype(np.int64)
        for which, motion, scales, places in self._place_at(victims, times[some]):
            frames, size = np.maximum(places.frames[0], 0), scales[:, None]
            heads, pelvises = (
                ground.to_world(places.ground[0], local[frames].astype(float) * size)
                for local in (motion.heads, motion.frames.roots)
            )
            body, necks = motion.body, heads + _NECK * (pelvises - heads)
            radii = body.head_radius * scales, body.torso_radius * scales
            gaps = posed_distance(points[which], heads, necks, pelvises, *radii)
            self._buried[some[which]] = gaps < _NEAR * scales
        return bool(self._buried[some].any())

    def _sample_policy(self, index: int, avatars: Array, times: Array) -> Poses:
        take, motion = self.take, self.motions[index]
        columns = np.arange(len(avatars))
        window = self.window(index, avatars, times)
        roots, rotations, places = self._pose(window, index, times[:, None], columns)
        lookup = np.full(take.avatar_count, -1)
        lookup[avatars] = columns
        first, last = float(times[0]), float(times[-1])
        near = self._landed.around(first, last, lookup)
        landings = plan_landings(take, near, lookup, len(columns), self._pose_at, self._struck_at, motion)
        reach_out(window, landings, times[:, None], columns, roots, rotations)
        return Poses(index, avatars, motion.skeleton, take.cast.scales[avatars], roots, rotations, places.ground)

    def window(self, index: int, avatars: Array, times: Array) -> Window:
        """Return the stretch of the take that poses of a policy's avatars (n,), ascending, at times [s] depend on."""
        rate = self.take.control_rate
        first = max(0, int(np.floor((times.min() - REACH) * rate)))
        stop = min(self.take.frame_count, int(np.ceil((times.max() + REACH) * rate)) + 2)
        return Window(self.take, self.motions[index], avatars, first, stop, self._threads)

    def _pose(self, window: Window, index: int, times: Array, columns: Array) -> tuple[Array, Array, Places]:
        """Poses at times (T, n) or (T, 1) of the avatars in columns (n,), before fists are carried."""
        places = window.place(times, columns)
        cuts = window.cuts()
        roots, rotations = self._blend(window, cuts, places, times, columns)
        hold_feet(window, cuts, places, times, columns, roots, rotations)
        if self._reactions:
            self._give_way(window, index, times, columns, roots, rotations)
        return roots, rotations, places

    def _blend(self, window: Window, cuts: Cuts, places: Places, times: Array, columns: Array) -> tuple[Array, Array]:
        """Captured motion, and what blends lay over it."""
        motion, rows = window.motion, window.rows
        roots = np.empty((*places.frames.shape, 3), np.float32)
        rotations = np.empty((*places.frames.shape, motion.skeleton.joint_count, 4), np.float32)

        def blend(low: int, high: int) -> None:
            blend_poses(low, high, columns, times, places.frames, places.fractions, places.ground, motion.frames, cuts,
                        rows.rate, BLEND, rows.scales, rows.speeds, motion.hinges, roots, rotations)  # fmt: skip

        share(self._threads, len(columns), blend)
        return roots, rotations

    def _moments(self, avatars: Array, times: Array) -> Iterator[tuple[Array, int, Window, Array, Array]]:
        """For each policy which of some avatars (E,) at times (E,) are its own, their window, columns and times."""
        owners = self.take.cast.policies[avatars]
        for index in np.unique(owners):
            which = np.flatnonzero(owners == index)
            numbers, columns = np.unique(avatars[which], return_inverse=True)
            moments = np.maximum(times[which], 0.0)[None]
            yield which, int(index), self.window(int(index), numbers, moments), columns, moments

    def _place_at(self, avatars: Array, times: Array) -> list[tuple[Array, PoseMotion, Array, Places]]:
        """Where avatars (E,) are at times (E,)."""
        return [
            (which, window.motion, window.rows.scales[columns], window.place(moments, columns))
            for which, _, window, columns, moments in self._moments(avatars, times)
        ]

    def _joints_at(self, avatars: Array, times: Array, pose: _Pose) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Pose avatars (E,) at times (E,), each at its own, in one of the ways below."""
        return [
            self._joints_of(which, window, columns, *pose(window, index, moments, columns))
            for which, index, window, columns, moments in self._moments(avatars, times)
        ]

    def moments(self, avatars: Array, times: Array) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Pose avatars (E,) at times (E,), each at its own.

        Returns:
            For each policy which of them are its own (n,), its body, their sizes (n,), places (n, J, 3) [m] and
            rotations (n, J, 4) of joints in the world.
        """
        if len(times):
            self._look_for_buried(float(times.min()), float(times.max()))

        def pose(window: Window, index: int, moments: Array, columns: Array) -> tuple[Array, Array]:
            roots, rotations, _ = self._pose(window, index, moments, columns)
            self._reach_out(window, moments, columns, roots, rotations, self._pose_at, self._struck_at, LEAN)
            return roots, rotations

        return self._joints_at(avatars, times, pose)

    def _pose_at(self, avatars: Array, times: Array) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Pose avatars (E,) at times (E,), before fists are carried."""
        return self._joints_at(avatars, times, lambda *where: self._pose(*where)[:2])

    def _struck_at(self, avatars: Array, times: Array) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Pose avatars (E,) at times (E,) with what their own fists do to them, nearly.

        Where these fists go is found without feet and early blows, which would look too far around.
        """

        def pose(window: Window, index: int, moments: Array, columns: Array) -> tuple[Array, Array]:
            roots, rotations, _ = self._pose(window, index, moments, columns)
            self._reach_out(window, moments, columns, roots, rotations, self._nearly_at, self._answering_at, LEAN)
            return roots, rotations

        return self._joints_at(avatars, times, pose)

    def _answering_at(self, avatars: Array, times: Array) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Pose avatars (E,) at times (E,) with blends, late blows, and what strikes close by do to them."""

        def pose(window: Window, index: int, moments: Array, columns: Array) -> tuple[Array, Array]:
            roots, rotations = self._pose_nearly(window, index, moments, columns)
            self._reach_out(window, moments, columns, roots, rotations, self._nearly_at, self._nearly_at, _CLOSE_BY)
            return roots, rotations

        return self._joints_at(avatars, times, pose)

    def _nearly_at(self, avatars: Array, times: Array) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Pose avatars (E,) at times (E,) with blends and late blows, and nothing else."""
        return self._joints_at(avatars, times, self._pose_nearly)

    def _pose_nearly(self, window: Window, index: int, moments: Array, columns: Array) -> tuple[Array, Array]:
        """Poses with blends and late blows."""
        places = window.place(moments, columns)
        roots, rotations = self._blend(window, window.cuts(), places, moments, columns)
        if self._reactions:
            self._give_way(window, index, moments, columns, roots, rotations, _LATE)
        return roots, rotations

    def _columns_of(self, window: Window) -> Array:
        """Return each avatar's column in a window, -1 for those outside it. Shape (avatars of the take,)."""
        columns = np.full(self.take.avatar_count, -1)
        columns[window.avatars] = np.arange(len(window.avatars))
        return columns

    def _reach_out(
        self,
        window: Window,
        moments: Array,
        columns: Array,
        roots: Array,
        rotations: Array,
        pose_at: PoseAt,
        struck_at: PoseAt,
        within: float,
    ) -> None:
        """Carry fists to where they go, in place, for strikes that are no further off than ``within`` [s]."""
        lookup = self._columns_of(window)
        near = self._landed.around_each(window.avatars[columns], moments[0], within)
        landings = plan_landings(self.take, near, lookup, len(window.avatars), pose_at, struck_at, window.motion)
        reach_out(window, landings, moments, columns, roots, rotations, within)

    def _give_way(
        self,
        window: Window,
        index: int,
        times: Array,
        columns: Array,
        roots: Array,
        rotations: Array,
        recent: float = LENGTH,
    ) -> None:
        """Lay reactions to blows over poses, in place; to those that are no older than ``recent`` [s]."""
        lookup = self._columns_of(window)
        first, last = float(times.min()), float(times.max())
        blows = plan_blows(self._landed, lookup, len(window.avatars), first, last, self._place_at)
        give_way(window, blows, self._trunks[index], times, columns, roots, rotations, recent)

    def _joints_of(
        self, which: Array, window: Window, columns: Array, roots: Array, rotations: Array
    ) -> tuple[Array, Body, Array, Array, Array]:
        """Joint positions and rotations of poses (1, E)."""
        motion, scales = window.motion, window.rows.scales[columns]
        ground = np.zeros((*roots.shape[:2], 3))
        poses = Poses(0, window.avatars[columns], motion.skeleton, scales, roots, rotations, ground)
        positions, turns = poses.joints()
        return which, motion.body, scales, positions[0], turns[0]
