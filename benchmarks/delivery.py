"""Delivery of 30 avatars as skinned glTF: time and size of a file, cost of skinning, peak memory.

    python benchmarks/delivery.py [--json] [--quick] [--frames 4000] [--threads 2] [--repeats 3]

Thirty avatars play the embedded boxer's motion, each from another moment. Posing is not counted; everything after it,
to a file under its final name, is, the best of several runs. Building the skin, which happens once in a process, is
stated apart. Peak memory is what Python and numpy allocate while one file is written, poses not counted.

``whole``: a run of ``brawl_30`` at 60 frames a second with rotations as int16, with all that an export holds: strikes,
paints, and a camera that comes along: once ``auto``, once ``eye``, which has a key in every frame.

``clips``: a bank of clips and tracks of ``brawl_30`` at 30 frames a second, everything after the run counted.

``touches``: how deep hands are in the skin that they hit, at the moments of strikes that land: the share whose deepest
point is within 2 cm of trunk, head or upper arms, where such fists stop, on either side, and the median depth [cm];
with gloves, and of bare fists. Keys that end in ``arms`` are likewise of all skin, forearms and hands included.
"""

from __future__ import annotations

import json
import os
import tempfile
import time
import tracemalloc
from dataclasses import replace
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
from crowdsim.core.types import Array
from crowdsim.crowd.cast import USUAL_BODY
from crowdsim.export.clips import write_clips
from crowdsim.export.gltf import write_gltf
from crowdsim.export.posed import write_posed
from crowdsim.outputs.glb import GlbOutput
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


def whole(sampler: Any, camera: str) -> float:
    """Return the bytes for an avatar in a frame of an export of a run, with a camera."""
    with tempfile.TemporaryDirectory() as name:
        output = GlbOutput(fps=FPS, rotations="int16", camera=camera)
        size = write_posed(sampler, Path(name), [output])["glb"][0].stat().st_size
    return size / (sampler.take.avatar_count * sampler.take.output_frames(float(FPS)))


def clips(sampler: Any, repeats: int) -> dict[str, float]:
    """Return how long a bank of clips and tracks takes [s], and how large its files are [MB]."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = write_clips(sampler, folder, 30)
        seconds = best_seconds(partial(write_clips, sampler, folder, 30), repeats)
        sizes = {path.name: path.stat().st_size / 1e6 for path in files}
    return {"seconds": seconds, "frames": sampler.take.output_frames(30.0), **sizes}


def touches(sampler: Any, most: int) -> dict[str, float | None]:
    """Return how deep hands are in skins at strikes that land, of so many at the most."""
    take = sampler.take
    strikes = take.strikes(outcome="landed")
    strikes = strikes[(strikes["victim"] >= 0) & np.char.endswith(strikes["limb"].astype(str), "hand")]
    strikes = strikes[:: max(1, len(strikes) // most)]
    found: dict[str, float | None] = {"strikes": len(strikes)}
    for name, hands in (("", "gloves"), (" bare", "bare")):
        bodies = tuple((sex, hands) for sex, _ in take.cast.bodies)
        posed = PoseSampler(replace(take, cast=replace(take.cast, bodies=bodies)), sampler.policies)
        depths = np.array([hand_depths(posed, strike) for strike in strikes]).reshape(-1, 2)
        for part, values in zip(("", " arms"), depths.T, strict=True):
            found[f"within 2 cm{name}{part}"] = float((np.abs(values) <= 2.0).mean()) if len(values) else None
            found[f"median cm{name}{part}"] = float(np.median(values)) if len(values) else None
    return found


def hand_depths(sampler: Any, strike: Any) -> tuple[float, float]:
    """Return how deep the hand of a strike is in its victim without forearms and hands, and in all of its skin [cm]."""
    body, skin, vertices = posed_skin(sampler, int(strike["attacker"]), strike["seconds"])
    struck, other, theirs = posed_skin(sampler, int(strike["victim"]), strike["seconds"])
    hand = body.roles[f"{strike['limb'].split('_')[0]}_hand"]
    roles = [f"{side}_{role}" for side in ("left", "right") for role in ("elbow", "hand")]
    arms = np.append(np.zeros(len(other.parents), bool), np.isin(other.helpers, [struck.roles[role] for role in roles]))
    for joint, parent in enumerate(other.parents):
        arms[joint] = joint in [struck.roles[role] for role in roles[::2]] or (parent >= 0 and arms[parent])
    of_arms = arms[carriers(other)][other.triangles].any(axis=1)
    points, corners = vertices[carriers(skin) == hand], theirs[other.triangles]
    depths, nearest = depths_in(points, corners)
    apart, _ = depths_in(points, corners[~of_arms])
    trunk = np.where(of_arms[nearest], -np.abs(apart), depths)
    return 100.0 * float(trunk.max()), 100.0 * float(depths.max())


def carriers(skin: Any) -> Array:
    """Return the joint or helper that each vertex of a skin follows most. Shape (V,)."""
    return np.asarray(skin.joints[np.arange(len(skin.joints)), np.argmax(skin.weights, axis=1)])


def posed_skin(sampler: Any, avatar: int, seconds: float) -> tuple[Any, Any, Array]:
    """Return the body of an avatar, its skin, and the vertices of that at a time [m]."""
    take = sampler.take
    ((_, body, sizes, places, turned),) = sampler.moments(np.array([avatar]), np.array([seconds]))
    policy, girth = int(take.cast.policies[avatar]), float(take.cast.girths[avatar])
    lengths = take.cast.stretches[avatar][sampler.motions[policy].segments].astype(float)
    skin = build_skin_of(sampler.policies[policy].database, build_of(take.cast, avatar)).shaped(girth, lengths)
    (vertices,), _ = pose_skins([skin], skin.matrices(places, turned, sizes))
    return body, skin, vertices.astype(float)


def depths_in(points: Array, corners: Array, near: int = 24) -> tuple[Array, Array]:
    """Return how deep points are in a surface, negative outside [m], and the nearest triangle of each. Shape (n,).

    Args:
        points: The points [m]. Shape (n, 3).
        corners: Corners of the surface's triangles, counter-clockwise from outside [m]. Shape (F, 3, 3).
        near: How many triangles each point is compared with, those whose middles are nearest.
    """
    from scipy.spatial import cKDTree
    from trimesh.triangles import closest_point

    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    some = cKDTree(corners.mean(axis=1)).query(points, k=near)[1]
    repeated = np.repeat(points, near, axis=0)
    away = (repeated - closest_point(corners[some.ravel()], repeated)).reshape(len(points), near, 3)
    far = np.linalg.norm(away, axis=2)
    # At an edge the side is that of the triangle that faces the point most.
    sides = np.where(far < far.min(axis=1, keepdims=True) + 1e-9, np.sum(away * normals[some], axis=2), 0.0)
    best, rows = np.argmax(np.abs(sides), axis=1), np.arange(len(points))
    return np.where(sides[rows, best] >= 0.0, -1.0, 1.0) * far.min(axis=1), some[rows, best]


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
    outcome["whole"] = {
        "bytes an avatar-frame": whole(sampler, "auto"),
        "bytes an avatar-frame eye": whole(sampler, "eye"),
    }
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
        outcome = measure(chosen.frames, chosen.threads, chosen.repeats, 90 if chosen.quick else None)
    if chosen.json:
        print(json.dumps({**vars(chosen), **outcome}, indent=2))
        return
    print(f"glTF, {AVATARS} avatars x {chosen.frames} frames, {chosen.threads} threads")
    for rotations in ("float32", "int16"):
        row = outcome[rotations]
        print(f"  {rotations:<10}{row['seconds']:>7.2f} s{row['megabytes']:>8.1f} MB"
              f"{row['bytes an avatar-frame']:>8.1f} bytes an avatar-frame")  # fmt: skip
    with_auto, with_eye = outcome["whole"].values()
    print(f"  brawl_30 with a camera, int16: {with_auto:.2f} bytes an avatar-frame, {with_eye:.2f} with eye")
    print(f"  {outcome['triangles']} triangles, built in {outcome['build seconds']:.1f} s")
    print(f"  {AVATARS} skinned on one thread in {outcome['skinning milliseconds']:.1f} ms")
    print(f"  at most {outcome['peak megabytes']:.0f} MB of memory while writing")
    found = outcome["clips"]
    sizes = ", ".join(f"{name} {size:.1f} MB" for name, size in found.items() if "." in name)
    print(f"clips, brawl_30, {found['frames']:.0f} frames at 30 a second: {found['seconds']:.2f} s, {sizes}")
    found = outcome["touches"]
    if found["strikes"]:
        for name, hands in (("", "gloves"), (" bare", "bare fists")):
            print(f"{hands} within 2 cm of the skin at {100 * found[f'within 2 cm{name}']:.1f} % of {found['strikes']} "
                  f"landed strikes, in the median {found[f'median cm{name}']:.1f} cm in it; arms of whom they hit "
                  f"included {100 * found[f'within 2 cm{name} arms']:.1f} %, {found[f'median cm{name} arms']:.1f} cm"
            )  # fmt: skip


if __name__ == "__main__":
    main()
