"""How far layers of poses move bodies of a large crowd: what pictures leave out of avatars that are far away.

    python benchmarks/layers.py [--json] [--quick] [--fraction SHARE]

Avatars of ``crowd_10k`` are posed at some moments whole, without each layer that pictures may leave out, and without
all those that move bodies by so little. The figures are of the furthest that a joint of an avatar moves, over all
avatars and moments: of 99 of 100, of 999 of 1000, and the greatest; ``said`` is what the layer says of 99 of 100, or
for several of them the most that one says [m].
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from _quick import command_line, small_policies
from tqdm import tqdm

from crowdsim.core.types import Array
from crowdsim.poses.layer import reading_of, times_of
from crowdsim.poses.layers import LAYERS
from crowdsim.poses.sampler import PoseSampler
from crowdsim.runs.recorded import RecordedRun
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario

SCENE, FRAMES, FPS = "crowd_10k", 181, 30.0
MOMENTS = (30, 200, 330)
"""Output frames that are posed."""
QUICK = 0.01
"""Share of the crowd with ``--quick``."""


def left_out() -> Iterator[tuple[str, float, frozenset[str]]]:
    """Yield what may be left out: a title, what is said of it [m], and the names to leave out.

    First each layer, or part of one, from the least that one says; then all that say no more than that together.
    """
    said = {kind.name: kind.size for kind in LAYERS}
    said |= {reading_of(kind.name): kind.reading for kind in LAYERS}
    said |= {times_of(kind.name): kind.sparse for kind in LAYERS}
    said = {name: size for name, size in sorted(said.items(), key=lambda one: one[1]) if size < math.inf}
    for name, size in said.items():
        yield name, size, frozenset([name])
    for size in sorted(set(said.values())):
        yield f"all up to {100 * size:.0f} cm", size, frozenset(name for name, one in said.items() if one <= size)


def joints(ran: RecordedRun, without: frozenset[str]) -> Array:
    """Return the joints of all avatars at all moments. Shape (M * N, J, 3) [m]."""
    sampler = PoseSampler(ran, ran.policies, threads=2)
    return np.concatenate([
        poses.joints()[0][0] for moment in MOMENTS for poses in sampler.sample(moment, moment + 1, FPS, None, without)
    ])  # fmt: skip


def measure(fraction: float) -> dict[str, Any]:
    """Return how far what is left out moves bodies of a share of the crowd, by title."""
    scenario = load_scenario(SCENE, frames=FRAMES, fraction=fraction)
    ran = run(scenario, threads=2)
    whole, outcome = joints(ran, frozenset()), {}
    for title, said, names in tqdm(list(left_out()), desc="layers", unit="layer"):
        moved = np.linalg.norm(joints(ran, names) - whole, axis=-1).max(axis=-1)
        there = moved[np.isfinite(moved)]
        p99, p999 = np.percentile(there, [99.0, 99.9])
        outcome[title] = {"said": said, "p99": float(p99), "p99_9": float(p999), "greatest": float(there.max())}
    return {"avatars": len(whole) // len(MOMENTS), "layers": outcome}


def main() -> None:
    parser = command_line(__doc__, "seconds: a hundredth of the crowd, small policies")
    parser.add_argument("--fraction", type=float, default=1.0, help="share of the crowd")
    options = parser.parse_args()
    fraction = QUICK if options.quick else options.fraction
    with small_policies(wanted=options.quick):
        outcome = measure(fraction)
    if options.json:
        print(json.dumps(outcome, indent=2))
        return
    print(f"{outcome['avatars']} avatars at {len(MOMENTS)} moments; furthest that a joint moves [cm]")
    for title, row in outcome["layers"].items():
        figures = ", ".join(f"{key} {100 * value:.1f}" for key, value in row.items())
        print(f"  {title:<24} {figures}")


if __name__ == "__main__":
    main()
