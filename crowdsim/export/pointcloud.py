"""Labelled point clouds of a take, one file a frame, through Open3D's tensor API."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.errors import OutputError, RunError
from crowdsim.export.cloud_kernels import Bodies, Points, Riders, When, place_points
from crowdsim.export.stream import Block, run_all, stream_poses
from crowdsim.export.surface import Surface, build_surface
from crowdsim.files import make_folder
from crowdsim.take.poses import Poses, PoseSampler

FIELDS = ("x", "y", "z", "nx", "ny", "nz", "vx", "vy", "vz", "avatar", "team", "joint")
"""What every point has: position [m], normal, velocity [m/s], float32; avatar, team and joint numbers, int32."""
_SYSTEM_PACKAGES = "libgl1 libegl1 libgomp1 libusb-1.0-0 libx11-6"


@cache
def begin_probe() -> subprocess.Popen[str]:
    """Begin to try Open3D in a process of its own, since without its system libraries it can take the process down."""
    return subprocess.Popen(
        [sys.executable, "-c", "import open3d"],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@cache
def probe_open3d() -> None:
    """Wait until Open3D has been tried, see ``begin_probe``.

    Raises:
        RunError: It cannot be imported; the message says what is missing.
    """
    probe = begin_probe()
    _, complaint = probe.communicate()
    if probe.returncode:
        lines = complaint.strip().splitlines()
        why = lines[-1] if lines else f"it ended with {probe.returncode}"
        raise RunError(f"point clouds need Open3D, which cannot be loaded: {why}; on Debian: {_SYSTEM_PACKAGES}")


@dataclass(frozen=True)
class Cloud:
    """Points of a frame; n of them.

    Attributes:
        positions: Where they are [m]. Shape (n, 3), float32.
        normals: Outward normals. Shape (n, 3), float32.
        velocities: How they move [m/s]. Shape (3, n), float32.
        avatar: Avatar that each is on. Shape (n,), int32.
        team: Its team. Shape (n,), int32.
        joint: Joint that it rides on, a number of its skeleton. Shape (n,), int32.
    """

    positions: Array
    normals: Array
    velocities: Array
    avatar: Array
    team: Array
    joint: Array


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
        RunError: Open3D cannot be loaded.
    """

    margin = 1

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
        numbers = [poses.avatars[columns].astype(np.int32) for poses, columns in zip(blocks, here, strict=True)]
        count = self._points * sum(map(len, numbers))
        positions, normals = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
        velocities = np.empty((3, count), np.float32)
        first = 0
        for poses, (joints, rotations), surface, columns in zip(blocks, all_joints, surfaces, here, strict=True):
            bodies = Bodies(joints, rotations, poses.scales.astype(np.float32))
            when = When(max(row - 1, 0), row, min(row + 1, len(joints) - 1), 1.0 / self._fps)
            riders = Riders(surface.joints, surface.positions, surface.normals)
            first = place_points(bodies, when, columns, riders, first, Points(positions, normals, velocities))
        avatar = np.repeat(np.concatenate(numbers), self._points)
        own_joints = [np.tile(surface.joints, len(own)) for surface, own in zip(surfaces, numbers, strict=True)]
        teams = self._sampler.take.cast.teams.astype(np.int32)
        return Cloud(positions, normals, velocities, avatar, teams[avatar], np.concatenate(own_joints))


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
        RunError: Open3D cannot be loaded.
    """
    make_folder(folder)
    sink = CloudSink(sampler, folder, kind, fps, points, frames, every, avatars)
    return stream_poses(sampler, fps, [sink], threads, progress)[0]


def write_cloud(path: Path, cloud: Cloud) -> None:
    """Write a cloud as binary PLY or PCD, by its name's end, under a temporary name that is then renamed.

    Raises:
        OutputError: It cannot be written.
    """
    import open3d

    o3d: Any = open3d
    shared = o3d.core.Tensor.from_numpy
    points = o3d.t.geometry.PointCloud()
    points.point.positions = shared(cloud.positions)
    if path.suffix == ".ply":
        points.point.normals = shared(cloud.normals)
    else:
        # Open3D calls normals otherwise in PCD files, and leaves out other attributes of three columns.
        for column, name in enumerate(("nx", "ny", "nz")):
            points.point[name] = shared(np.ascontiguousarray(cloud.normals[:, column : column + 1]))
    for row, name in enumerate(("vx", "vy", "vz")):
        points.point[name] = shared(cloud.velocities[row][:, None])
    for name in ("avatar", "team", "joint"):
        points.point[name] = shared(getattr(cloud, name)[:, None])
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        done = o3d.t.io.write_point_cloud(str(partial), points)
        # Open3D calls some files written that a full disk has cut off.
        if not (done and _is_whole(partial, len(cloud.positions))):
            raise OSError("the disk may be full, or the folder cannot be written")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None


def _is_whole(path: Path, points: int) -> bool:
    """Whether a binary cloud holds as many bytes as its points need after the header."""
    with open(path, "rb") as file:
        head = file.read(4096)
    for end in (b"end_header\n", b"DATA binary\n"):
        if end in head:
            return path.stat().st_size == head.index(end) + len(end) + 4 * len(FIELDS) * points
    return False
