"""Pictures: frames per second from take to MP4, beside Open3D's legacy Visualizer where it starts.

    python benchmarks/render.py [--json] [--quick]

Runs of ``brawl_30`` with 30, 1,000 and 10,000 boxers at the same density; the policy is trained first where necessary.
Every frame is posed from the take, drawn at 1280 x 720 with soft shadows and antialiasing, and encoded (x264, CRF 20)
in a process of its own: the best of two renderings. There are as many threads as processors. ``cpu_milliseconds`` is
the CPU time of a frame on all processors, the encoder included, which other load on the machine disturbs less than
wall time.

``commands`` are whole commands in a fresh process each, its start and the opening of the run included: the first
picture of ``crowd_10k`` and ``crowd_100k``, with kernels compiled before and with none (``cold``), and 100 pictures of
``crowd_10k``; wall and CPU time and the most memory that the process holds. 300 pictures of ``brawl_30`` with each
figure: ``body``, and ``capsules`` beside it.

Open3D draws the same bodies as one mesh per avatar, posed by numpy, without shadows, and its pictures go through the
same encoder; it runs in a process of its own, since missing system libraries crash it. ``fps_30`` is null where it
does not start.

``memory``: what 1000 frames of 30 boxers add to the process's memory after the first 100, and its peak [MiB]. The
paper: 1000 frames of 30 boxers with pictures in 251 s, 4 per second (2.4 GHz Pentium 4).
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import psutil
from _commands import warm_and_cold, whole_command
from _quick import command_line, small_policies

from crowdsim.crowd.profiling import with_avatars
from crowdsim.motion import quaternion
from crowdsim.preparation.prepare import load_policies
from crowdsim.render.batch import render
from crowdsim.render.look import Look
from crowdsim.render.options import RenderOptions
from crowdsim.render.stage import build_stage
from crowdsim.render.take_source import TakeSource
from crowdsim.render.video import encode, planes
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario

FPS, PAPER = 30.0, 4.0


class Sizes(NamedTuple):
    """How much is drawn.

    Attributes:
        picture: Width and height of a picture.
        boxers: Number of boxers by the name of the figure.
        frames: Frames of each of them.
        open3d: Frames of Open3D.
        memory: Frames over which memory is watched, a multiple of ten.
        crowd: Options of ``crowdsim run`` for the crowds of whole commands.
        first: The frame whose picture is the first one, and how many pictures follow one another.
        brawl: Frames of 30 boxers with each figure.
    """

    picture: tuple[int, int] = (1280, 720)
    boxers: Mapping[str, int] = {"30": 30, "1000": 1000, "10000": 10000}
    frames: tuple[int, int, int] = (300, 96, 28)
    open3d: int = 120
    memory: int = 1000
    crowd: tuple[str, ...] = ()
    first: int = 100
    brawl: int = 300


QUICK = Sizes(
    (160, 90), {"30": 3, "1000": 6, "10000": 9}, (3, 3, 3), 2, 20, ("--frames", "10", "--fraction", "0.0005"), 5, 5
)
"""Sizes of a quick run; figures keep the names of what they are figures of."""
THREADS = os.cpu_count() or 1


def boxers(count: int, seconds: float) -> TakeSource:
    """A run of ``scenarios/brawl_30.yaml`` with this many boxers, as dense as there, of this length."""
    scenario = with_avatars(load_scenario("brawl_30"), count)
    policies = load_policies(scenario, threads=THREADS)
    frames = int(np.ceil(seconds * float(policies[0].database.control_rate))) + 1
    take = run(scenario.model_copy(update={"duration": frames}), policies, threads=THREADS)
    return TakeSource(take, policies, FPS, threads=THREADS)


def spent() -> float:
    """CPU time of this process and of those that it has waited for [s]."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def frames_a_second(source: Any, size: tuple[int, int], frames: int, repeats: int) -> tuple[float, float]:
    """Best rate of several renderings of the first frames of a source to MP4, and least CPU time of a frame [ms]."""
    best, least = 0.0, np.inf
    with tempfile.TemporaryDirectory() as folder:
        render(source, Path(folder) / "warm", RenderOptions(size=size, frames=(0, 2)))
        for repeat in range(repeats):
            started, before = time.perf_counter(), spent()
            render(source, Path(folder) / str(repeat), RenderOptions(size=size, frames=(0, frames)))
            best = max(best, frames / (time.perf_counter() - started))
            least = min(least, (spent() - before) / frames * 1000.0)
    return best, float(least)


def memory(source: Any, size: tuple[int, int], frames: int) -> dict[str, float]:
    """MiB that the process grows by after a tenth of the frames, and the most it holds."""
    process, seen = psutil.Process(), dict[int, int]()

    def watch(stage: str, done: int, total: int) -> None:
        if done in (total // 10, total) or (done > total // 10 and done % 50 == 0):
            seen[done] = process.memory_info().rss

    with tempfile.TemporaryDirectory() as folder:
        render(source, Path(folder), RenderOptions(size=size, frames=(0, frames)), progress=watch)
    return {"growth_mib": (seen[frames] - seen[frames // 10]) / 2**20, "most_mib": max(seen.values()) / 2**20}


def commands(sizes: Sizes) -> dict[str, dict[str, dict[str, float]]]:
    """What pictures of crowds cost, by the number of boxers, from the command to the prompt."""
    outcome: dict[str, dict[str, dict[str, float]]] = {}
    drawn = ("--png", "--size", "x".join(map(str, sizes.picture)), "--frames")
    for count, scene in (("10000", "crowd_10k"), ("100000", "crowd_100k")):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            whole_command("run", scene, "--out", str(folder / "run"), *sizes.crowd)
            pictures = ("render", str(folder / "run"), *drawn)
            outcome[count] = warm_and_cold(folder, *pictures, f"{sizes.first}:{sizes.first + 1}")
            if count == "10000":
                outcome[count]["many"] = whole_command(*pictures, f"0:{sizes.first}", "--out", str(folder / "many"))
    with tempfile.TemporaryDirectory() as name:
        folder, size = Path(name), drawn[2]
        whole_command("run", "brawl_30", "--out", str(folder / "run"))
        video = ("render", str(folder / "run"), "--size", size, "--frames", f"0:{sizes.brawl}", "--figure")
        whole_command(*video, "body", "--out", str(folder / "before"))  # what it compiles is there later
        outcome["30"] = {
            figure: whole_command(*video, figure, "--out", str(folder / figure)) for figure in ("capsules", "body")
        }
    return outcome


def with_open3d(sizes: Sizes) -> float:
    """Frames a second of Open3D's legacy Visualizer with the same boxers; crashes where it cannot start."""
    import open3d as o3d

    count, size, frames = sizes.boxers["30"], sizes.picture, sizes.open3d
    source = boxers(count, frames / FPS)
    stage = build_stage(source, size, look=Look(caption=False))
    window = o3d.visualization.Visualizer()
    if not window.create_window(width=size[0], height=size[1], visible=False):
        raise SystemExit("no window")
    figure, paints = stage.cast.figures[0], stage.cast.paints.reshape(count, -1, 4)
    points, joints, triangles, colours, corners = [], [], [], [], 0
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
        triangles.append(faces + corners)
        colours.append(np.repeat(np.sqrt(paints[:, k : k + 1, :3]), len(ball), axis=1))
        corners += len(ball)
    local, rides, faces = np.concatenate(points), np.concatenate(joints), np.concatenate(triangles)
    tints = np.concatenate(colours, axis=1)
    meshes = [o3d.geometry.TriangleMesh() for _ in range(count)]

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
        encode(Path(folder) / "warm.mp4", pictures(2), size, FPS)
        started = time.perf_counter()
        encode(Path(folder) / "video.mp4", pictures(frames), size, FPS)
        return frames / (time.perf_counter() - started)


def open3d_apart(quick: bool) -> float | None:
    """The same in a process of its own; None where it fails."""
    try:
        done = subprocess.run(
            [sys.executable, str(Path(__file__).resolve()), "--open3d", *(["--quick"] if quick else [])],
            capture_output=True,
            text=True,
            timeout=400,
            check=False,
        )
        return float(done.stdout.strip().splitlines()[-1]) if done.returncode == 0 else None
    except (subprocess.TimeoutExpired, ValueError, IndexError):
        return None


def measure(sizes: Sizes, quick: bool) -> dict[str, Any]:
    """Return all figures."""
    size = sizes.picture
    outcome: dict[str, Any] = {"size": list(size), "processors": THREADS, "fps": {}, "cpu_milliseconds": {}}
    for (name, count), frames in zip(sizes.boxers.items(), sizes.frames, strict=True):
        outcome["fps"][name], outcome["cpu_milliseconds"][name] = frames_a_second(
            boxers(count, frames / FPS), size, frames, 2
        )
    outcome["open3d"] = {"fps_30": open3d_apart(quick)}
    outcome["paper"] = {"fps_30": PAPER}
    outcome["commands"] = commands(sizes)
    outcome["memory"] = memory(boxers(sizes.boxers["30"], sizes.memory / FPS), size, sizes.memory)
    return outcome


def main() -> None:
    parser = command_line(__doc__, "seconds: small pictures, few boxers and frames, small policies")
    parser.add_argument("--open3d", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    sizes = QUICK if chosen.quick else Sizes()
    if chosen.open3d:
        print(with_open3d(sizes))
        return
    with small_policies(wanted=chosen.quick):
        outcome = measure(sizes, chosen.quick)
    if chosen.json:
        print(json.dumps(outcome, indent=2))
        return
    print(f"{'boxers':>8}  {'frames/s':>8}  {'CPU ms':>8}")
    for count, rate in outcome["fps"].items():
        print(f"{count:>8}  {rate:8.1f}  {outcome['cpu_milliseconds'][count]:8.1f}")
    theirs = outcome["open3d"]["fps_30"]
    print(f"Open3D, 30 boxers, no shadows: {'does not start' if theirs is None else f'{theirs:.1f} frames/s'}")
    print(f"the paper, 30 boxers: {PAPER:.0f} frames/s")
    for count, rows in outcome["commands"].items():
        for row, one in rows.items():
            what = {
                "warm": "first picture",
                "cold": "nothing compiled",
                "many": f"{sizes.first} pictures",
                "capsules": f"video of {sizes.brawl} frames, capsules",
                "body": f"video of {sizes.brawl} frames, bodies",
            }[row]
            seconds, peak = one["wall_seconds"], one["peak_bytes"] / 1e9
            line = f"{seconds:.1f} s, {one['cpu_seconds']:.0f} CPU-seconds, {peak:.2f} GB"
            print(f"{int(count):,} boxers, {what}: {line}")
    held = outcome["memory"]
    print(f"memory over {sizes.memory} frames: {held['growth_mib']:+.1f} MiB of {held['most_mib']:.0f}")


if __name__ == "__main__":
    main()
