"""The passes by which poses come about: motion and blends, foot plants, hit reactions, strikes that land, deflection.

Where a fist goes depends on the pose of whom it hits, and that on blows and on fists of its own. Each further pass
knows less of others, so that a pose depends on the take around it: on ``REACH`` seconds for motion and blends, on the
blended poses around for separation, and on some control frames more, of splines, for deflection and its second round.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion.body import Body
from crowdsim.take.data import TakeData
from crowdsim.take.deflection_iterations import Rounds, WholePoses
from crowdsim.take.down_state import falls_soon
from crowdsim.take.feet import hold_feet
from crowdsim.take.fists import PoseAt, plan_landings, reach_out
from crowdsim.take.floor_contact import Settling
from crowdsim.take.frame_cache import KeptRows
from crowdsim.take.gaze import HeadTurns, build_gaze, look
from crowdsim.take.hands import hold_hands
from crowdsim.take.hits import Landed, find_landed
from crowdsim.take.kernels.blending import blend_poses
from crowdsim.take.kernels.fists import LEAN
from crowdsim.take.kernels.reactions import LENGTH
from crowdsim.take.kernels.records import Moments, Playback, Posed, Transitions
from crowdsim.take.kernels.separation import shift_roots
from crowdsim.take.kicks import kick, split_kicks
from crowdsim.take.motion import PoseMotion
from crowdsim.take.pelvis_drop import Lowering
from crowdsim.take.reactions import BlowPlanner, build_trunk, give_way
from crowdsim.take.separation import Separation
from crowdsim.take.window import Window

Joints = tuple[Array, Body, Array, Array, Array]
"""Joints of some of the avatars asked for: which of them (n,), body, sizes (n,), positions (n, J, 3) [m] and rotations
(n, J, 4) in the world."""
_Pose = Callable[[Window, int, Moments], Posed]
"""Poses avatars of a policy in a window, each at its own time: times of shape (1, n)."""

REACH = 1.25
"""How far a pose looks around its time in the take [s], before limbs are deflected."""
_LATE, _CLOSE_BY = 0.35, 0.12
"""For the fists of those who are hit: how far back blows count, and how near in time strikes of those whom they hit in
turn [s]."""


class Passes:
    """Poses of a take, pass by pass.

    Args:
        take: The take.
        motions: The motion of each of its policies.
        threads: Threads that share the work.
        reactions: Whether landed strikes move those whom they hit.

    Attributes:
        landed: Strikes that land.
    """

    def __init__(self, take: TakeData, motions: Sequence[PoseMotion], threads: int, reactions: bool) -> None:
        self._take, self._motions, self._threads, self._reactions = take, motions, threads, reactions
        size = take.frame_count, take.avatar_count
        landed = find_landed(take)
        self._pushes = KeptRows(*size, Separation(take, motions, landed, self._blended_joints).find)
        self._turns = KeptRows(*size, HeadTurns(take, motions).find)
        self._lowering = Lowering(take, partial(self.window, lowered=False), self.blend)
        self._gazes = [build_gaze(motion) for motion in motions]
        self._trunks = [build_trunk(motion) for motion in motions]
        self._rounds = Rounds(take, motions, self._before_deflection, threads)
        self._settlings = [Settling(motion) for motion in motions]
        self.strike(landed)

    def strike(self, landed: Landed) -> None:
        """Take these strikes for those that land."""
        self.landed = landed
        falls = partial(falls_soon, self._take, self._motions)
        self._planner = BlowPlanner(landed, self._blended_at, self._trunks, self._take.cast.policies, falls)

    def window(self, index: int, avatars: Array, times: Array, lowered: bool = True, separated: bool = True) -> Window:
        """Return the stretch of the take that poses of a policy's avatars (n,), ascending, at times [s] depend on.

        Pelvises that are not ``lowered`` go down only for what is left of legs that are too short. Bodies that are not
        ``separated`` do not give way, and heads do not turn.
        """
        rate = self._take.control_rate
        first = max(0, int(np.floor((times.min() - REACH) * rate)))
        stop = min(self._take.frame_count, int(np.ceil((times.max() + REACH) * rate)) + 2)
        # Of these only control frames at the times themselves are read, as far as splines reach.
        pushes, turns, lows = (np.zeros((stop - first, len(avatars), size)) for size in (2, 1, 1))
        low, high = max(int(times.min() * rate) - 1, first), min(int(times.max() * rate) + 3, stop)
        if low < high and separated:
            pushes[low - first : high - first] = self._pushes.rows(low, high, avatars)
            turns[low - first : high - first] = self._turns.rows(low, high, avatars)
            if lowered:
                lows[low - first : high - first, :, 0] = self._lowering.rows(low, high, avatars)
        rows = pushes, turns[..., 0], lows[..., 0]
        return Window(self._take, self._motions[index], avatars, first, stop, *rows, self._threads)

    def blend(self, window: Window, transitions: Transitions, playback: Playback, moments: Moments) -> Posed:
        """Return captured motion with what blends add to it."""
        motion, shape = window.motion, playback.frames.shape
        poses = Posed(np.empty((*shape, 3), np.float32), np.empty((*shape, motion.skeleton.joint_count, 4), np.float32))

        def blend(low: int, high: int) -> None:
            blend_poses(low, high, moments, playback, window.rows, motion.frames, transitions, motion.hinges, poses)

        share(len(moments.columns), blend, threads=self._threads)
        return poses

    def _blended_joints(self, index: int, avatars: Array, times: Array) -> tuple[Array, Array]:
        """Joints of a policy's avatars (n,), ascending, at times (T,) [s], with blends alone. (T, n, J, 3 and 4)."""
        window = self.window(index, avatars, times, separated=False)
        moments = Moments(np.arange(len(avatars)), times[:, None])
        poses = self.blend(window, window.transitions(), window.playback(moments), moments)
        return window.world_joints(poses)

    def pose(self, window: Window, index: int, moments: Moments) -> tuple[Posed, Playback]:
        """Return poses before fists are carried, and where the avatars are."""
        playback = window.playback(moments)
        transitions = window.transitions()
        poses = self.blend(window, transitions, playback, moments)
        hold_feet(window, transitions, playback, moments, poses)
        hold_hands(window, moments, poses)
        girths = np.asarray(self._take.cast.girths, dtype=np.float64)[window.avatars]
        self._settlings[index].settle(window, girths, playback, moments, poses)
        look(window, self._gazes[index], moments, poses)
        if self._reactions:
            self._give_way(window, index, moments, poses)
        return poses, playback

    def place_at(self, avatars: Array, times: Array) -> list[tuple[Array, PoseMotion, Array, Playback]]:
        """Return where avatars (E,) are at times (E,): which of them, their motion, sizes of bones and playback."""
        return [
            (which, window.motion, window.rows.sizes[moments.columns], window.playback(moments))
            for which, _, window, moments in self._moments(avatars, times)
        ]

    def pose_at(self, avatars: Array, times: Array) -> list[Joints]:
        """Return joints of avatars (E,) at times (E,), before fists are carried."""
        return self._joints_at(avatars, times, self._posed)

    def struck_at(self, avatars: Array, times: Array) -> list[Joints]:
        """Return joints of avatars (E,) at times (E,) with what their own fists do to them, nearly.

        Where these fists go is found without feet and early blows, which would look too far around.
        """
        reach = partial(self._reach_out, pose_at=self._nearly_at, struck_at=self._answering_at, within=LEAN)
        return self._joints_at(avatars, times, partial(self._reaching, self._posed, reach))

    def final_at(self, avatars: Array, times: Array) -> list[Joints]:
        """Return joints of avatars (E,) at times (E,), each at its own, as they are shown."""
        return self._joints_at(avatars, times, self._shown)

    def _shown(self, window: Window, index: int, moments: Moments) -> Posed:
        reach = partial(self._reach_out, pose_at=self.pose_at, struck_at=self.struck_at, within=LEAN, shown=True)
        poses = self._reaching(self._posed, reach, window, index, moments)
        self._rounds.bend(window, moments, poses, self.landed)
        return poses

    def _answering_at(self, avatars: Array, times: Array) -> list[Joints]:
        """Joints of avatars (E,) at times (E,) with blends, late blows, and what strikes close by do to them."""
        reach = partial(self._reach_out, pose_at=self._nearly_at, struck_at=self._nearly_at, within=_CLOSE_BY)
        return self._joints_at(avatars, times, partial(self._reaching, self._pose_nearly, reach))

    def _nearly_at(self, avatars: Array, times: Array) -> list[Joints]:
        """Joints of avatars (E,) at times (E,) with blends and late blows, and nothing else."""
        return self._joints_at(avatars, times, self._pose_nearly)

    def _blended_at(self, avatars: Array, times: Array) -> list[Joints]:
        """Joints of avatars (E,) at times (E,) with blends, trunks apart, and nothing else."""
        return self._joints_at(avatars, times, self._blend_apart)

    def _blend_apart(self, window: Window, index: int, moments: Moments) -> Posed:
        poses = self.blend(window, window.transitions(), window.playback(moments), moments)
        shift_roots(0, len(moments.columns), moments, window.rows, poses)
        return poses

    def _posed(self, window: Window, index: int, moments: Moments) -> Posed:
        return self.pose(window, index, moments)[0]

    def _pose_nearly(self, window: Window, index: int, moments: Moments) -> Posed:
        """Poses with blends, trunks apart, and late blows."""
        poses = self._blend_apart(window, index, moments)
        if self._reactions:
            self._give_way(window, index, moments, poses, _LATE)
        return poses

    def _reaching(
        self, pose: _Pose, reach: Callable[[Window, Moments, Posed], None], window: Window, index: int, moments: Moments
    ) -> Posed:
        """Poses of one pass, with fists carried to where they go."""
        poses = pose(window, index, moments)
        reach(window, moments, poses)
        return poses

    def _moments(self, avatars: Array, times: Array) -> Iterator[tuple[Array, int, Window, Moments]]:
        """For each policy which of some avatars (E,) at times (E,) are its own, their window, avatars and times."""
        owners = self._take.cast.policies[avatars]
        for index in np.unique(owners):
            which = np.flatnonzero(owners == index)
            numbers, columns = np.unique(avatars[which], return_inverse=True)
            moments = Moments(columns, np.maximum(times[which], 0.0)[None])
            yield which, int(index), self.window(int(index), numbers, moments.times), moments

    def _joints_at(self, avatars: Array, times: Array, pose: _Pose) -> list[Joints]:
        """Joints of avatars (E,) at times (E,), each at its own, by one of the passes."""
        found = []
        for which, index, window, moments in self._moments(avatars, times):
            scales, poses = window.rows.scales[moments.columns], pose(window, index, moments)
            positions, rotations = window.world_joints(poses, moments.columns)
            found.append((which, window.motion.body, scales, positions[0], rotations[0]))
        return found

    def sample(self, avatars: Array, times: Array) -> Iterator[tuple[int, Array, Posed, Playback]]:
        """Pose avatars (n,), ascending, at the same times (T,) as they are shown.

        Yields:
            For each policy its number, which of them, their poses, and where they are.
        """
        for one in self._rounds.sample(avatars, times, self.landed):
            yield one.policy, one.which, one.poses, one.playback

    def _before_deflection(self, avatars: Array, times: Array) -> Iterator[WholePoses]:
        """Pose avatars (n,), ascending, at the same times (T,), before limbs give way, policy by policy."""
        owners = self._take.cast.policies[avatars]
        for index in np.unique(owners):
            which = np.flatnonzero(owners == index)
            window = self.window(int(index), avatars[which], times)
            moments = Moments(np.arange(len(which)), times[:, None])
            poses, playback = self.pose(window, int(index), moments)
            self._carry(window, moments, poses)
            yield WholePoses(int(index), which, window, moments, poses, playback)

    def _carry(self, window: Window, moments: Moments, poses: Posed) -> None:
        """Carry fists and feet to where they go, in place, for poses of all avatars of a window at the same times."""
        first, last = float(moments.times[0, 0]), float(moments.times[-1, 0])
        lookup = window.columns()
        count, (near, kicks) = len(window.avatars), split_kicks(self.landed.around(first, last, lookup))
        kick(self._take, kicks, lookup, self.pose_at, self.struck_at, window, moments, poses)
        landings = plan_landings(
            self._take, near, lookup, count, self.pose_at, self.struck_at, window.motion, shown=True
        )
        reach_out(window, landings, moments, poses)

    def _reach_out(
        self,
        window: Window,
        moments: Moments,
        poses: Posed,
        pose_at: PoseAt,
        struck_at: PoseAt,
        within: float,
        shown: bool = False,
    ) -> None:
        """Carry fists and feet to where they go, in place, for strikes that are no further off than ``within`` [s]."""
        lookup, count = window.columns(), len(window.avatars)
        near, kicks = split_kicks(self.landed.around_each(window.avatars[moments.columns], moments.times[0], within))
        kick(self._take, kicks, lookup, pose_at, struck_at, window, moments, poses, within)
        landings = plan_landings(self._take, near, lookup, count, pose_at, struck_at, window.motion, shown)
        reach_out(window, landings, moments, poses, within)

    def _give_way(self, window: Window, index: int, moments: Moments, poses: Posed, recent: float = LENGTH) -> None:
        """Add hit reactions to poses, in place; to blows that are no older than ``recent`` [s]."""
        lookup = window.columns()
        first, last = float(moments.times.min()), float(moments.times.max())
        blows = self._planner.plan(lookup, len(window.avatars), first, last)
        give_way(window, blows, self._trunks[index], moments, poses, recent)
