"""Delivery of 30 avatars as skinned glTF: time and size of a file, cost of skinning, peak memory.

    python benchmarks/delivery.py [--json] [--quick] [--frames 4000] [--threads 2] [--repeats 3]

Thirty avatars play the embedded boxer's motion, each from another moment. Posing is not counted; everything after it,
to a file under its final name, is, the best of several runs. Building the skin, which happens once in a process, is
stated apart. Peak memory is what Python and numpy allocate while one file is written, poses not counted.

``clips``: a bank of clips and tracks of ``brawl_30`` at 30 frames a second, everything after the run counted.

``touches``: how far gloves are from the skin that they hit there, at the moments of strikes that land: the share within
2 cm, and how far the median glove is in it [cm]; capsules are what they are aimed at.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
import tracemalloc
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from _quick import best_seconds, command_line, small_policies
from export import AVATARS, FPS, Posed

from crowdsim.body.anatomy import Build
from crowdsim.body.looks import build_of
from crowdsim.body.skin import build_skin_of, pose_skins
from crowdsim.crowd.cast import USUAL_BODY
from crowdsim.export.clips import write_clips
from crowdsim.export.gltf import write_gltf
from crowdsim.poses.sampler import PoseSampler
from crowdsim.preparation.prepare import load_policies
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario


class Crowd(Posed):
    """Poses that are there already, with all that a glTF file says of a take."""

    def __init__(self, frames: int) -> None:
        super().__init__(frames)
        cast = self.take.cast
        cast.girths, cast.types = np.ones(AVATARS, np.float32), np.zeros(AVATARS, np.int16)
        cast.colours, cast.team_names, cast.type_names = np.full((1, 3), np.nan), ("red", "blue"), ("boxer",)
        cast.bodies = (USUAL_BODY,)
        self.policies[0].database.rotations = self._poses.rotations[:, 0]
        none = np.zeros(0)
        self.take.events = SimpleNamespace(frame=none, attacker=none, victim=none, damage=none)
        self.take.targets = np.zeros((self.take.frame_count, 0, 3))
        self.take.scenario, self.take.seed, self.take.control_rate = "delivery", 0, 60.0


def write(crowd: Any, folder: Path, fps: float, rotations: str, threads: int) -> int:
    """Write a file and return its size in bytes."""
    (path,) = write_gltf(crowd, folder / "crowd.glb", fps=fps, rotations=rotations, threads=threads)
    return path.stat().st_size


def peak(crowd: Any, folder: Path, threads: int) -> float:
    """Return how much memory Python and numpy allocate at most while a file is written [MB]."""
    tracemalloc.start()
    write(crowd, folder, FPS, "float32", threads)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most / 1e6


def brawl(frames: int | None) -> Any:
    """Return the poses of a run of ``brawl_30``."""
    scenario = load_scenario("brawl_30")
    policies = load_policies(scenario)
    take = run(scenario if frames is None else scenario.model_copy(update={"duration": frames}), policies)
    return PoseSampler(take, policies)


def clips(sampler: Any, repeats: int) -> dict[str, float]:
    """Return how long a bank of clips and tracks takes [s], and how large its files are [MB]."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = write_clips(sampler, folder, 30)
        seconds = best_seconds(partial(write_clips, sampler, folder, 30), repeats)
        sizes = {path.name: path.stat().st_size / 1e6 for path in files}
    return {"seconds": seconds, "frames": sampler.take.output_frames(30.0), **sizes}


def touches(sampler: Any, most: int) -> dict[str, float | None]:
    """Return how far gloves are from skins at strikes that land, of so many at the most."""
    from scipy.spatial import cKDTree
    from trimesh.triangles import closest_point

    take = sampler.take
    strikes = take.strikes(outcome="landed")
    strikes = strikes[(strikes["victim"] >= 0) & np.char.endswith(strikes["limb"].astype(str), "hand")]
    gaps = []
    for strike in strikes[:: max(1, len(strikes) // most)]:
        bodies = []
        for avatar in (int(strike["attacker"]), int(strike["victim"])):
            ((_, body, sizes, places, turned),) = sampler.moments(np.array([avatar]), strike["seconds"][None])
            policy, girth = int(take.cast.policies[avatar]), float(take.cast.girths[avatar])
            lengths = take.cast.stretches[avatar][sampler.motions[policy].segments].astype(float)
            skin = build_skin_of(sampler.policies[policy].database, build_of(take.cast, avatar)).shaped(girth, lengths)
            (vertices,), _ = pose_skins([skin], skin.matrices(places, turned, sizes))
            bodies.append((skin, body, vertices.astype(float)))
        (own, body, vertices), (other, _, theirs) = bodies
        hand = body.roles[f"{strike['limb'].split('_')[0]}_hand"]
        glove = vertices[own.joints[np.arange(len(vertices)), np.argmax(own.weights, axis=1)] == hand]
        triangles = theirs[other.triangles]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        middles = cKDTree(triangles.mean(axis=1))
        glove = glove[np.argsort(middles.query(glove)[0])[:60]]
        depths = []
        for point, some in zip(glove, middles.query(glove, k=10)[1], strict=True):
            away = point - closest_point(triangles[some], np.tile(point, (len(some), 1)))
            nearest = int(np.argmin(np.linalg.norm(away, axis=1)))
            outside = away[nearest] @ normals[some[nearest]] >= 0.0
            depths.append(float(np.linalg.norm(away[nearest])) * (1.0 if outside else -1.0))
        gaps.append(100.0 * min(depths))
    if not gaps:
        return {"strikes": 0, "within 2 cm": None, "median cm": None}
    share = float((np.abs(gaps) <= 2.0).mean())
    return {"strikes": len(gaps), "within 2 cm": share, "median cm": -float(np.median(gaps))}


def measure(frames: int, threads: int, repeats: int, run_frames: int | None = None) -> dict[str, Any]:
    """Return times [s], bytes for an avatar in a frame, and memory [MB]."""
    crowd: Any = Crowd(frames)
    database = crowd.policies[0].database
    start = time.perf_counter()
    skin = build_skin_of(database, Build())
    outcome: dict[str, Any] = {"build seconds": time.perf_counter() - start, "triangles": len(skin.triangles)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_gltf(crowd, folder / "crowd.glb", frames=(0, 4), fps=FPS)
        for rotations in ("float32", "int16"):
            size = write(crowd, folder, FPS, rotations, threads)
            outcome[rotations] = {
                "seconds": best_seconds(partial(write, crowd, folder, FPS, rotations, threads), repeats),
                "megabytes": size / 1e6,
                "bytes an avatar-frame": size / (AVATARS * frames),
            }
        outcome["peak megabytes"] = peak(crowd, folder, threads)
    (poses,) = crowd.sample(0, 1, FPS)
    positions, turned = (values[0].astype(float) for values in poses.joints())
    skins = [skin] * AVATARS
    pose_skins(skins, skin.matrices(positions, turned, poses.scales))
    outcome["skinning milliseconds"] = 1e3 * best_seconds(
        lambda: pose_skins(skins, skin.matrices(positions, turned, poses.scales)), 20
    )
    sampler = brawl(run_frames)
    outcome["clips"], outcome["touches"] = clips(sampler, repeats), touches(sampler, 300)
    return outcome


def main() -> None:
    parser = command_line(__doc__, "seconds: few frames")
    parser.add_argument("--frames", type=int, default=4000)
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--repeats", type=int, default=3)
    chosen = parser.parse_args()
    if chosen.quick:
        chosen.frames, chosen.repeats = min(chosen.frames, 60), 1
    with small_policies(wanted=chosen.quick):
        outcome = measure(chosen.frames, chosen.threads, chosen.repeats, 20 if chosen.quick else None)
    if chosen.json:
        print(json.dumps({**vars(chosen), **outcome}, indent=2))
        return
    print(f"glTF, {AVATARS} avatars x {chosen.frames} frames, {chosen.threads} threads")
    for rotations in ("float32", "int16"):
        row = outcome[rotations]
        print(f"  {rotations:<10}{row['seconds']:>7.2f} s{row['megabytes']:>8.1f} MB"
              f"{row['bytes an avatar-frame']:>8.1f} bytes an avatar-frame")  # fmt: skip
    print(f"  {outcome['triangles']} triangles, built in {outcome['build seconds']:.1f} s")
    print(f"  {AVATARS} skinned on one thread in {outcome['skinning milliseconds']:.1f} ms")
    print(f"  at most {outcome['peak megabytes']:.0f} MB of memory while writing")
    found = outcome["clips"]
    sizes = ", ".join(f"{name} {size:.1f} MB" for name, size in found.items() if "." in name)
    print(f"clips, brawl_30, {found['frames']:.0f} frames at 30 a second: {found['seconds']:.2f} s, {sizes}")
    found = outcome["touches"]
    if found["strikes"]:
        print(f"gloves within 2 cm of the skin at {100 * found['within 2 cm']:.1f} % of {found['strikes']} landed "
              f"strikes, in the median {found['median cm']:.1f} cm in it")  # fmt: skip


if __name__ == "__main__":
    main()
