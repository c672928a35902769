"""Labelled point clouds of a take, one file per frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from crowdsim.body.anatomy import Build
from crowdsim.body.looks import build_of
from crowdsim.body.skin import Skin, build_skin_of
from crowdsim.core.types import Array, Progress
from crowdsim.export.cloud_files import Cloud, probe_open3d, write_cloud
from crowdsim.export.cloud_kernels import (
    MOTION_COLUMNS,
    Bodies,
    Frames,
    Riders,
    SkinRiders,
    Wanted,
    When,
    place_points,
    place_skin_points,
)
from crowdsim.export.stream import Block, run_all, stream_poses
from crowdsim.export.surface import (
    Surface,
    build_prop_surface,
    build_skin_surface,
    build_surface,
    prop_areas,
    spread_points,
)
from crowdsim.files import make_folder
from crowdsim.places.mesh import mesh_of, triangle_areas
from crowdsim.poses.sampler import Poses, PoseSampler

_Placer = Callable[[Bodies, When, Wanted, Cloud], None]
_SKIN_AREA, _MOST_SHARE = 1.8, 0.25
"""Area of a body [m2], and share of an avatar's points that lie on what it carries at the most."""


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
        surface: What points lie on: ``capsules``, or the skin of the ``body``.
        obstacles: Points a square metre on the obstacles of ``sampler``, while they stand (``obstacle_points``).

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
        surface: str = "capsules",
        obstacles: float = 0.0,
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
        self._on_skin = surface == "body"
        self._surfaces: dict[int, Surface] = {}
        self._skins: dict[tuple[int, Build], tuple[Skin, SkinRiders]] = {}
        self._frames: dict[int, Frames] = {}
        self._standing = obstacle_points(sampler.obstacles, obstacles)
        self._props: dict[int, Riders | None] = {}
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
        place = self._placers(block.poses)
        joints = block.joints

        def write(frame: int) -> Path:
            path = self._folder / f"{frame:06d}.{self.kind}"
            write_cloud(path, self._build(block.poses, joints, place, frame - block.first, frame))
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
        return self._build(block.poses, block.joints, self._placers(block.poses), frame - low, frame)

    def _placers(self, blocks: Sequence[Poses]) -> list[_Placer]:
        """Return what puts the points of some avatars of each block into the world; all that it needs is built here."""
        if self._on_skin:
            return [self._skin_placer(poses) for poses in blocks]
        return [self._capsule_placer(poses) for poses in blocks]

    def _capsule_placer(self, poses: Poses) -> _Placer:
        if poses.policy not in self._surfaces:
            database = self._sampler.policies[poses.policy].database
            self._surfaces[poses.policy] = build_surface(database.skeleton, database.body, self._points)
        surface = self._surfaces[poses.policy]
        riders = Riders(*(getattr(surface, name) for name in Riders._fields))

        def place(bodies: Bodies, when: When, wanted: Wanted, cloud: Cloud) -> None:
            motions = np.empty((bodies.positions.shape[2], MOTION_COLUMNS))
            place_points(bodies, when, wanted, riders, motions, cloud.values, cloud.labels)

        return place

    def _skin_placer(self, poses: Poses) -> _Placer:
        riders = {
            number: self._skin_riders(poses.policy, number) for number in poses.avatars[self._chosen[poses.avatars]]
        }

        def place(bodies: Bodies, when: When, wanted: Wanted, cloud: Cloud) -> None:
            for index, (column, number) in enumerate(zip(wanted.columns, wanted.numbers, strict=True)):
                frames, rows = self._frames[number], slice(self._points * index, self._points * (index + 1))
                values, labels = cloud.values[rows], cloud.labels[rows]
                matrices = np.empty((3, *frames.bindings.shape))
                place_skin_points(bodies, when, column, riders[number], frames, matrices, values, labels)
                labels[:, 0], labels[:, 1] = number, wanted.teams[index]

        return place

    def _skin_riders(self, policy: int, number: int) -> SkinRiders:
        """Return the points on the skin of an avatar, and note what carries it."""
        cast = self._sampler.take.cast
        girth = float(cast.girths[number])
        key = policy, build_of(cast, number)
        if key not in self._skins:
            skin = build_skin_of(self._sampler.policies[policy].database, key[1])
            surface = build_skin_surface(skin, self._points)
            self._skins[key] = skin, SkinRiders(*(getattr(surface, name) for name in SkinRiders._fields))
        skin, riders = self._skins[key]
        if number not in self._frames:
            lengths = cast.stretches[number][self._sampler.motions[policy].segments].astype(float)
            positions, growths = skin.growth(girth, lengths)
            self._frames[number] = Frames(
                growths,
                np.ascontiguousarray(np.linalg.inv(growths[:, :, :3])),
                replace(skin, positions=positions).inverse_bindings(),
                skin.parents,
                skin.helpers,
                skin.straights(),
            )
        return riders

    def _place_props(self, bodies: Bodies, when: When, wanted: Wanted, rows: Array) -> None:
        """Put some of the points of avatars, evenly picked, on what they carry instead."""
        cast = self._sampler.take.cast
        for index in range(len(wanted.columns) if len(cast.held) else 0):
            kind = int(cast.types[wanted.numbers[index]])
            riders = self._prop_riders(kind)
            if riders is None:
                continue
            count = len(riders.joints)
            part, motions = Cloud.empty(count), np.empty((bodies.positions.shape[2], MOTION_COLUMNS))
            one = Wanted(*(values[index : index + 1] for values in wanted))
            place_points(bodies, when, one, riders, motions, part.values, part.labels)
            picked = np.floor((np.arange(count) + 0.5) * (self._points / count)).astype(int)
            rows[self._points * index + picked] = part.rows

    def _prop_riders(self, kind: int) -> Riders | None:
        """Return the points on what avatars of a type carry; None where there are none."""
        if kind not in self._props:
            props = self._sampler.take.cast.held
            props = props[props["type"] == kind]
            area = float(prop_areas(props).sum())
            count = round(min(area / (area + _SKIN_AREA), _MOST_SHARE) * self._points)
            self._props[kind] = None
            if count:
                surface = build_prop_surface(props, count)
                self._props[kind] = Riders(*(getattr(surface, name) for name in Riders._fields))
        return self._props[kind]

    def _build(
        self,
        blocks: Sequence[Poses],
        all_joints: Sequence[tuple[Array, Array]],
        placers: Sequence[_Placer],
        row: int,
        frame: int,
    ) -> Cloud:
        here = [
            np.flatnonzero(np.isfinite(joints[row, :, 0, 0]) & self._chosen[poses.avatars])
            for poses, (joints, _) in zip(blocks, all_joints, strict=True)
        ]
        seconds = frame / self._fps
        standing = [rows for (opens, closes), rows in self._standing.items() if not opens <= seconds < closes]
        on_bodies = self._points * sum(map(len, here))
        cloud = Cloud.empty(on_bodies + sum(map(len, standing)))
        teams, first = self._sampler.take.cast.teams, 0
        for poses, (joints, rotations), place, columns in zip(blocks, all_joints, placers, here, strict=True):
            build = poses.scales, poses.girths, poses.stretches
            bodies = Bodies(joints, rotations, *(values.astype(np.float32) for values in build))
            when = When(max(row - 1, 0), row, min(row + 1, len(joints) - 1), 1.0 / self._fps)
            numbers = poses.avatars[columns]
            wanted = Wanted(columns, numbers.astype(np.int32), teams[numbers].astype(np.int32))
            stop = first + self._points * len(columns)
            place(bodies, when, wanted, Cloud(cloud.rows[first:stop]))
            self._place_props(bodies, when, wanted, cloud.rows[first:stop])
            first = stop
        if standing:
            np.concatenate(standing, out=cloud.rows[on_bodies:])
        return cloud


def obstacle_points(parts: Array, density: float) -> dict[tuple[float, float], Array]:
    """Return points on obstacles, by when these are open.

    Their avatar and team are -1, their joint is -1 less the kind of obstacle: -1 walls, -2 boxes, -3 discs, -4 ropes,
    -5 doors.

    Args:
        parts: Parts of obstacles. Shape (n,), ``PART``.
        density: Points a square metre.

    Returns:
        From which second to which they are open, and the rows of ``Cloud`` (m, 12).
    """
    found: dict[tuple[float, float], list[Array]] = {}
    for part in parts if density > 0.0 else ():
        mesh = mesh_of(part)
        corners = mesh.positions[mesh.triangles]
        faces, shares = spread_points(corners, max(1, round(density * float(triangle_areas(corners).sum()))))
        cloud = Cloud.empty(len(faces))
        weights = shares[:, :, None]
        normals = (mesh.normals[mesh.triangles[faces]] * weights).sum(axis=1)
        cloud.values[:, :3] = (corners[faces] * weights).sum(axis=1)
        cloud.values[:, 3:6] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        cloud.values[:, 6:] = 0.0
        cloud.labels[:] = (-1, -1, -1 - int(part["kind"]))
        found.setdefault((float(part["opens"]), float(part["closes"])), []).append(cloud.rows)
    return {times: np.concatenate(rows) for times, rows in found.items()}


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
    surface: str = "capsules",
    obstacles: float = 0.0,
) -> list[Path]:
    """Write point clouds of a take; see ``CloudSink``.

    Returns:
        The files, in the order of frames.

    Raises:
        OutputError: The folder cannot be made, or a file cannot be written.
        RunError: Open3D, which writes PCD, cannot be loaded.
    """
    make_folder(folder)
    sink = CloudSink(sampler, folder, kind, fps, points, frames, every, avatars, surface, obstacles)
    return stream_poses(sampler, fps, [sink], threads, progress)[0]
