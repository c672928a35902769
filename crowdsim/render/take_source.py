"""A recorded run as a source of pictures."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from crowdsim.body.looks import build_of
from crowdsim.body.skin import Skin, build_skin_of
from crowdsim.core.types import Array
from crowdsim.policy.policy import Policy
from crowdsim.poses.attachments import place_attachments
from crowdsim.poses.sampler import Poses, PoseSampler, unseen_layers
from crowdsim.render.figure import Figure
from crowdsim.render.raycast import Capsules
from crowdsim.render.source import Shown
from crowdsim.scenario.camera import Camera
from crowdsim.take.take import Take

THUMBNAIL_FRAMES = 32
"""Frames of a take that are opened for small pictures of it: a camera follows the crowd through all of them."""
_BLOCK_BYTES = 96 << 20
_MOST_FRAMES = 32
_HELD, _GLOSS = -1_000_000, 0.15
"""Number of the figure of what avatar 0 carries, and its gloss."""
_FLASH_REACH = 0.4
"""How far back ``recent_strikes`` looks [s]."""


class _Block(NamedTuple):
    """Poses of frames ``start`` to ``stop``: first frame, poses, and which avatars are seen so at each (T, n)."""

    start: int
    stop: int
    scales: Callable[[int], Array] | None
    poses: list[tuple[int, Poses, Array]]


class TakeSource:
    """Motion of a take at a frame rate; a ``PoseSource``.

    Frames that are drawn one after another are posed together, since they need the same of the take around them.

    Args:
        take: The take.
        policies: Its policies, in the order of ``take.cast.policy_names``.
        fps: Frames a second.
        name: What it is called in captions; the scenario's name by default.
        threads: Threads that share the sampling of a block.
        arena: The arena of the scenario, see ``PoseSource.arena``, which takes do not know; open ground by default.
        cameras: Cameras of the scenario by name.
        obstacles: Parts of the scenario's obstacles, whose doors open by seconds (``places.arrays.pack_parts``); none
            by default. Shape (n,), ``PART``.
        sampler: Poses the take; made when None.

    Raises:
        TakeError: The policies are not those that the take was recorded with.
    """

    def __init__(
        self,
        take: Take,
        policies: Sequence[Policy],
        fps: float,
        name: str | None = None,
        threads: int = 1,
        arena: Array | None = None,
        cameras: Mapping[str, Camera] | None = None,
        obstacles: Array | None = None,
        sampler: PoseSampler | None = None,
    ) -> None:
        self.take, self.fps, self.name = take, float(fps), name or take.scenario
        self._arguments: tuple[Any, ...] = (take, tuple(policies), fps, name, threads, arena, cameras, obstacles)
        self.obstacles = obstacles
        self.cameras = cameras or {}
        self.arena = np.zeros(5) if arena is None else np.asarray(arena, float)
        self._sampler = sampler or PoseSampler(take, policies, threads)
        self.frame_count = take.output_frames(fps)
        cast = take.cast
        self.avatar_names = tuple(str(value) for value in cast.names)
        self.avatar_teams = np.asarray(cast.teams, int)
        self.avatar_kinds, self.avatar_bare = np.asarray(cast.types, int), cast.bare
        self.avatar_scales = np.asarray(cast.scales, float)
        self.avatar_girths = np.asarray(cast.girths, float)
        self.avatar_stretches = cast.stretches
        # Samples come for the policies that have avatars, in their order.
        present = [index for index in range(len(policies)) if (cast.policies == index).any()]
        self.figures: tuple[Figure, ...] = tuple(policies[index].database.body for index in present)
        self.avatar_figures = np.searchsorted(present, cast.policies).astype(np.int32)
        heights, legs = np.array([_heights(policy) for policy in policies]).T
        longer = legs[cast.policies] * (cast.legs.astype(float) - 1.0)
        self.avatar_heights = (heights[cast.policies] + longer) * self.avatar_scales
        self.avatar_colours = np.asarray(cast.colours, float)[cast.types]
        self.fingerprint = _digest(take)
        joints = max(policy.database.skeleton.joint_count for policy in policies)
        self._block = int(np.clip(_BLOCK_BYTES // (take.avatar_count * joints * 16), 1, _MOST_FRAMES))
        self._blocks: list[_Block] = []
        # As many as pictures are drawn at once, and one before.
        self._kept = max(threads, 1)
        self._joints = [policies[index].database.skeleton.joint_count for index in present]
        self._counts = np.bincount(self.avatar_figures, minlength=len(present))
        self._columns = np.zeros(take.avatar_count, np.int64)
        for figure in range(len(present)):
            self._columns[self.avatar_figures == figure] = np.arange(self._counts[figure])
        self._lock = threading.Lock()
        aimed = np.flatnonzero(np.asarray(take.events.victim) != -1)
        aimed = aimed[np.argsort(np.asarray(take.events.frame, float)[aimed], kind="stable")]
        self._strike_times = np.asarray(take.events.frame, float)[aimed] / take.control_rate
        events = take.events
        self._strikes = tuple(np.asarray(part)[aimed] for part in (events.point, events.speed, events.outcome))

    def __reduce__(self) -> tuple[Any, ...]:
        """Build again from the arguments on the other side."""
        return TakeSource, self._arguments

    def at_rate(self, fps: float) -> TakeSource:
        """Return the same take at another frame rate."""
        take, policies, _, name, threads, arena, cameras, obstacles = self._arguments
        return TakeSource(take, policies, fps, name, threads, arena, cameras, obstacles)

    def seconds(self, frame: int) -> float:
        """Return the time of a frame in the take [s]."""
        return frame / self.fps

    def ground(self, frames: Array) -> Array:
        """Return the ground transforms of all avatars at some frames; NaN while absent. Shape (n, N, 3)."""
        # The sampler keeps the rows that it has read last; all moments of a take are read once.
        take = self._sampler.take if len(frames) == 1 else self.take
        control = np.clip(np.asarray(frames) / self.fps * take.control_rate, 0, take.frame_count - 1)
        before = np.floor(control + 1e-9).astype(np.int64)
        part = np.clip(control - before, 0.0, 1.0)[:, None, None]
        after = np.minimum(before + (part[:, 0, 0] > 0.0), take.frame_count - 1)
        needed, where = np.unique([before, after], return_inverse=True)
        first, stop = int(needed[0]), int(needed[-1]) + 1
        x, z, heading, action = (
            np.asarray(array[first:stop])[needed - first] for array in (take.x, take.z, take.heading, take.action)
        )
        rows = np.stack([x, z, heading], axis=-1, dtype=float)
        rows[action < 0] = np.nan
        low, high = rows[where.reshape(2, -1)]
        high = np.where(np.isfinite(high), high, low)
        turn = np.mod(high[..., 2] - low[..., 2] + np.pi, 2 * np.pi) - np.pi
        high = np.concatenate([high[..., :2], (low[..., 2] + turn)[..., None]], axis=-1)
        return np.asarray(low + part * (high - low))

    def poses(self, frame: int, shown: Shown | None = None) -> list[tuple[Array, Array]]:
        """Return the poses of each body's avatars at a frame: places (n, J, 3) [m] and rotations (n, J, 4)."""
        scales = shown.scales if shown else None
        with self._lock:
            block = next((one for one in self._blocks if one.start <= frame < one.stop and one.scales == scales), None)
            if block is None:
                stop = min(frame + self._block, self.frame_count, shown.stop if shown else frame + 1)
                block = self._sample(frame, stop, scales)
                self._blocks = [block, *self._blocks[: self._kept]]
        whole = [
            (np.full((count, joints, 3), np.nan, np.float32), np.full((count, joints, 4), np.nan, np.float32))
            for count, joints in zip(self._counts, self._joints, strict=True)
        ]
        for first, poses, there in block.poses:
            row = frame - first
            if 0 <= row < len(there) and there[row].any():
                positions, rotations = poses.at(row).joints()
                some = poses.avatars[there[row]]
                figure = int(self.avatar_figures[some[0]])
                whole[figure][0][self._columns[some]] = positions[0, there[row]]
                whole[figure][1][self._columns[some]] = rotations[0, there[row]]
        return whole

    def _sample(self, start: int, stop: int, scales: Callable[[int], Array] | None) -> _Block:
        """Pose frames ``start`` to ``stop``, each avatar with the layers that are seen of it."""
        levels: dict[frozenset[str], Array] = {}
        for frame in range(start, stop):
            seen = np.full(self.take.avatar_count, np.inf) if scales is None else scales(frame)
            for avatars, without in unseen_layers(seen):
                there = levels.setdefault(without, np.zeros((stop - start, self.take.avatar_count), bool))
                there[frame - start, avatars] = True
        found = []
        for without, there in levels.items():
            rows, some = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
            low, high = int(rows[0]), int(rows[-1]) + 1
            for poses in self._sampler.sample(start + low, start + high, self.fps, some, without):
                found.append((start + low, poses, there[low:high, poses.avatars]))
        return _Block(start, stop, scales, found)

    def held(self, poses: list[tuple[Array, Array]]) -> Capsules:
        """Return the capsules of what avatars carry, for the poses of a frame; a figure each."""
        cast = self.take.cast
        if not len(cast.held):
            return Capsules(np.empty((0, 8), np.float32), np.empty((0, 4), np.float32), np.empty(0, np.int32))
        found = [
            place_attachments(cast, np.flatnonzero(self.avatar_figures == figure), *joints)
            for figure, joints in enumerate(poses)
        ]
        avatars, starts, ends, radii, colours = (np.concatenate(part) for part in zip(*found, strict=True))
        shapes = np.concatenate([starts, ends, radii[:, None], radii[:, None]], axis=1)
        paints = np.concatenate([colours.astype(float) ** 2, np.full((len(colours), 1), _GLOSS)], axis=1)
        return Capsules(shapes.astype(np.float32), paints.astype(np.float32), (_HELD - avatars).astype(np.int32))

    def skin(self, avatar: int, coarseness: float) -> Skin:
        """Return the skin of an avatar, by its girth and lengths; edges are so many times as long as usual."""
        cast = self.take.cast
        policy, girth = int(cast.policies[avatar]), float(cast.girths[avatar])
        lengths = cast.stretches[avatar][self._sampler.motions[policy].segments]
        skin = build_skin_of(self._sampler.policies[policy].database, build_of(cast, avatar), coarseness)
        return skin.shaped(girth, lengths)

    def recent_strikes(self, frame: int) -> tuple[Array, Array, Array, Array]:
        """Return points [m], time since [s], speeds [m/s] and outcomes of strikes a moment before a frame."""
        now = frame / self.fps
        first, stop = np.searchsorted(self._strike_times, [now - _FLASH_REACH, now + 1e-6])
        points, speeds, outcomes = (part[first:stop] for part in self._strikes)
        return points.astype(float), now - self._strike_times[first:stop], speeds.astype(float), outcomes

    def markers(self, frame: int) -> Array:
        """Return where the scripted targets are at a frame [m]. Shape (G, 3)."""
        control = min(frame / self.fps * self.take.control_rate, self.take.frame_count - 1)
        before = int(control + 1e-9)
        rows = np.asarray(self.take.targets[before : before + 2], float)
        return np.asarray(rows[0] + max(control - before, 0.0) * (rows[-1] - rows[0]))


def thumbnail_rate(take: Take) -> float:
    """Return the frame rate at which a take has about ``THUMBNAIL_FRAMES``."""
    return min(30.0, THUMBNAIL_FRAMES / max(take.frame_count / take.control_rate, 1.0))


def _heights(policy: Policy) -> tuple[float, float]:
    """How tall the body of a policy is, and how long its leg [m]."""
    skeleton, body = policy.database.skeleton, policy.database.body
    rest, roles = skeleton.rest_positions(), body.roles
    leg = rest[[roles["left_hip"], roles["left_knee"], roles["left_foot"]]]
    return body.height, float(np.linalg.norm(np.diff(leg, axis=0), axis=1).sum())


def _digest(take: Take) -> str:
    """A text that differs between takes: of the settings, of a few frames and of all strikes."""
    named = (take.scenario, take.seed, take.fingerprints, take.control_rate, take.frame_count, take.status)
    digest = hashlib.sha256(repr((*named, take.reactions, take.collision_avoidance, take.cast.bodies)).encode())
    cast, events = take.cast, take.events
    of_cast = (cast.types, cast.teams, cast.policies, cast.scales, cast.girths, cast.speeds, cast.colours)
    for array in (*of_cast, cast.stretches, cast.attachments, cast.faces, events.point, events.outcome):
        digest.update(np.ascontiguousarray(array).tobytes())
    for frame in np.unique(np.linspace(0, take.frame_count - 1, 8).astype(int)):
        for variable in (take.action, take.action_frame, take.x, take.z, take.heading):
            digest.update(np.ascontiguousarray(variable[int(frame)]).tobytes())
    return digest.hexdigest()
