"""Delivery of 30 avatars as skinned glTF: time and size of a file, cost of skinning, peak memory.

    python benchmarks/delivery.py [--json] [--quick] [--frames 4000] [--threads 2] [--repeats 3]

Thirty avatars play the embedded boxer's motion, each from another moment. Posing is not counted; everything after it,
to a file under its final name, is, the best of several runs. Building the skin, which happens once in a process, is
stated apart. Peak memory is what Python and numpy allocate while one file is written, poses not counted.
"""

from __future__ import annotations

import argparse
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
from export import AVATARS, FPS, Posed, best_seconds

from crowdsim.body.anatomy import Build
from crowdsim.body.skin import build_skin, pose_skins
from crowdsim.export.gltf import write_gltf


class Crowd(Posed):
    """Poses that are there already, with all that a glTF file says of a take."""

    def __init__(self, frames: int) -> None:
        super().__init__(frames)
        cast = self.take.cast
        cast.girths, cast.types = np.ones(AVATARS, np.float32), np.zeros(AVATARS, np.int16)
        cast.colours, cast.team_names, cast.type_names = np.full((1, 3), np.nan), ("red", "blue"), ("boxer",)
        none = np.zeros(0)
        self.take.events = SimpleNamespace(frame=none, attacker=none)
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


def measure(frames: int, threads: int, repeats: int) -> dict[str, Any]:
    """Return times [s], bytes for an avatar in a frame, and memory [MB]."""
    crowd: Any = Crowd(frames)
    database = crowd.policies[0].database
    start = time.perf_counter()
    skin = build_skin(database.skeleton, database.body, Build())
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
    return outcome


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--frames", type=int, default=4000)
    parser.add_argument("--threads", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="seconds: few frames")
    chosen = parser.parse_args()
    if chosen.quick:
        chosen.frames, chosen.repeats = min(chosen.frames, 60), 1
    outcome = measure(chosen.frames, chosen.threads, chosen.repeats)
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


if __name__ == "__main__":
    main()
