"""Poses of a take: from what was recorded to joint rotations at any frame rate.

A pose is a pure function of the take and the policies. It depends on no more than ``REACH`` seconds of the take before
and after its time, so that any range of frames, posed alone, gives the same bytes as the whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.errors import TakeError
from crowdsim.motion.body import Body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Skeleton
from crowdsim.take.contact_events import find_landed, plan_blows, plan_landings
from crowdsim.take.feet import find_homes, measure_feet
from crowdsim.take.fists import carry_fists
from crowdsim.take.limbs import plant_feet
from crowdsim.take.motion import prepare_motion
from crowdsim.take.pose_kernels import blend_poses
from crowdsim.take.reactions import show_blows
from crowdsim.take.take import Take
from crowdsim.take.window import Cuts, Places, Window

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

Array = NDArray[Any]

REACH = 1.0
"""How far a pose looks around its time in the take [s]."""
BLEND = 0.4
"""Length of the blend over a cut, half before it and half after [s]."""


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
        reactions: Whether landed strikes move those whom they hit.

    Raises:
        TakeError: The policies are not those that the take was recorded with.
    """

    def __init__(self, take: Take, policies: Sequence[Policy], threads: int = 1, reactions: bool = True) -> None:
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
        self._motions = [prepare_motion(policy) for policy in policies]
        self._threads = threads
        self._reactions = reactions
        self._landed = find_landed(take)

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
        window = Window(take, motion, avatars, first, stop)
        columns = np.arange(len(avatars))[None]
        places = window.place(times[:, None], columns)
        cuts = window.cuts()
        roots, rotations = self._blend(window, cuts, places, times[:, None], columns[0])
        homes, firmness = find_homes(window, cuts, measure_feet(window, cuts), places, times[:, None], columns[0])
        plant_feet(motion, window.scales, homes, firmness, roots, rotations)
        lookup = np.full(take.avatar_count, -1)
        lookup[avatars] = columns[0]
        first_time, last_time = float(times[0]), float(times[-1])
        landings = plan_landings(take, self._landed, lookup, first_time, last_time, self._pose_at)
        carry_fists(motion, window.scales, landings, times, roots, rotations)
        if self._reactions:
            blows = plan_blows(self._landed, lookup, first_time, last_time, self._pose_at)
            show_blows(motion, blows, times, roots, rotations)
        return Poses(index, avatars, motion.skeleton, take.cast.scales[avatars], roots, rotations, places.ground)

    def _pose_at(self, avatars: Array, times: Array) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Pose avatars (E,) at times (E,) by motion and blends alone."""
        told: list[tuple[Array, Body, Array, Array, Array]] = []
        take, rate = self.take, self.take.control_rate
        for index, motion in enumerate(self._motions):
            which = np.flatnonzero(take.cast.policies[avatars] == index)
            if not len(which):
                continue
            numbers, columns = np.unique(avatars[which], return_inverse=True)
            moments = np.maximum(times[which], 0.0)
            first = max(0, int(np.floor((moments.min() - BLEND) * rate)) - 1)
            stop = min(take.frame_count, int(np.ceil((moments.max() + BLEND) * rate)) + 2)
            window = Window(take, motion, numbers, first, stop)
            places = window.place(moments[None], columns[None])
            roots, rotations = self._blend(window, window.cuts(), places, moments[None], columns)
            scales = take.cast.scales[numbers[columns]].astype(np.float64)
            poses = Poses(index, numbers[columns], motion.skeleton, scales, roots, rotations, places.ground)
            positions, turns = poses.joints()
            told.append((which, motion.body, scales, positions[0], turns[0]))
        return told

    def _blend(self, window: Window, cuts: Cuts, places: Places, times: Array, columns: Array) -> tuple[Array, Array]:
        """Blended poses at places (T, n); ``columns`` (n,) says whose they are."""
        motion, shape = window.motion, places.frames.shape
        roots = np.empty((*shape, 3), np.float32)
        rotations = np.empty((*shape, motion.skeleton.joint_count, 4), np.float32)
        starts, stops, scales = cuts.offsets[columns], cuts.offsets[columns + 1], window.scales[columns]

        def blend(low: int, high: int) -> None:
            blend_poses(low, high, places.frames, places.fractions, places.ground, times, motion.rotations,
                        motion.roots, starts, stops, cuts.times, cuts.turns, cuts.turn_rates, cuts.moves, BLEND / 2,
                        scales, roots, rotations)  # fmt: skip

        share(self._threads, shape[1], blend)
        return roots, rotations


def share(threads: int, count: int, work: Callable[[int, int], None]) -> None:
    """Call ``work(low, high)`` on ranges that together cover ``0`` to ``count``, a thread each."""
    parts = min(threads, count)
    if parts <= 1:
        work(0, count)
        return
    edges = [count * part // parts for part in range(parts + 1)]
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))
