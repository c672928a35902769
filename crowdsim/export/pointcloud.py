"""Labelled point clouds of a take, one file per frame."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.export.cloud_files import Cloud, probe_open3d, write_cloud
from crowdsim.export.cloud_kernels import MOTION_COLUMNS, Bodies, Riders, Wanted, When, place_points
from crowdsim.export.stream import Block, run_all, stream_poses
from crowdsim.export.surface import Surface, build_surface
from crowdsim.files import make_folder
from crowdsim.poses.sampler import Poses, PoseSampler


class CloudSink:
    """Writes ``000000.ply`` and on: a cloud of every n-th output frame, numbered by output frame; a ``Sink``.

    Velocities are central differences over the output frames on both sides, one-sided where the take or the avatar's
    stay begins or ends.

    Args:
        sampler: Poses of the take.
        folder: Folder for the files, which is there when the first is written.
        kind: ``ply`` or ``pcd``, both binary.
        fps: Output frames a second.
        points: Points an avatar.
        frames: First output frame and one past the last; all when None.
        every: Write each n-th.
        avatars: Numbers of the avatars; all when None.

    Raises:
        RunError: Open3D, which writes PCD, cannot be loaded.
    """

    margin, reads_joints = 1, True

    def __init__(
        self,
        sampler: PoseSampler,
        folder: Path,
        kind: str,
        fps: float,
        points: int,
        frames: tuple[int, int] | None = None,
        every: int = 1,
        avatars: Sequence[int] | Array | None = None,
    ) -> None:
        if kind == "pcd":
            probe_open3d()
        take = sampler.take
        self.kind = kind
        self.start, self.stop = frames or (0, take.output_frames(fps))
        self.avatars: Array = np.arange(take.avatar_count) if avatars is None else np.unique(np.asarray(avatars))
        self._sampler, self._folder, self._fps, self._points, self._every = sampler, folder, fps, points, every
        self._chosen = np.zeros(take.avatar_count, bool)
        self._chosen[self.avatars] = True
        self._surfaces: dict[int, Surface] = {}
        self._files: list[Path] = []

    @property
    def total(self) -> int:
        """Number of files."""
        return len(range(self.start, self.stop, self._every))

    @property
    def done(self) -> int:
        """Number of files written so far."""
        return len(self._files)

    def split(self, most: int) -> list[CloudSink]:
        """Return itself: a cloud holds all avatars."""
        return [self]

    def write(self, block: Block, pool: ThreadPoolExecutor) -> None:
        """Write the clouds of a block's frames."""
        low, high = max(block.first_output, self.start), min(block.stop_output, self.stop)
        low += (self.start - low) % self._every
        frames = range(low, high, self._every)
        surfaces = [self._surface(poses.policy) for poses in block.poses]
        joints = block.joints

        def write(frame: int) -> Path:
            path = self._folder / f"{frame:06d}.{self.kind}"
            write_cloud(path, self._build(block.poses, joints, surfaces, frame - block.first))
            return path

        self._files += run_all(pool, write, frames)

    def close(self) -> list[Path]:
        """Return the files."""
        return self._files

    def abandon(self) -> None:
        """Do nothing: every file is whole."""

    def build(self, frame: int) -> Cloud:
        """Return the cloud of an output frame."""
        last = self._sampler.take.output_frames(self._fps)
        low, high = max(frame - 1, 0), min(frame + 2, last)
        block = Block(low, frame, frame + 1, self._sampler.sample(low, high, self._fps, self.avatars))
        surfaces = [self._surface(poses.policy) for poses in block.poses]
        return self._build(block.poses, block.joints, surfaces, frame - low)

    def _surface(self, policy: int) -> Surface:
        if policy not in self._surfaces:
            database = self._sampler.policies[policy].database
            self._surfaces[policy] = build_surface(database.skeleton, database.body, self._points)
        return self._surfaces[policy]

    def _build(
        self, blocks: Sequence[Poses], all_joints: Sequence[tuple[Array, Array]], surfaces: Sequence[Surface], row: int
    ) -> Cloud:
        here = [
            np.flatnonzero(np.isfinite(joints[row, :, 0, 0]) & self._chosen[poses.avatars])
            for poses, (joints, _) in zip(blocks, all_joints, strict=True)
        ]
        cloud = Cloud.empty(self._points * sum(map(len, here)))
        teams, first = self._sampler.take.cast.teams, 0
        for poses, (joints, rotations), surface, columns in zip(blocks, all_joints, surfaces, here, strict=True):
            build = poses.scales, poses.girths, poses.stretches
            bodies = Bodies(joints, rotations, *(values.astype(np.float32) for values in build))
            when = When(max(row - 1, 0), row, min(row + 1, len(joints) - 1), 1.0 / self._fps)
            numbers = poses.avatars[columns]
            wanted = Wanted(columns, numbers.astype(np.int32), teams[numbers].astype(np.int32))
            riders = Riders(*(getattr(surface, name) for name in Riders._fields))
            motions = np.empty((joints.shape[2], MOTION_COLUMNS))
            stop = first + self._points * len(columns)
            place_points(bodies, when, wanted, riders, motions, cloud.values[first:stop], cloud.labels[first:stop])
            first = stop
        return cloud


def export_clouds(
    sampler: PoseSampler,
    folder: Path,
    kind: str,
    fps: float,
    points: int,
    frames: tuple[int, int] | None = None,
    every: int = 1,
    avatars: Sequence[int] | Array | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> list[Path]:
    """Write point clouds of a take; see ``CloudSink``.

    Returns:
        The files, in the order of frames.

    Raises:
        OutputError: The folder cannot be made, or a file cannot be written.
        RunError: Open3D, which writes PCD, cannot be loaded.
    """
    make_folder(folder)
    sink = CloudSink(sampler, folder, kind, fps, points, frames, every, avatars)
    return stream_poses(sampler, fps, [sink], threads, progress)[0]
