"""Exports of 30 avatars: BVH beside numpy.savetxt and orjson, point clouds beside Open3D's legacy writer.

    python benchmarks/export.py [--json] [--quick] [--frames 4000] [--clouds 1000] [--threads 2] [--repeats 3]
                                [--control 60000] [--inspected 150000]

Thirty avatars play the embedded boxer's motion, each from another moment. Posing is not counted; everything after it,
to files under their final names, is, the best of several runs. A cloud has 500 points per avatar with normals,
velocities, avatar, team and joint.

``commands`` are whole commands in a fresh process each, posing included: BVH at 15 frames a second of thirty boxers
over ``--control`` control frames (``brawl_30``), with kernels compiled before and with none (``cold``), and
``inspect`` of ``--inspected`` control frames.

numpy.savetxt and orjson write only the rows of the BVH files; savetxt is timed on two files and the legacy writer,
which supports neither velocities nor labels, on fifty, and multiplied.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import open3d
from _commands import warm_and_cold, whole_command
from _quick import best_seconds, command_line, small_policies
from numpy.typing import NDArray

from crowdsim.bvh.clip import channel_motion, clip_channels
from crowdsim.crowd.props import FACE, PROP
from crowdsim.export.pointcloud import CloudSink, export_clouds
from crowdsim.motion import quaternion
from crowdsim.motion.body import build_body
from crowdsim.outputs.bvh import export_bvh
from crowdsim.performer.session import perform
from crowdsim.places.kernels.records import PART
from crowdsim.poses.builds import joint_segments
from crowdsim.poses.sampler import Poses

AVATARS = 30
POINTS = 500
FPS = 60.0


class Posed:
    """Poses that are there already, where an exporter expects a ``PoseSampler``."""

    def __init__(self, frames: int) -> None:
        clip = max((one.clip for one in perform(frames / FPS + 20.0, 3)), key=lambda clip: clip.frame_count)
        skeleton = clip.skeleton
        rows = (np.arange(frames)[:, None] + np.arange(AVATARS) * 37) % clip.frame_count
        turns = quaternion.about_y(np.arange(AVATARS) * 2.4)
        rotations = clip.rotations[rows]
        rotations[:, :, 0] = quaternion.multiply(turns, rotations[:, :, 0])
        positions = quaternion.rotate(turns, clip.root_positions[rows]) + np.arange(AVATARS)[:, None] * [1.0, 0.0, 0.3]
        scales = np.linspace(0.94, 1.06, AVATARS).astype(np.float32)
        whole, body, stretches = np.arange(AVATARS), build_body(skeleton), np.ones((AVATARS, 3))
        segments = joint_segments(skeleton, body)
        self._poses = Poses(0, whole, skeleton, scales, np.ones_like(scales), stretches, segments,
                            positions.astype(np.float32), rotations.astype(np.float32),
                            np.zeros((frames, AVATARS, 3)))  # fmt: skip
        self._frames, self.obstacles = frames, np.zeros(0, PART)
        self.policies = (SimpleNamespace(database=SimpleNamespace(skeleton=skeleton, body=body)),)
        self.motions = (SimpleNamespace(skeleton=skeleton, segments=segments, body=body),)
        self.take = SimpleNamespace(
            avatar_count=AVATARS,
            frame_count=frames,
            control_rate=FPS,
            output_frames=lambda fps: frames,
            cast=SimpleNamespace(
                attachments=np.zeros(0, PROP),
                faces=np.zeros(0, FACE),
                held=np.zeros(0, PROP),
                names=np.array([f"boxer_{number:02d}" for number in whole]),
                policies=np.zeros(AVATARS, np.int16),
                scales=scales,
                stretches=stretches,
                teams=(whole % 2).astype(np.int16),
            ),
        )

    def present(self, avatar: int, start: int, stop: int, fps: float) -> NDArray[Any]:
        """Return in which frames an avatar is there: everyone always is."""
        return np.ones(stop - start, bool)

    def sample(self, start: int, stop: int, fps: float, avatars: Sequence[int] | None = None) -> list[Poses]:
        """Return a slice of the poses."""
        whole, here = self._poses, slice(start, stop)
        bodies = whole.scales, whole.girths, whole.stretches, whole.segments
        return [Poses(0, whole.avatars, whole.skeleton, *bodies, whole.root_positions[here], whole.rotations[here],
                      whole.ground[here])]  # fmt: skip

    def rows(self, avatar: int) -> NDArray[Any]:
        """Return the rows of an avatar's BVH file."""
        poses = self._poses
        channels = clip_channels(poses.skeleton.joint_count, "ZXY", False)
        return channel_motion(channels, poses.root_positions[:, avatar], poses.rotations[:, avatar])


def measure(frames: int, clouds: int, threads: int, repeats: int) -> dict[str, Any]:
    """Return seconds of every method of writing, and sizes [MB]."""
    import orjson

    sampler: Any = Posed(frames)
    every = max(1, frames // clouds)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        export_bvh(sampler, folder / "warm", FPS, (0, 4), threads=threads)
        export_clouds(sampler, folder / "warm", "ply", FPS, POINTS, (0, 4))
        outcome: dict[str, Any] = {"bvh": {}, "clouds": {}}
        bvh, cloud = outcome["bvh"], outcome["clouds"]
        bvh["crowdsim"] = best_seconds(lambda: export_bvh(sampler, folder / "bvh", FPS, threads=threads), repeats)
        bvh["megabytes"] = sum(path.stat().st_size for path in (folder / "bvh").iterdir()) / 1e6
        rows = [sampler.rows(avatar) for avatar in range(AVATARS)]

        def savetxt() -> None:
            for k in range(2):
                np.savetxt(folder / f"{k}.txt", rows[k], fmt="%.5f")

        bvh["numpy.savetxt"] = AVATARS / 2 * best_seconds(savetxt, 1)
        bvh["orjson"] = best_seconds(
            lambda: [
                (folder / f"{k}.json").write_bytes(orjson.dumps(rows[k], option=orjson.OPT_SERIALIZE_NUMPY))
                for k in range(AVATARS)
            ],
            repeats,
        )
        chosen = (0, every * clouds)
        for kind in ("ply", "pcd"):
            cloud[kind] = best_seconds(
                partial(export_clouds, sampler, folder / kind, kind, FPS, POINTS, chosen, every, threads=threads),
                repeats,
            )
        cloud["megabytes"] = sum(path.stat().st_size for path in (folder / "ply").iterdir()) / 1e6
        some = CloudSink(sampler, folder / "ply", "ply", FPS, POINTS).build(1)

        def legacy() -> None:
            for number in range(50):
                points = open3d.geometry.PointCloud()
                points.points = open3d.utility.Vector3dVector(some.positions.astype(float))
                points.normals = open3d.utility.Vector3dVector(some.normals.astype(float))
                open3d.io.write_point_cloud(folder / f"{number}.ply", points)

        cloud["open3d legacy"] = clouds / 50 * best_seconds(legacy, repeats)
    return outcome


def commands(exported: int, inspected: int) -> dict[str, dict[str, float]]:
    """What exporting and describing long runs cost, from the command to the prompt."""
    with tempfile.TemporaryDirectory() as name:
        runs = [str(Path(name) / what) for what in ("exported", "inspected")]
        for run, frames in zip(runs, (exported, inspected), strict=True):
            whole_command("run", "brawl_30", "--out", run, "--frames", str(frames), "--set", "outputs={}")
        outcome = warm_and_cold(Path(name), "export", runs[0], "--bvh", "--fps", "15")
        whole_command("inspect", runs[1])
        return {**outcome, "inspect": whole_command("inspect", runs[1])}


def main() -> None:
    parser = command_line(__doc__, "seconds: few frames and clouds")
    parser.add_argument("--frames", type=int, default=4000)
    parser.add_argument("--clouds", type=int, default=1000)
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--control", type=int, default=60_000, help="control frames that are exported as BVH")
    parser.add_argument("--inspected", type=int, default=150_000, help="control frames that `inspect` describes")
    chosen = parser.parse_args()
    if chosen.quick:
        chosen.frames, chosen.clouds, chosen.repeats = min(chosen.frames, 60), min(chosen.clouds, 4), 1
        chosen.control, chosen.inspected = min(chosen.control, 60), min(chosen.inspected, 60)
    outcome = measure(chosen.frames, chosen.clouds, chosen.threads, chosen.repeats)
    with small_policies(wanted=chosen.quick):
        outcome["commands"] = commands(chosen.control, chosen.inspected)
    if chosen.json:
        print(json.dumps({**vars(chosen), **outcome}, indent=2))
        return
    for what, title in (
        ("bvh", f"BVH, {AVATARS} avatars x {chosen.frames} frames"),
        ("clouds", f"{chosen.clouds} clouds of {AVATARS * POINTS:,} points"),
    ):
        print(f"{title}, {outcome[what]['megabytes']:.0f} MB, {chosen.threads} threads")
        for name, seconds in outcome[what].items():
            if name != "megabytes":
                print(f"  {name:<16}{seconds:>8.2f} s")
    for row, one in outcome["commands"].items():
        what = {"warm": "BVH", "cold": "the same, nothing compiled", "inspect": "inspect"}[row]
        seconds, peak = one["wall_seconds"], one["peak_bytes"] / 1e9
        frames = chosen.inspected if row == "inspect" else chosen.control
        print(f"30 boxers x {frames:,} control frames, {what}: {seconds:.1f} s, {peak:.2f} GB")


if __name__ == "__main__":
    main()
