"""Rounds in which limbs give way, one after the other: each sees the poses that the rounds before it leave."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.take.data import TakeData
from crowdsim.take.deflection import PLANTED, POSES_AT_ONCE, AllJoints, Deflection
from crowdsim.take.hits import Landed
from crowdsim.take.kernels.records import Moments, Playback, Posed
from crowdsim.take.motion import PoseMotion
from crowdsim.take.window import Window


class WholePoses(NamedTuple):
    """Poses of all avatars that are asked for of one policy at the same times, before limbs give way, or after it."""

    policy: int
    which: Array
    window: Window
    moments: Moments
    poses: Posed
    playback: Playback

    def at(self, times: Array, some: Array) -> WholePoses:
        """Return those at some of their times (T,), both ascending."""
        if len(times) == len(some):
            return self
        rows = np.searchsorted(times, some)
        poses = Posed(*(values[rows] for values in self.poses))
        playback = Playback(*(values[rows] for values in self.playback))
        return self._replace(moments=self.moments._replace(times=some[:, None]), poses=poses, playback=playback)


class Rounds:
    """Lets limbs give way, round by round.

    Args:
        take: The take.
        motions: The motion of each of its policies.
        before: Poses avatars (n,), ascending, at the same times (T,), before limbs give way, policy by policy.
        threads: Threads that share the work.
    """

    def __init__(
        self,
        take: TakeData,
        motions: Sequence[PoseMotion],
        before: Callable[[Array, Array], Iterable[WholePoses]],
        threads: int,
    ) -> None:
        self._everyone, self._before = take.avatar_count, before
        self._rounds: list[Deflection] = []
        if take.collision_avoidance and take.avatar_count > 1:
            self._rounds += [
                Deflection(take, motions, partial(self._pose_all, number), threads, planted)
                for number, planted in enumerate(PLANTED)
            ]

    def bend(self, window: Window, moments: Moments, poses: Posed, landed: Landed, rounds: slice = slice(None)) -> None:
        """Let limbs give way in some of the rounds, in place.

        Args:
            window: The stretch of the take.
            moments: Who is posed, and when.
            poses: Their poses before these rounds, changed.
            landed: Strikes that land.
            rounds: Which rounds.
        """
        for one in self._rounds[rounds]:
            one.bend(window, landed, moments, poses)

    def sample(self, avatars: Array, times: Array, landed: Landed) -> list[WholePoses]:
        """Return poses of avatars (n,), ascending, at the same times (T,), with limbs that give way.

        What the rounds depend on besides is posed along with them, where all avatars are asked for.
        """
        everyone = len(avatars) == self._everyone
        stages = self._stages(times) if everyone else [times] * (len(self._rounds) + 1)
        posed = list(self._before(avatars, stages[0]))
        for number, deflection in enumerate(self._rounds):
            if everyone:
                deflection.note(stages[number], landed, partial(_joints_of, posed))
            posed = [one.at(stages[number], stages[number + 1]) for one in posed]
            for one in posed:
                deflection.bend(one.window, landed, one.moments, one.poses)
        return posed

    def _stages(self, times: Array) -> list[Array]:
        """Times at which all are posed before each round, and those (T,) that are asked for, last."""
        stages = [times]
        for deflection in reversed(self._rounds):
            stages.insert(0, np.union1d(stages[0], deflection.lacking(stages[0])))
        many = len(stages[0]) * self._everyone > POSES_AT_ONCE
        return [times] * len(stages) if many else stages

    def _pose_all(self, number: int, avatars: Array, times: Array, landed: Landed) -> AllJoints:
        """Joints of avatars (n,), ascending, at the same times (T,), before a round."""
        posed = list(self._before(avatars, times))
        for one in posed:
            self.bend(one.window, one.moments, one.poses, landed, slice(number))
        return _joints_of(posed, np.arange(len(times)))


def _joints_of(posed: list[WholePoses], some: Array) -> AllJoints:
    """Joints of poses at some of their times, given by index."""
    found = []
    for one in posed:
        poses, times = Posed(one.poses.roots[some], one.poses.rotations[some]), one.moments.times[some]
        freedom = one.window.free_feet(one.moments._replace(times=times))
        found.append((one.policy, one.which, *one.window.world_joints(poses), freedom))
    return found
