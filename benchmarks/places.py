"""What obstacles cost: control of the brawl among walls, compared with the same crowd on open ground.

    python benchmarks/places.py [--walls N] [--half METRES ...] [--runs N] [--threads N] [--seed N] [--json] [--quick]

Walls of 1 to 3 m lie at random in a square of twice ``--half``, none on an avatar. Both crowds run in turns, a run of
each after the other; what counts is the least processor time of the runs. ``hidden_share`` says in how much of the time
the straight way to the opponent that an avatar has chosen leads through a wall.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from typing import Any

import numpy as np
from _quick import command_line, small_policies

from crowdsim import load_policies, load_scenario
from crowdsim.core.types import Array
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.simulation import Simulation
from crowdsim.places.arrays import are_ways_clear
from crowdsim.scenario.scenario import Scenario

SCENE, FRAMES, WARM = "brawl_30", 600, 2
CLEAR = 0.45
"""How far walls are from the positions of avatars at the start [m]."""


def with_walls(scenario: Scenario, crowd: Crowd, count: int, half: float, seed: int) -> Scenario:
    """Return a scenario with some walls in a square."""
    rng = np.random.default_rng(seed)
    starts = np.column_stack([crowd.x, crowd.z])
    walls: list[dict[str, Any]] = []
    while len(walls) < count:
        middle, angle, length = rng.uniform(-half, half, 2), rng.uniform(0.0, math.pi), rng.uniform(0.5, 1.5)
        reach = length * np.array([math.cos(angle), math.sin(angle)])
        along = middle + np.linspace(-1.0, 1.0, 21)[:, None] * reach
        if np.linalg.norm(starts[:, None] - along, axis=-1).min() > CLEAR:
            walls.append({"kind": "wall", "points": [along[0].tolist(), along[-1].tolist()]})
    return load_scenario({**scenario.model_dump(mode="json", exclude_none=True), "obstacles": walls})


def run(crowd: Crowd, frames: int, threads: int) -> tuple[float, Array]:
    """Return what control of a crowd costs per avatar and frame [us], and where it hides opponents. (frames, N)."""
    with Simulation(crowd, threads) as simulation:
        simulation.run(WARM)
        begun = time.process_time()
        chunk = simulation.run(frames - WARM)
        spent = time.process_time() - begun
    other = np.maximum(chunk.opponent, 0)
    here = np.stack([chunk.x, chunk.z], axis=-1).reshape(-1, 2)
    there = np.stack([np.take_along_axis(values, other, axis=1) for values in (chunk.x, chunk.z)], axis=-1)
    hidden = ~are_ways_clear(crowd.parts, here, there.reshape(-1, 2), 0.0).reshape(other.shape)
    return 1e6 * spent / max((frames - WARM) * crowd.count, 1), hidden[chunk.opponent >= 0]


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Return what walls cost in squares of several sizes."""
    frames = 45 if options.quick else FRAMES
    scenario = load_scenario(SCENE, frames=frames)
    policies = load_policies(scenario, None, options.threads)
    plain = draw_crowd(scenario, policies)
    results: dict[str, Any] = {}
    for half in options.half:
        walled = draw_crowd(with_walls(scenario, plain, options.walls, half, options.seed), policies)
        begun = time.perf_counter()
        Simulation(walled, options.threads).close()
        built = time.perf_counter() - begun
        costs: dict[str, list[float]] = {"open": [], "walled": []}
        hidden = np.zeros(0, bool)
        for _ in range(options.runs):
            costs["open"].append(run(plain, frames, options.threads)[0])
            cost, hidden = run(walled, frames, options.threads)
            costs["walled"].append(cost)
        least = {f"{name}_microseconds": min(found) for name, found in costs.items()}
        results[f"square_{2 * half:g}"] = {
            **least,
            "ratio": least["walled_microseconds"] / least["open_microseconds"],
            "hidden_share": float(hidden.mean()) if len(hidden) else None,
            "building_seconds": built,
        }
    return results


def main() -> None:
    parser = command_line("What do obstacles cost?", "seconds: 3 s of the brawl, two runs, a small policy")
    parser.add_argument("--walls", type=int, default=50, help="number of walls")
    parser.add_argument("--half", type=float, nargs="+", default=[6.0, 12.0], help="half the sides of squares [m]")
    parser.add_argument("--runs", type=int, default=12, help="runs of each crowd")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1, help="seed of the walls")
    options = parser.parse_args()
    if options.quick:
        options.runs = min(options.runs, 2)
    with small_policies(wanted=options.quick):
        results = measure(options)
    if options.json:
        print(json.dumps(results, indent=2))
        return
    for name, row in results.items():
        print(
            f"{name} m: {row['open_microseconds']:.3f} us per avatar and frame on open ground, "
            f"{row['walled_microseconds']:.3f} us among {options.walls} walls: {row['ratio']:.2f} times as much; "
            f"opponents hidden {row['hidden_share'] or 0.0:.0%}, built in {row['building_seconds']:.2f} s"
        )


if __name__ == "__main__":
    main()
