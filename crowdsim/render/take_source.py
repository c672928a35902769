"""A take as what pictures are made of."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.render.scene import Figure
from crowdsim.take.poses import Poses, PoseSampler

Array = NDArray[Any]

_SHOWN = 0.4
"""How long a landed strike flashes [s]."""
_POSES_AT_ONCE = 12_000
_NOWHERE = -1000.0
"""Height at which absent avatars are kept out of the picture [m]."""


class TakeSource:
    """Avatars of a take at the rate of the pictures; see ``PoseSource``.

    Args:
        sampler: Poses of the take.
        fps: Pictures a second.
    """

    def __init__(self, sampler: PoseSampler, fps: float) -> None:
        take = sampler.take
        self._sampler, self._fps = sampler, float(fps)
        self._count = take.output_frames(fps)
        self._block: tuple[int, int, list[Poses]] = (0, 0, [])
        self._at_once = max(1, _POSES_AT_ONCE // max(1, take.avatar_count))
        landed = np.asarray(take.events.landed, dtype=bool)
        self._hit_times = np.asarray(take.events.frame, dtype=np.float64)[landed] / take.control_rate
        self._hit_points = np.asarray(take.events.point, dtype=np.float64)[landed].reshape(-1, 3)
        self._hit_speeds = np.asarray(take.events.speed, dtype=np.float64)[landed]
        order = np.argsort(self._hit_times, kind="stable")
        self._hit_times, self._hit_points = self._hit_times[order], self._hit_points[order]
        self._hit_speeds = self._hit_speeds[order]

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self._sampler.take.scenario

    @property
    def fingerprint(self) -> str:
        """A text that differs whenever the take does."""
        take = self._sampler.take
        digest = hashlib.sha256()
        for part in (take.scenario, take.seed, take.status, take.fingerprints, take.cast.type_names, self._fps):
            digest.update(repr(part).encode())
        for array in (take.x, take.z, take.heading, take.action, take.action_frame):
            digest.update(np.ascontiguousarray(array[:]).tobytes())
        for values in (take.cast.policies, take.cast.scales, take.cast.teams, take.events.frame, take.events.landed):
            digest.update(np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()

    @property
    def fps(self) -> float:
        """Frames a second."""
        return self._fps

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return self._count

    @property
    def avatar_names(self) -> Sequence[str]:
        """Name of each avatar."""
        return [str(name) for name in self._sampler.take.cast.names]

    @property
    def avatar_teams(self) -> Array:
        """Number of each avatar's team."""
        return np.asarray(self._sampler.take.cast.teams, dtype=np.int64)

    @property
    def avatar_scales(self) -> Array:
        """Size of each avatar."""
        return np.asarray(self._sampler.take.cast.scales, dtype=np.float64)

    @property
    def avatar_heights(self) -> Array:
        """How high each avatar reaches when it stands [m]."""
        heights = np.array([policy.database.body.height for policy in self._sampler.policies])
        return heights[self.avatar_figures] * self.avatar_scales

    @property
    def figures(self) -> Sequence[Figure]:
        """Body of each policy."""
        return [policy.database.body for policy in self._sampler.policies]

    @property
    def avatar_figures(self) -> Array:
        """Policy of each avatar."""
        return np.asarray(self._sampler.take.cast.policies, dtype=np.int64)

    def ground(self, frames: Array) -> Array:
        """Return the ground transforms of all avatars at some frames; absent ones stand where they were or will be."""
        take = self._sampler.take
        clock = np.asarray(frames) / self._fps * take.control_rate
        before = np.clip(np.floor(clock + 1e-9).astype(np.int64), 0, take.frame_count - 1)
        after = np.minimum(before + 1, take.frame_count - 1)
        part = np.clip(clock - before, 0.0, 1.0)[:, None]
        first, stop = int(before.min()), int(after.max()) + 1
        told = [np.asarray(values[first:stop], dtype=np.float64) for values in (take.x, take.z, take.heading)]
        told[2] = np.unwrap(np.nan_to_num(told[2]), axis=0)
        placed = []
        for values in told:
            low, high = values[before - first], values[after - first]
            mixed = low + np.where(np.isfinite(high), (high - low) * part, 0.0)
            if not np.isfinite(mixed).all():
                there = np.isfinite(mixed)
                fallback = np.nanmean(np.where(there, mixed, np.nan)) if there.any() else 0.0
                mixed = np.where(there, mixed, fallback)
            placed.append(mixed)
        return np.stack(placed, axis=-1)

    def poses(self, frame: int) -> list[tuple[Array, Array]]:
        """Return the posed avatars of each policy at a frame."""
        first, stop, blocks = self._block
        if not first <= frame < stop:
            first = frame // self._at_once * self._at_once
            stop = min(first + self._at_once, self._count)
            blocks = self._sampler.sample(first, stop, self._fps)
            self._block = (first, stop, blocks)
        by_policy = {poses.policy: poses for poses in blocks}
        told = []
        for index, policy in enumerate(self._sampler.policies):
            if index not in by_policy:
                joints = policy.database.skeleton.joint_count
                told.append((np.zeros((0, joints, 3), np.float32), np.zeros((0, joints, 4), np.float32)))
                continue
            positions, rotations = by_policy[index].at(frame - first).joints()
            absent = ~np.isfinite(positions[0, :, 0, 0])
            if absent.any():
                positions[0, absent] = (0.0, _NOWHERE, 0.0)
                rotations[0, absent] = (1.0, 0.0, 0.0, 0.0)
            told.append((positions[0], rotations[0]))
        return told

    def hits(self, frame: int) -> tuple[Array, Array, Array]:
        """Return the strikes that landed a short time before a frame."""
        now = frame / self._fps
        low = int(np.searchsorted(self._hit_times, now - _SHOWN, side="right"))
        high = int(np.searchsorted(self._hit_times, now, side="right"))
        return self._hit_points[low:high], now - self._hit_times[low:high], self._hit_speeds[low:high]
