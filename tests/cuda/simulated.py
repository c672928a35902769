"""Runs crowds on the processor and in numba's simulator of GPUs, and prints a digest of each as JSON.

    NUMBA_ENABLE_CUDASIM=1 python tests/cuda/simulated.py NAME ...

In the simulator, threads call the same compiled kernels as the processor does; everything else is what runs on a GPU.
"""

import dataclasses
import hashlib
import json
import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "crowd"))
sys.path.append(str(Path(__file__).parents[1]))

from synthetic_policy import policy

from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.events import VARIABLES
from crowdsim.crowd.script import CirclePath
from crowdsim.crowd.simulation import Simulation
from crowdsim.preparation.prepare import load_policies
from crowdsim.scenario.scenario import load_scenario

FRAMES = 40


def scattered(count=40, **fields):
    """Return a crowd of boxers with small policies."""
    rng = np.random.default_rng(count)
    fields = {"policies": [policy(0)], "seed": 1, "variety": 1.0, "interval": 6.0, **fields}
    side = 0.7 * np.sqrt(count)
    x, z = rng.uniform(0, side, (2, count))
    return build_crowd(x, z, rng.uniform(-3, 3, count), frames=FRAMES, **fields)


def shipped(name, *overrides, fraction=None):
    """Return the crowd of a shipped scenario, or of a share of its avatars."""
    scenario = load_scenario(name, overrides, frames=str(FRAMES), fraction=fraction)
    return draw_crowd(scenario, load_policies(scenario))


def armies():
    """Return two armies that are a kilometre apart."""
    crowd = scattered(40, team=np.arange(40) % 2)
    return dataclasses.replace(crowd, x=crowd.x + 1000.0 * (np.arange(40) % 2))


CROWDS = {
    "scattered": scattered,
    "crowded": lambda: scattered(90, scale=np.linspace(0.9, 1.1, 90), speed=np.linspace(0.8, 1.2, 90)),
    "armies": armies,
    "one": lambda: scattered(1),
    "targets": lambda: scattered(
        12, skip=np.full(12, -2), fixed=np.full(12, -2), targets=(CirclePath(2.0, 1.0, (1.0, 1.0), 1.5),)
    ),
    "crowd_1m": lambda: shipped("crowd_1m", "groups[0].placement.radius=8", fraction=1e-4),
    "duel": lambda: shipped("duel"),
    "moving_target": lambda: shipped("moving_target"),
    "armies_200": lambda: shipped("armies_200", fraction=0.3),
    "brawl_last_standing": lambda: shipped("brawl_last_standing"),
}


def digests(crowd, device, resumed=False):
    """Return the digest of every variable of a run, which may change its device half-way."""
    total = {}
    strikes = 0
    with Simulation(crowd, device=device) as simulation:
        chunks = [simulation.run(FRAMES // 2)]
        state = simulation.state() if resumed else None
        chunks += [] if resumed else [simulation.run(FRAMES)]
    if resumed:
        with Simulation(crowd, device="cpu" if device == "cuda" else "cuda") as simulation:
            simulation.restore(state)
            chunks.append(simulation.run(FRAMES))
    for name in VARIABLES:
        whole = np.concatenate([getattr(chunk, name) for chunk in chunks])
        total[name] = hashlib.sha256(whole.tobytes()).hexdigest()
    for field in dataclasses.fields(chunks[0].events):
        whole = np.concatenate([getattr(chunk.events, field.name) for chunk in chunks])
        total[f"events.{field.name}"] = hashlib.sha256(whole.tobytes()).hexdigest()
        strikes = len(whole)
    return {"frames": sum(chunk.frames for chunk in chunks), "strikes": strikes, "digests": total}


def main(names):
    """Print what each crowd does on both devices, and where it changes from one to the other."""
    found = {}
    for name in names:
        crowd = CROWDS[name]()
        found[name] = {
            "cpu": digests(crowd, "cpu"),
            "cuda": digests(crowd, "cuda"),
            "cuda, then cpu": digests(crowd, "cuda", True),
            "cpu, then cuda": digests(crowd, "cpu", True),
        }
        print(name, "done", file=sys.stderr)
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1:])
