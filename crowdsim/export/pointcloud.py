"""Labelled point clouds of a take, one file a frame, through Open3D's tensor API."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.errors import OutputError, RunError
from crowdsim.export.cloud_kernels import place_points
from crowdsim.export.surface import Surface, build_surface
from crowdsim.take.poses import Poses, PoseSampler

Array = NDArray[Any]
Progress = Callable[[str, int, int], None]

FIELDS = ("x", "y", "z", "nx", "ny", "nz", "vx", "vy", "vz", "avatar", "team", "joint")
"""What every point has: place [m], normal, velocity [m/s], float32; avatar, team and joint numbers, int32."""
_POSES_AT_ONCE = 20_000
_SYSTEM_PACKAGES = "libgl1 libegl1 libgomp1 libusb-1.0-0 libx11-6"


@cache
def probe_open3d() -> None:
    """Try Open3D in a process of its own, since without its system libraries it can take the process down.

    Raises:
        RunError: It cannot be imported; the message says what is missing.
    """
    done = subprocess.run([sys.executable, "-c", "import open3d"], capture_output=True, text=True, check=False)
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        why = lines[-1] if lines else f"it ended with {done.returncode}"
        raise RunError(f"point clouds need Open3D, which cannot be loaded: {why}; on Debian: {_SYSTEM_PACKAGES}")


class CloudBuilder:
    """Builds clouds of a take's frames.

    Args:
        sampler: Poses of the take.
        fps: Output frames a second.
        points: Points an avatar.
        avatars: Numbers of the avatars; all when None.
    """

    def __init__(self, sampler: PoseSampler, fps: float, points: int, avatars: Sequence[int] | None = None) -> None:
        take = sampler.take
        self.sampler, self.fps, self.points = sampler, fps, points
        self.avatars = np.arange(take.avatar_count) if avatars is None else np.unique(np.asarray(avatars))
        self.last = take.output_frames(fps) - 1
        self._surfaces: dict[int, Surface] = {}

    def _surface(self, policy: int) -> Surface:
        if policy not in self._surfaces:
            database = self.sampler.policies[policy].database
            self._surfaces[policy] = build_surface(database.skeleton, database.body, self.points)
        return self._surfaces[policy]

    def build(self, start: int, stop: int, every: int = 1) -> list[dict[str, Array]]:
        """Return the clouds of output frames ``start``, ``start + every`` ... before ``stop``.

        Velocities are central differences over the output frames on both sides, one-sided at the ends of the take.

        Returns:
            For each frame, columns ``places`` (n, 3), ``normals`` (n, 3), ``velocities`` (n, 3) and ``avatar``,
            ``team``, ``joint`` (n,).
        """
        low, high = max(start - 1, 0), min(stop, self.last) + 1
        blocks = []
        for poses in self.sampler.sample(low, high, self.fps, self.avatars):
            blocks.append((poses, *poses.joints()))
        return [self._cloud(blocks, frame, low, high - 1) for frame in range(start, stop, every)]

    def _cloud(self, blocks: list[tuple[Poses, Array, Array]], frame: int, low: int, high: int) -> dict[str, Array]:
        before, after = max(frame - 1, low), min(frame + 1, high)
        parts: list[dict[str, Array]] = []
        for poses, positions, rotations in blocks:
            surface = self._surface(poses.policy)
            there = np.isfinite(positions[[before - low, frame - low, after - low], :, 0, 0]).all(axis=0)
            scales = poses.scales[there].astype(np.float32)
            count = len(scales) * len(surface.joints)
            places, normals = (np.empty((count, 3), np.float32) for _ in range(2))
            earlier, later = (np.empty((count, 3), np.float32) for _ in range(2))
            none = np.empty((0, 3), np.float32)
            for at, out, out_normals in ((frame, places, normals), (before, earlier, none), (after, later, none)):
                joints, turns = positions[at - low, there], rotations[at - low, there]
                place_points(
                    joints, turns, scales, surface.joints, surface.places, surface.normals, 0, out, out_normals
                )
            numbers = poses.avatars[there]
            seconds = (after - before) / self.fps
            parts.append(
                {
                    "places": places,
                    "normals": normals,
                    "velocities": (later - earlier) / np.float32(seconds) if seconds else np.zeros_like(places),
                    "avatar": np.repeat(numbers.astype(np.int32), len(surface.joints)),
                    "team": np.repeat(self.sampler.take.cast.teams[numbers].astype(np.int32), len(surface.joints)),
                    "joint": np.tile(surface.joints, len(numbers)),
                }
            )
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def export_clouds(
    builder: CloudBuilder,
    folder: Path,
    kind: str,
    frames: tuple[int, int] | None = None,
    every: int = 1,
    threads: int = 1,
    progress: Progress | None = None,
) -> list[Path]:
    """Write ``000000.ply`` and on: one file for every ``every``-th output frame, numbered by output frame.

    Args:
        builder: Builds the clouds.
        folder: Folder for the files; made when missing.
        kind: ``ply`` or ``pcd``, both binary.
        frames: First output frame and one past the last; all when None.
        every: Write each n-th.
        threads: Threads that write.
        progress: Called with (kind, files done, files).

    Raises:
        OutputError: A file cannot be written.
        RunError: Open3D cannot be loaded.
    """
    probe_open3d()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror or error}") from None
    start, stop = frames or (0, builder.last + 1)
    numbers = range(start, stop, every)
    at_once = max(1, _POSES_AT_ONCE // max(1, len(builder.avatars)) // every)
    written: list[Path] = []
    with ThreadPoolExecutor(max(1, threads)) as pool:
        for low in range(0, len(numbers), at_once):
            chosen = numbers[low : low + at_once]
            clouds = builder.build(chosen[0], chosen[-1] + 1, every)
            paths = [folder / f"{number:06d}.{kind}" for number in chosen]
            list(pool.map(_write, paths, clouds))
            written.extend(paths)
            if progress is not None:
                progress(kind, len(written), len(numbers))
    return written


def _write(path: Path, cloud: dict[str, Array]) -> None:
    """Write one cloud under a temporary name and rename it."""
    import open3d

    o3d: Any = open3d
    tensor = o3d.core.Tensor
    points = o3d.t.geometry.PointCloud()
    points.point.positions = tensor(cloud["places"])
    if path.suffix == ".ply":
        points.point.normals = tensor(cloud["normals"])
    else:
        # Open3D calls normals otherwise in PCD files, and leaves out other attributes of three columns.
        for column, name in enumerate(("nx", "ny", "nz")):
            points.point[name] = tensor(np.ascontiguousarray(cloud["normals"][:, column : column + 1]))
    for column, name in enumerate(("vx", "vy", "vz")):
        points.point[name] = tensor(np.ascontiguousarray(cloud["velocities"][:, column : column + 1]))
    for name in ("avatar", "team", "joint"):
        points.point[name] = tensor(cloud[name][:, None])
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    done = o3d.t.io.write_point_cloud(str(partial), points)
    try:
        if not done:
            raise OSError("the disk may be full")
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
