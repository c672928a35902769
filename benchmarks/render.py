"""Pictures: frames a second from poses to MP4, beside Open3D's legacy Visualizer where that starts.

    python benchmarks/render.py [--json] [--quick]

Boxers of the embedded performer stand in a square and box; every frame they are posed, drawn at 1280 x 720 with soft
shadows and soft edges, and encoded (x264, veryfast, CRF 20) by a process of its own. Threads: as many as there are
processors.

Open3D draws the same bodies as one mesh an avatar, posed by numpy, without shadows, and its pictures go through the
same encoder; it runs in a process of its own, since missing system libraries crash it. ``fps_30`` is null where it does
not start.

``memory``: what 1000 frames of 30 boxers add to the process's memory after the first 100 [MiB].
The paper: 1000 frames of 30 boxers with pictures in 251 s, which is 4 a second (2.4 GHz Pentium 4).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from crowdsim.motion import quaternion
from crowdsim.motion.body import build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.performer import perform
from crowdsim.motion.tracks import build_tracks
from crowdsim.render.batch import render
from crowdsim.render.source import no_hits
from crowdsim.render.stage import build_stage
from crowdsim.render.video import encode, planes

SIZE, FPS, PAPER = (1280, 720), 30.0, 4.0
FRAMES = {30: 480, 1000: 96, 10000: 24}


class Boxers:
    """Boxers in a square, each at a place of its own in the performer's motion; a ``PoseSource``."""

    def __init__(self, count: int, frames: int, spacing: float = 1.7) -> None:
        clip = perform(30.0, 1)[0].clip
        self.skeleton, self.body = clip.skeleton, build_body(clip.skeleton)
        positions, rotations = forward_kinematics(clip.skeleton, clip.root_positions, clip.rotations)
        stands = build_tracks(self.body, positions, rotations).ground
        self.local = clip.rotations.astype(np.float32)
        self.roots = (clip.root_positions - np.insert(stands[:, :2], 1, 0.0, axis=1)).astype(np.float32)
        rng = np.random.default_rng(1)
        side = int(np.ceil(np.sqrt(count)))
        cells = np.stack(np.divmod(np.arange(count), side), axis=1) - 0.5 * (side - 1)
        self.places = cells * spacing + rng.normal(size=(count, 2)) * 0.25
        self.turns = quaternion.about_y(rng.uniform(-np.pi, np.pi, count)).astype(np.float32)
        self.starts = rng.integers(0, clip.frame_count, count)
        self.step = round(clip.fps / FPS)
        self.name, self.fingerprint, self.fps, self.frame_count = "boxers", f"boxers {count} {frames}", FPS, frames
        self.avatar_names = [f"boxer_{i}" for i in range(count)]
        self.avatar_teams = np.arange(count) % 2
        self.avatar_scales = np.ones(count)
        self.avatar_heights = np.full(count, self.body.height)
        self.avatar_colours = np.full((count, 3), np.nan)
        self.figures, self.avatar_figures = [self.body], np.zeros(count, np.int32)

    def ground(self, frames: np.ndarray) -> np.ndarray:
        """Return where all stand. Shape (n, N, 3)."""
        stands = np.concatenate([self.places, np.zeros((len(self.places), 1))], axis=1)
        return np.broadcast_to(stands, (len(frames), *stands.shape))

    def poses(self, frame: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return places and rotations of all joints at a frame."""
        at = (self.starts + frame * self.step) % len(self.local)
        local = self.local[at]
        local[:, 0] = quaternion.multiply(self.turns, local[:, 0])
        roots = quaternion.rotate(self.turns, self.roots[at])
        roots[:, [0, 2]] += self.places
        return [forward_kinematics(self.skeleton, roots.astype(np.float32), local, parallel=False)]

    def hits(self, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return that nothing lands."""
        return no_hits()

    def markers(self, frame: int) -> np.ndarray:
        """Return that there are only boxers."""
        return np.zeros((0, 3))


def frames_a_second(source: Any, frames: int, repeats: int) -> float:
    """Best rate of several renderings of the first frames of a source to MP4."""
    best = 0.0
    with tempfile.TemporaryDirectory() as folder:
        render(source, Path(folder) / "warm", size=SIZE, frames=(0, 2))
        for repeat in range(repeats):
            started = time.perf_counter()
            render(source, Path(folder) / str(repeat), size=SIZE, frames=(0, frames))
            best = max(best, frames / (time.perf_counter() - started))
    return best


def memory_growth(source: Any, frames: int) -> float:
    """MiB that the process grows by after a tenth of the frames."""
    process, seen = psutil.Process(), {}

    def watch(stage: str, done: int, total: int) -> None:
        if done in (total // 10, total):
            seen[done] = process.memory_info().rss

    with tempfile.TemporaryDirectory() as folder:
        render(source, Path(folder), size=SIZE, frames=(0, frames), progress=watch)
    return (seen[frames] - seen[frames // 10]) / 2**20


def with_open3d(frames: int) -> float:
    """Frames a second of Open3D's legacy Visualizer with the same boxers; crashes where it cannot start."""
    import open3d as o3d

    source = Boxers(30, frames)
    stage = build_stage(source, SIZE, caption=False)
    window = o3d.visualization.Visualizer()
    if not window.create_window(width=SIZE[0], height=SIZE[1], visible=False):
        raise SystemExit("no window")
    figure, paints = stage.cast.figures[0], stage.cast.paints.reshape(30, -1, 4)
    points, joints, triangles, colours, count = [], [], [], [], 0
    for k in range(len(figure.capsule_joints)):
        mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
        ball, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
        start, end = figure.capsule_starts[k], figure.capsule_ends[k]
        way = end - start
        to_axis = np.array([0.0, 0.0, 1.0]) if not way.any() else way / np.linalg.norm(way)
        turned = quaternion.rotate(quaternion.between([0.0, 0.0, 1.0], to_axis), ball)
        upper = (ball[:, 2] > 1e-6)[:, None]
        points.append(
            np.where(upper, end + turned * figure.capsule_radii[k, 1], start + turned * figure.capsule_radii[k, 0])
        )
        joints.append(np.full(len(ball), figure.capsule_joints[k]))
        triangles.append(faces + count)
        colours.append(np.repeat(np.sqrt(paints[:, k : k + 1, :3]), len(ball), axis=1))
        count += len(ball)
    local, rides, faces = np.concatenate(points), np.concatenate(joints), np.concatenate(triangles)
    tints = np.concatenate(colours, axis=1)
    meshes = [o3d.geometry.TriangleMesh() for _ in range(30)]

    def place(frame: int) -> None:
        positions, rotations = source.poses(frame)[0]
        for avatar, mesh in enumerate(meshes):
            points = positions[avatar, rides] + quaternion.rotate(rotations[avatar, rides], local)
            mesh.vertices = o3d.utility.Vector3dVector(points)
            mesh.compute_vertex_normals()

    for avatar, mesh in enumerate(meshes):
        mesh.triangles = o3d.utility.Vector3iVector(faces)
        mesh.vertex_colors = o3d.utility.Vector3dVector(tints[avatar])
    place(0)
    for mesh in meshes:
        window.add_geometry(mesh)

    def pictures(total: int) -> Any:
        for frame in range(total):
            place(frame)
            for mesh in meshes:
                window.update_geometry(mesh)
            window.poll_events()
            window.update_renderer()
            shown = np.asarray(window.capture_screen_float_buffer(False))
            yield planes((shown * 255.0 + 0.5).astype(np.uint8))

    with tempfile.TemporaryDirectory() as folder:
        encode(Path(folder) / "warm.mp4", pictures(2), SIZE, FPS)
        started = time.perf_counter()
        encode(Path(folder) / "video.mp4", pictures(frames), SIZE, FPS)
        return frames / (time.perf_counter() - started)


def open3d_apart(frames: int) -> float | None:
    """The same in a process of its own; None where it fails."""
    try:
        done = subprocess.run(
            [sys.executable, __file__, "--open3d", str(frames)],
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
        return float(done.stdout.strip().splitlines()[-1]) if done.returncode == 0 else None
    except (subprocess.TimeoutExpired, ValueError, IndexError):
        return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON document and nothing else")
    parser.add_argument("--quick", action="store_true", help="fewer frames")
    parser.add_argument("--open3d", type=int, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.open3d:
        print(with_open3d(chosen.open3d))
        return
    share = 4 if chosen.quick else 1
    told: dict[str, Any] = {"size": list(SIZE), "processors": os.cpu_count(), "fps": {}}
    for count, frames in FRAMES.items():
        told["fps"][str(count)] = frames_a_second(Boxers(count, frames), frames // share, 2)
    told["open3d"] = {"fps_30": open3d_apart(120 // share)}
    told["paper"] = {"fps_30": PAPER}
    told["memory"] = {"growth_mib": memory_growth(Boxers(30, 1000), 1000 // share)}
    if chosen.json:
        print(json.dumps(told, indent=2))
        return
    print(f"{'boxers':>8}  {'frames/s':>8}")
    for count, rate in told["fps"].items():
        print(f"{count:>8}  {rate:8.1f}")
    theirs = told["open3d"]["fps_30"]
    print(f"Open3D, 30 boxers, no shadows: {'does not start' if theirs is None else f'{theirs:.1f} frames/s'}")
    print(f"the paper, 30 boxers: {PAPER:.0f} frames/s")
    print(f"memory over {1000 // share} frames: {told['memory']['growth_mib']:+.1f} MiB")


if __name__ == "__main__":
    main()
