"""The effect of blows in whole brawls and bouts with several seeds, from BVH files and takes.

    python benchmarks/blows.py [--seeds N] [--json] [--quick]

`brawl_30` and `bout` are run as they ship, once for each seed from 1 on, with BVH files as their only output, and
measured by the witness of ``exported.py``, which shares no code with the package that poses and writes: `fists`,
`strikes` and `blows`. Every strike counts except those in the last second of a run. Each figure is the mean of the
seeds, followed by the worst seed. Asterisks mark a mean that misses its goal; for the greatest distance, the worst seed
decides.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from _exported.arms import measure_strikes
from _exported.blows import measure_blows
from _exported.capsules import find_contacts
from _exported.contact import fists
from _exported.goals import MEASURES, Measure, find, shown
from _exported.scenes import open_exported, run_scene
from _quick import command_line, small_policies

SCENES = ("brawl_30", "bout")
SEEDS, FPS = 5, 60
"""Seeds of each scene, from 1 on, and frames a second of the files."""
QUICK, FEW = 210, 10
"""Control frames and avatars of a quick run."""
GOALS = tuple(one for one in MEASURES if one.keys[0] in ("fists", "strikes", "blows") and one.goal(""))
"""What is measured: what has a goal."""


def key(measure: Measure) -> str:
    """Return the name of a figure in the results."""
    return "_".join(measure.keys)


def measure_run(name: str, seed: int, folder: Path, quick: bool) -> dict[str, float | None]:
    """Return the figures of a scene with one seed, by their names."""
    frames, most = (QUICK, FEW) if quick else (None, None)
    path = run_scene(name, FPS, frames, folder, None, most, seed)
    run = open_exported(path, None, folder, None)
    results = {"fists": fists(run), "strikes": measure_strikes(run, find_contacts(run)), "blows": measure_blows(run)}
    shutil.rmtree(path)
    return {key(one): find(results, one.keys) for one in GOALS}


def summarise(measure: Measure, seeds: list[dict[str, float | None]]) -> dict[str, float | None]:
    """Return the mean of a figure over seeds, and the worst; None where no seed has one."""
    found = [value for one in seeds if (value := one[key(measure)]) is not None]
    worst = max if measure.most is not None else min
    return {"mean": float(np.mean(found)) if found else None, "worst": worst(found, default=None)}


def is_met(measure: Measure, scene: str, mean: float | None, worst: float | None) -> bool:
    """Return whether a figure meets its goal: its mean, or the worst of what is the greatest of a run."""
    return measure.met(scene, worst if measure.keys[-1] == "greatest" else mean, None)


def main() -> None:
    """Read the command line, measure and print."""
    parser = command_line(__doc__, f"seconds: 1 seed, {FEW} avatars, {QUICK} control frames, small policies")
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"seeds of each scene, {SEEDS} by default")
    options = parser.parse_args()
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, small_policies(wanted=options.quick):
        for name in SCENES:
            seeds = []
            for seed in range(1, 2 if options.quick else options.seeds + 1):
                print(f"{name}, seed {seed} ...", file=sys.stderr, flush=True)
                seeds.append(measure_run(name, seed, Path(folder), options.quick))
            results[name] = {key(one): summarise(one, seeds) for one in GOALS}
    if options.json:
        print(json.dumps(results, indent=2))
        return
    for name, figures in results.items():
        print(f"{name}: mean and worst of the seeds, goal")
        for one in GOALS:
            mean, worst = (figures[key(one)][which] for which in ("mean", "worst"))
            text = shown(mean, one.unit) if is_met(one, name, mean, worst) else f"*{shown(mean, one.unit)}*"
            print(f"  {one.label:100} {text:>10} {shown(worst, one.unit):>10}   {one.goal(name)}")


if __name__ == "__main__":
    main()
