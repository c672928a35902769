"""Poses of a take: from what was recorded to joint rotations at any frame rate.

A pose is a pure function of the take and the policies. It depends on the take around its time: on ``REACH`` seconds
for the motion, more for separation, fists and deflection, and on what hit bodies in the two seconds before. Any range
of frames, posed alone, gives the same bytes as the whole.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.layout import EVADED, MISSED
from crowdsim.crowd.record import TakeData
from crowdsim.errors import TakeError
from crowdsim.motion import ground
from crowdsim.motion.body import Body
from crowdsim.motion.skeleton import Skeleton
from crowdsim.places.kernels.records import PART
from crowdsim.policy.rewards import posed_distance
from crowdsim.poses.attachments import check_attachments
from crowdsim.poses.hits import find_landed
from crowdsim.poses.kernels.columns import TRUNK
from crowdsim.poses.kernels.records import Playback, Posed
from crowdsim.poses.known_actions import with_known_actions
from crowdsim.poses.layer import Block, reading_of, times_of
from crowdsim.poses.layers import LAYERS
from crowdsim.poses.motion import PoseMotion, prepare_motion
from crowdsim.poses.poser import Poser
from crowdsim.poses.recent_rows import RecentRows
from crowdsim.poses.together import each
from crowdsim.poses.window import Window
from crowdsim.poses.world import world_joints

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_BLOCK, _AROUND = 8.0, 3.0
"""Length of stretches that are searched for buried fists at once, and how far around what is posed [s]."""
_AT_ONCE = 4096
"""Strikes whose victims are looked at at once, about."""
_NECK, _NEAR = 0.3, 0.05
"""Where necks are between head and pelvis, and how near fists that miss may be to be looked at closely [m]."""

_LONG = 0.9
"""How much nearer a fist may be for each doubling of a limb [m]."""
_READ, _IN_MEMORY = ("action", "action_frame", "x", "z", "heading", "opponent", "targets"), 4_000_000
"""What poses read of a take; one of no more avatar-frames than this is read at once, not stretch by stretch."""


NOTHING: frozenset[str] = frozenset()
_VISIBLE = 0.5
"""How far something has to be moved to be seen [px]; for one figure of 100 it may be more."""


def unseen_layers(scales: Array) -> Iterator[tuple[Array, frozenset[str]]]:
    """Sort avatars that show at so many pixels a metre (N,) by the layers that are left out since they hardly show.

    Each of these moves no point of 99 of 100 avatars by ``_VISIBLE`` there.

    Yields:
        Avatars, ascending, and the names of these layers; with them ``reading_of`` each layer that may read less of
        others, and ``times_of`` each that may be planned at fewer times. Avatars that show at 0 are left out.
    """
    named = [(kind.name, kind.size) for kind in LAYERS]
    named += [(reading_of(kind.name), kind.reading) for kind in LAYERS]
    named += [(times_of(kind.name), kind.sparse) for kind in LAYERS]
    sizes = np.unique([size for _, size in named if size < math.inf])
    levels = (np.asarray(scales)[:, None] * sizes < _VISIBLE).sum(axis=1)
    levels[np.asarray(scales) <= 0.0] = -1
    for level in np.unique(levels[levels >= 0]):
        unseen = sizes[:level]
        yield np.flatnonzero(levels == level), frozenset(name for name, size in named if size in unseen)


@dataclass(frozen=True)
class Poses:
    """Poses of the avatars of one policy over T times; n avatars, J joints.

    Attributes:
        policy: Index of the policy in the take.
        avatars: Numbers of the avatars. Shape (n,).
        skeleton: Their skeleton, unscaled.
        scales: Size of each body. Shape (n,).
        girths: How thick its trunk and limbs are for their length. Shape (n,).
        stretches: How long the bones of its trunk, legs and arms are for its size. Shape (n, 3).
        segments: Which of these hangs on each joint, see ``builds.joint_segments``. Shape (J,).
        root_positions: Position of the root in the world [m]; NaN while absent. Shape (T, n, 3), float32.
        rotations: Local joint rotations, the root's in the world; NaN while absent. Shape (T, n, J, 4), float32.
        ground: Ground transform. Shape (T, n, 3), float64.
    """

    policy: int
    avatars: Array
    skeleton: Skeleton
    scales: Array
    girths: Array
    stretches: Array
    segments: Array
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
        """Return positions (T, n, J, 3) [m] and rotations (T, n, J, 4) of all joints in the world."""
        poses = Posed(self.root_positions, self.rotations)
        return world_joints(self.skeleton, self.segments, self.scales, self.stretches, poses)


class PoseSampler:
    """Poses a take, any range of frames at any rate.

    Args:
        take: The take.
        policies: Its policies, in the order of ``take.cast.policy_names``.
        threads: Threads that share the work; the result does not depend on them.
        reactions: Whether landed strikes move those whom they hit; as the take says when None.
        obstacles: What stands around the avatars, whose doors open by seconds; it moves no pose, and outputs show it.
            Shape (n,), ``PART``.

    Raises:
        TakeError: The policies are not those that the take was recorded with, or it holds actions or carries
            something at joints that they do not have.
    """

    def __init__(
        self,
        take: TakeData,
        policies: Sequence[Policy],
        threads: int = 1,
        reactions: bool | None = None,
        obstacles: Array | None = None,
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
            if policy.database.control_rate != take.control_rate:
                raise TakeError(
                    f"policy {name!r} has a control rate of {policy.database.control_rate:g}, expected that of the "
                    f"take, {take.control_rate:g}"
                )
        take = with_known_actions(take, policies)
        check_attachments(take, policies)
        if take.frame_count * take.avatar_count <= _IN_MEMORY:
            arrays: dict[str, Any] = {name: np.asarray(getattr(take, name)[:]) for name in _READ}
        else:
            arrays = {name: RecentRows(getattr(take, name)) for name in _READ}
        take = replace(take, **arrays)
        self.take = take
        self.policies, self.obstacles = tuple(policies), np.zeros(0, PART) if obstacles is None else obstacles
        self.motions = [prepare_motion(policy) for policy in policies]
        events = take.events
        self._missed = np.flatnonzero(np.isin(events.outcome, (MISSED, EVADED)) & (np.asarray(events.victim) >= 0))
        self._missed_times = np.asarray(events.frame, dtype=np.float64)[self._missed] / take.control_rate
        self._buried = np.zeros(len(events.frame), bool)
        self._searched: set[int] = set()
        self._lock = threading.RLock()
        self._threads, self._reactions = threads, take.reactions if reactions is None else reactions
        self._posers = {NOTHING: Poser(take, self.motions, self._threads, self._reactions)}

    def sample(
        self, start: int, stop: int, fps: float, avatars: ArrayLike | None = None, without: frozenset[str] = NOTHING
    ) -> list[Poses]:
        """Return the poses of output frames ``start`` to ``stop`` at ``fps``, one item a policy that has avatars.

        Args:
            start: First output frame.
            stop: One past the last.
            fps: Output frames a second.
            avatars: Numbers or names of the avatars, in the order of their numbers; all when None.
            without: Names of layers that are left out, see ``unseen_layers``.
        """
        numbers = np.unique(self.take.cast.numbers(avatars))
        times = np.arange(start, stop) / fps
        self.expect(times)
        with self._lock:
            if without not in self._posers:
                made = Poser(self.take, self.motions, self._threads, self._reactions, without, self.poser)
                self._posers[without] = made
        return self._gathered(numbers, times, self._posers[without].sample(numbers, times))

    def captured(self, start: int, stop: int, fps: float, avatars: ArrayLike | None = None) -> list[Poses]:
        """Return what the capture has there, without blends or anything else; arguments as of ``sample``.

        It is what poses are held against: at transitions it jumps.
        """
        numbers = np.unique(self.take.cast.numbers(avatars))
        times = np.arange(start, stop) / fps
        return self._gathered(numbers, times, self.poser.captured(numbers, times))

    @property
    def poser(self) -> Poser:
        """What poses avatars with all layers."""
        return self._posers[NOTHING]

    def _gathered(self, numbers: Array, times: Array, blocks: Iterable[Block]) -> list[Poses]:
        """Return poses of avatars (n,) at times (T,), policy by policy, with what there is to know of their bodies."""
        cast, owners = self.take.cast, self.take.cast.policies[numbers]
        result = {}
        for index in np.unique(owners):
            avatars, motion = numbers[owners == index], self.motions[index]
            shape = len(times), len(avatars)
            result[int(index)] = Poses(
                int(index),
                avatars,
                motion.skeleton,
                cast.scales[avatars],
                cast.girths[avatars],
                cast.stretches[avatars],
                motion.segments,
                np.empty((*shape, 3), np.float32),
                np.empty((*shape, motion.skeleton.joint_count, 4), np.float32),
                np.empty((*shape, 3)),
            )
        for block in blocks:
            whole = result[block.part.policy]
            columns = np.searchsorted(whole.avatars, numbers[block.which])
            whole.root_positions[:, columns], whole.rotations[:, columns] = block.poses
            whole.ground[:, columns] = block.part.playback.ground
        return list(result.values())

    def present(self, avatar: int, start: int, stop: int, fps: float) -> Array:
        """Return in which of the output frames ``start`` to ``stop`` an avatar is there. Shape (T,), bool."""
        control = self.control_frames(np.arange(start, stop), fps)
        action = np.asarray(self.take.action[int(control[0]) : int(control[-1]) + 1, avatar])
        return np.asarray(action[control - control[0]] >= 0)

    def control_frames(self, frames: Array, fps: float) -> Array:
        """Return the control frame that each output frame (T,) is in. Shape (T,), int64."""
        control = np.floor(frames / fps * self.take.control_rate + 1e-9).astype(np.int64)
        return np.clip(control, 0, self.take.frame_count - 1)

    def expect(self, times: Array) -> None:
        """Find strikes around times [s] that miss avatars because they are too deep in them.

        Poses at these times do so too; this is for many stretches at once.
        """
        ends = np.concatenate([times - _AROUND, times + _AROUND]) // _BLOCK
        blocks = set(np.unique(np.maximum(ends, 0.0)).astype(int).tolist())
        with self._lock:
            fresh = sorted(blocks - self._searched)
            self._searched.update(fresh)
            if any([self._mark_buried(block * _BLOCK, (block + 1) * _BLOCK) for block in fresh]):
                landed = find_landed(self.take, self._buried)
                for poser in self._posers.values():
                    poser.landed = landed

    def _mark_buried(self, first: float, last: float) -> bool:
        """Mark those of a range of times, nearly, since some others may be among them; whether there are any."""
        events, times = self.take.events, self._missed_times
        within = (times >= first) & (times < last)
        some, times = self._missed[within], times[within]
        points = np.asarray(events.point).reshape(-1, 3)[some].astype(np.float64)
        victims = np.asarray(events.victim)[some].astype(np.int64)
        cast, attackers = self.take.cast, np.asarray(events.attacker)[some].astype(np.int64)

        def mark(chosen: Array) -> None:
            for which, motion, sizes, playback in self._placed(chosen, victims, times):
                frames, scales = np.maximum(playback.frames[0], 0), sizes[:, TRUNK]
                heads, pelvises = (
                    ground.to_world(playback.ground[0], local[frames].astype(float) * scales[:, None])
                    for local in (motion.trunks[:, 0], motion.frames.roots)
                )
                body, necks = motion.body, heads + _NECK * (pelvises - heads)
                radii = body.head_radius * scales, body.torso_radius * self.take.cast.widths[victims[which]]
                gaps = posed_distance(points[which], heads, necks, pelvises, *radii)
                # The record knows nothing of legs and arms.
                unlike = np.abs(cast.stretches[[victims[which], attackers[which]]] - 1.0).sum(axis=(0, 2))
                self._buried[some[which]] = gaps < (_NEAR + _LONG * unlike) * scales

        # Of many avatars few are needed at any time.
        each(mark, np.array_split(np.argsort(times), len(some) // _AT_ONCE + 1), self._threads)
        return bool(self._buried[some].any())

    def window(self, index: int, avatars: Array, times: Array) -> Window:
        """Return the stretch of the take that poses of a policy's avatars (n,), ascending, at times [s] depend on."""
        return self.poser.window(index, avatars, times)

    def _placed(self, some: Array, avatars: Array, times: Array) -> Iterator[tuple[Array, PoseMotion, Array, Playback]]:
        """Return where some of avatars (E,) are at times (E,): which, their motion, sizes of bones and playback."""
        for which, policy, numbers, moments in self.poser.moments(avatars[some], times[some]):
            window = self.poser.window(policy, numbers, moments.times, 0.0)
            yield some[which], window.motion, window.rows.sizes[moments.columns], window.playback(moments)

    def moments(self, avatars: Array, times: Array) -> list[tuple[Array, Body, Array, Array, Array]]:
        """Pose avatars (E,) at times (E,), each at its own.

        Returns:
            For each policy which of them are its own (n,), its body, their sizes (n,), positions (n, J, 3) [m] and
            rotations (n, J, 4) of joints in the world.
        """
        self.expect(times)
        return self.poser.shown(avatars, times)
