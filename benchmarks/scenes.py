"""The shipped scenes as wholes: who comes close, who lands strikes, and when. Control only, nothing is written.

    python benchmarks/scenes.py [--scene NAME ...] [--seeds N] [--policy NAME] [--threads N] [--mocap DIR] [--json]
                                [--quick]

The figures are those of ``crowdsim inspect RUN`` (``crowdsim.take.measures``): the worst of the seeds, and the mean.
Positions are measured from 10 s on; `armies_200` is measured for the first 20 s after the armies meet, 2 s
after the start. Large crowds run for 25 s, longer than their
scenarios, so that stuck avatars show, `crowd_100k` with three seeds and `crowd_1m` with one.

Beside the shipped scenarios there is a ring: 40 boxers at random headings, 2, 3, 4, 8 or 12 m away from a still
target, for 25 s (`ring_2` ... `ring_12`; `ring` names all). Collision avoidance is off, so each boxer is an
independent trial, and `overlap_share` means nothing. The ring also has:

* arrived_share: avatars that come within 1 m of the target.
* arrived_in_time_share: those within 1.3 m after 1.5 s plus the distance at 1.2 m/s.
* arrival_seconds: median time until an avatar is within 1.3 m.

Scenes with obstacles have pelvis_outside_share and feet_outside_share, the shares of time in which pelvises and feet
are in obstacles or beyond them, and slide_share, the share of frames in which a root slides along them.
`duel` and the moving targets also have within_share, the share of time within 1.3 m of the opponent after 8 s.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from _quick import command_line, small_policies
from _scene_goals import GOALS, summarise
from _scene_obstacles import OutsideCounter

from crowdsim import load_policies, load_scenario
from crowdsim.core.workers import CORES
from crowdsim.crowd.chunk import Chunk
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.simulate import simulate
from crowdsim.scenario.scenario import Scenario, resolve_scenario
from crowdsim.take.measures import AFTER, FightCounter, opponent_offsets

SHIPPED = Path(__file__).resolve().parent.parent / "scenarios"
SEEDS = 5
MOST_SEEDS = {"crowd_100k": 3, "crowd_1m": 1}
LENGTHS = {"armies_200": 330, "crowd_10k": 375, "crowd_100k": 375, "crowd_1m": 375}
AFTERS = {"armies_200": 2.0}
NEAR = ("duel", "moving_target", "moving_target_fast")
RING_RADII = (2, 3, 4, 8, 12)
RING_COUNT, RING_SECONDS = 40, 25.0

WITHIN, WITHIN_AFTER = 1.3, 8.0
"""Within reach of an opponent [m], and from when on [s]."""
ARRIVED = 1.0
"""How near the target an avatar has arrived [m]."""
DELAY, PACE = 1.5, 1.2
"""Time to turn round [s] and speed [m/s] of an avatar that arrives in time."""


@dataclass(frozen=True)
class Scene:
    """A scenario and how it is measured.

    Attributes:
        name: Name of the scene.
        scenario: The scenario.
        after: Time from which positions are measured [s].
        seeds: Number of seeds.
        radius: Distance of the target at the start in a ring [m]; 0 in other scenes.
    """

    name: str
    scenario: Scenario
    after: float
    seeds: int
    radius: float = 0.0


def ring(radius: float, count: int, policy: str) -> Scenario:
    """Return the scenario of a ring of boxers around a still target."""
    return resolve_scenario(
        Scenario.model_validate(
            {
                "version": 1,
                "name": f"ring_{radius:g}",
                "duration": {"seconds": RING_SECONDS},
                "types": {"boxer": {"policy": policy}},
                "groups": [
                    {
                        "name": "boxers",
                        "type": "boxer",
                        "count": count,
                        "placement": {"kind": "ring", "radius": radius, "distance": 0.1},
                        "facing": "random",
                    }
                ],
                "opponents": {"kind": "target", "target": "head"},
                "targets": {"head": {"kind": "points", "points": [[0, 0]], "height": 1.55}},
                "collision_avoidance": False,
            }
        )
    )


def names() -> list[str]:
    """Names of the scenes."""
    return [*(f"ring_{radius}" for radius in RING_RADII), *sorted(path.stem for path in SHIPPED.glob("*.yaml"))]


def build_scene(name: str, seeds: int, policy: str | None, quick: bool) -> Scene:
    """Return a scene; ``policy`` stands in for its own."""
    radius = float(name.removeprefix("ring_")) if name.startswith("ring_") else 0.0
    after = AFTERS.get(name, AFTER)
    if radius:
        scenario = ring(radius, 6 if quick else RING_COUNT, policy or "boxer")
    else:
        path = SHIPPED / f"{name}.yaml"
        count = load_scenario(path).avatar_count
        fraction = min(1.0, 30 / count) if quick else None
        scenario = load_scenario(path, frames=LENGTHS.get(name), fraction=fraction)
        if policy is not None:
            # Another policy may have learned other behaviours: its recipe weighs them.
            change = {"policy": policy, "behaviours": {}}
            types = {key: kind.model_copy(update=change) for key, kind in scenario.types.items()}
            scenario = scenario.model_copy(update={"types": types})
    if quick:
        scenario, after, seeds = scenario.model_copy(update={"duration": 45}), after / 10.0, min(seeds, 2)
    return Scene(name, scenario, after, min(seeds, MOST_SEEDS.get(name, seeds)), radius)


def play(
    scene: Scene, seed: int, policies: Sequence[Any], threads: int, seen: Callable[[Chunk], None] | None = None
) -> dict[str, float | None]:
    """Return the figures of a scene with one seed; ``seen`` is called with every chunk."""
    scenario = scene.scenario.model_copy(update={"seed": seed})
    crowd = draw_crowd(scenario, policies)
    rate = crowd.rate
    counter = FightCounter(crowd.cast, crowd.policies, rate, crowd.frames, scene.after)
    outside = OutsideCounter(crowd) if len(crowd.parts) else None
    near = bool(scene.radius) or scene.name in NEAR
    distances = []
    for chunk in simulate(crowd, crowd.frames, threads):
        counter.add(chunk)
        if outside is not None:
            outside.add(chunk)
        if seen is not None:
            seen(chunk)
        if near:
            dx, dz, known = opponent_offsets(chunk)
            distances.append(np.where(known, np.hypot(dx, dz), np.inf))
    outcome: dict[str, float | None] = {"seed": seed, **asdict(counter.finish())}
    if outside is not None:
        outcome.update(outside.finish())
    if scene.radius:
        outcome.update(arrivals(np.concatenate(distances), rate, scene.radius))
    elif near:
        # A quick run is over before 8 s.
        late = np.concatenate(distances)[math.ceil(min(WITHIN_AFTER, scene.after) * rate) :]
        outcome["within_share"] = float((late <= WITHIN).mean()) if late.size else None
    return outcome


def arrivals(distances: np.ndarray, rate: float, radius: float) -> dict[str, float | None]:
    """Return when avatars of a ring come within reach of the target; distances (F, N) [m]."""
    within = distances <= WITHIN
    first = np.where(within.any(axis=0), within.argmax(axis=0) / rate, np.inf)
    median = float(np.median(first))
    return {
        "arrived_share": float((distances <= ARRIVED).any(axis=0).mean()),
        "arrived_in_time_share": float((first <= DELAY + radius / PACE).mean()),
        "arrival_seconds": median if math.isfinite(median) else None,
    }


def table(scene: Scene, outcome: dict[str, Any]) -> Iterator[str]:
    """Yield the figures of a scene, a line each."""
    yield (
        f"{scene.name}: {outcome['avatars']:,} avatars, {outcome['control_frames']} control frames, "
        f"{outcome['seed_count']} seeds, positions from {scene.after:g} s on; took {outcome['wall_seconds']:.1f} s"
    )
    yield f"  {'':<26}{'worst':>10}{'mean':>10}   goal"
    goals = GOALS.get(scene.name, {})
    for key, mean in outcome["mean"].items():
        values = ("none" if value is None else f"{value:.4g}" for value in (outcome[key], mean))
        verdict = "" if key not in goals else f"{goals[key]!s}{'   MISSED' if key in outcome['missed'] else ''}"
        yield f"  {key:<26}{next(values):>10}{next(values):>10}   {verdict}".rstrip()


def measure(chosen: Sequence[str], options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of scenes by their names, and print them as they come unless JSON is asked for."""
    results: dict[str, Any] = {}
    loaded: dict[tuple[str, ...], list[Any]] = {}
    for name in chosen:
        if name.endswith("cmu") and options.mocap is None and options.policy is None and not options.quick:
            print(f"{name}: left out, it needs --mocap or CROWDSIM_MOCAP", file=sys.stderr)
            continue
        scene = build_scene(name, options.seeds, options.policy, options.quick)
        used = tuple(kind.policy for kind in scene.scenario.types.values())
        if used not in loaded:
            loaded[used] = load_policies(scene.scenario, options.mocap, options.threads)
        begun = time.perf_counter()
        seeds = [play(scene, seed, loaded[used], options.threads) for seed in range(1, scene.seeds + 1)]
        rate = float(loaded[used][0].database.control_rate)
        results[name] = {
            **summarise(name, seeds),
            "avatars": scene.scenario.avatar_count,
            "control_frames": scene.scenario.control_frames(rate),
            "seed_count": len(seeds),
            "wall_seconds": time.perf_counter() - begun,
            "seeds": seeds,
        }
        if not options.json:
            print("\n".join(table(scene, results[name])), flush=True)
    return results


def main() -> None:
    parser = command_line(
        "Do the shipped scenes show fights?", "seconds: tiny crowds, 3 s each, two seeds, small policies"
    )
    parser.add_argument("--scene", action="extend", nargs="+", help=f"of ring, {', '.join(names())}; all by default")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="number of seeds, from 1 on")
    parser.add_argument("--policy", help="policy that stands in for those of all scenes")
    parser.add_argument("--threads", type=int, default=min(2, CORES))
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder of capture")
    options = parser.parse_args()
    asked = options.scene or names()
    unknown = [name for name in asked if name not in (*names(), "ring")]
    if unknown:
        parser.error(f"no scene {unknown[0]!r}, there are ring, {', '.join(names())}")
    if options.seeds < 1:
        parser.error(f"the number of seeds is {options.seeds}, expected 1 or more")
    chosen = [name for name in names() if name in asked or ("ring" in asked and name.startswith("ring_"))]
    with small_policies(wanted=options.quick and options.policy is None):
        results = measure(chosen, options)
    if options.json:
        print(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
