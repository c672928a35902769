"""Runs crowds on the processor and in numba's simulator of GPUs, and prints digests of what they do as JSON.

    NUMBA_ENABLE_CUDASIM=1 python tests/cuda/simulated.py NAME ...

In the simulator threads call the compiled kernels that the processor calls; everything else is what runs with a GPU.
With NUMBA_DISABLE_JIT=1 kernels are plain Python on both sides, which takes seconds for a dozen avatars, and no
compiling.
"""

import dataclasses
import hashlib
import json
import math
import sys
import warnings
from pathlib import Path

import numpy as np
from numba import config

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "crowd")]

from synthetic_policy import policy

from crowdsim.crowd import simulation, stages
from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.cuda import memory
from crowdsim.crowd.cuda import stages as cuda_stages
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.events import VARIABLES
from crowdsim.crowd.kernels.records import CAPSULE, FALL, LINE
from crowdsim.crowd.script import Change, CirclePath, End
from crowdsim.crowd.simulation import Simulation, crowd_model
from crowdsim.crowd.triggers import AtFrame, Landed
from crowdsim.preparation.prepare import load_policies
from crowdsim.scenario.scenario import load_scenario

RULES = np.array([[60.0, 20.0, 0.5, 0.1, 5.0, 9.0, 6.0, 2.0, 0.01, 0.01, 0.005, 0.0]])
"""Strikes hurt, tire, throw off their feet and knock down; see ``records.RULE``."""


def scattered(count=12, frames=16, **fields):
    """Return a crowd of boxers with small policies."""
    rng = np.random.default_rng(count)
    fields = {"policies": [policy(0)], "seed": 1, "variety": 1.0, "interval": 6.0, **fields}
    x, z = rng.uniform(0, 0.6 * math.sqrt(count), (2, count))
    return build_crowd(x, z, rng.uniform(-3, 3, count), frames=frames, **fields)


def armies():
    """Return two armies that are a kilometre apart."""
    team = np.arange(40) % 2
    crowd = scattered(40, 6, team=team)
    return dataclasses.replace(crowd, x=crowd.x + 1000.0 * team)


def entering():
    """Return a crowd of which some enter, and others leave, at a time or after strikes."""
    crowd, numbers = scattered(14), np.arange(14)
    return dataclasses.replace(
        crowd,
        present=numbers < 9,
        changes=(
            Change(AtFrame(3), who=numbers == 10, present=True),
            Change(Landed(2), who=numbers == 2, present=False),
            Change(AtFrame(6), who=numbers > 10, present=True),
            Change(AtFrame(9), temperatures=np.array([2.0])),
        ),
        until=End("landed", count=1000),
    )


def model_with_falls(crowd):
    """Return the model of a crowd with falls and staggers that are made of its actions."""
    model = crowd_model(crowd)
    rows = [(turn, 0, kind, 4 * fall + kind, 4 * fall) for fall, turn in enumerate((0.0, math.pi)) for kind in range(4)]
    return model._replace(
        falls=np.array([(*row, row[4]) for row in rows], FALL),
        fall_axes=np.zeros((len(rows), 2), LINE),
        fall_capsules=np.zeros((len(rows), 0), CAPSULE),
        soles=np.zeros((len(model.ground), 2, 2, 3), np.float32),
    )


def shipped(name, *overrides, fraction=None):
    """Return the crowd of a shipped scenario, or of a share of its avatars."""
    scenario = load_scenario(name, overrides, frames="40", fraction=fraction)
    return draw_crowd(scenario, load_policies(scenario))


CROWDS = {
    "scattered": scattered,
    "crowded": lambda: scattered(45, 6, scale=np.linspace(0.9, 1.1, 45), speed=np.linspace(0.8, 1.2, 45)),
    "armies": armies,
    "alone": lambda: scattered(1),
    "targets": lambda: scattered(
        6, skip=np.full(6, -2), fixed=np.full(6, -2), targets=(CirclePath(2.0, 1.0, (1.0, 1.0), 1.5),)
    ),
    "pre_roll": lambda: dataclasses.replace(scattered(8, 8), pre_roll=3),
    "entering": entering,
    "hurt": lambda: scattered(rules=RULES, conditioned=True),
    "falling": lambda: scattered(rules=RULES, conditioned=True),
    "unhurt": lambda: scattered(20, 30),
    "thrown": lambda: scattered(20, 30),
    "crowd_1m": lambda: shipped("crowd_1m", "groups[0].placement.radius=8", fraction=1e-4),
    "duel": lambda: shipped("duel"),
    "moving_target": lambda: shipped("moving_target"),
    "armies_200": lambda: shipped("armies_200", fraction=0.3),
    "brawl_last_standing": lambda: shipped("brawl_last_standing"),
}


def digests(crowd, model, devices):
    """Return digests of every variable and of the state at the end of a run, whose halves are done by two devices."""
    chunks, state, half = [], None, crowd.frames // 2
    for device, frames in zip(devices, (half, crowd.frames), strict=True):
        with Simulation(crowd, model=model, device=device, search=SEARCH) as one:
            if state is not None:
                one.restore(state)
            chunks.append(one.run(frames))
            state = one.state()
    parts = {name: [getattr(chunk, name) for chunk in chunks] for name in VARIABLES}
    events = [vars(chunk.events) for chunk in chunks]
    parts |= {f"events.{name}": [one[name] for one in events] for name in events[0]}
    parts |= {f"state.{name}": [values] for name, values in state.items()}
    return {
        "frames": sum(chunk.frames for chunk in chunks),
        "strikes": sum(len(one["frame"]) for one in events),
        "knock_downs": int(sum(one["down"].sum() for one in events)),
        "digests": {
            name: hashlib.sha256(np.concatenate([np.atleast_1d(one) for one in values]).tobytes()).hexdigest()
            for name, values in parts.items()
        },
    }


def with_names(parts):
    """Return named tuples whose records have their fields as attributes, as in compiled code."""
    if isinstance(parts, tuple):
        named = [with_names(part) for part in parts]
        return type(parts)(*named) if hasattr(parts, "_fields") else tuple(named)
    return parts.view(np.recarray) if isinstance(parts, np.ndarray) and parts.dtype.names else parts


def run_plain_kernels():
    """Let kernels that are not compiled get what they would get in compiled code."""
    warnings.simplefilter("ignore")

    def names(module, function):
        found = getattr(module, function)
        setattr(module, function, lambda *values: with_names(found(*map(with_names, values))))

    for module in [one for name, one in sys.modules.items() if name.startswith("crowdsim.")]:
        if hasattr(module, "prefetch") and not hasattr(module.prefetch, "__path__"):
            module.prefetch = lambda array, index: None
    copy = memory.to_device
    memory.to_device = cuda_stages.to_device = lambda values: with_names(copy(values))
    for module in (simulation, stages, cuda_stages):
        for function in ("empty_strikes", "empty_scratch", "crowd_model", "build_avatars", "build_places", "records"):
            if hasattr(module, function):
                names(module, function)
    for function in ("resolve", "list_thrown", "stagger", "knock_down", "empty_room"):
        names(stages, function)


SEARCH = "auto"
if config.DISABLE_JIT:
    SEARCH = "kd_tree"
    run_plain_kernels()


def main(names):
    """Print what each crowd does on the processor, in the simulator, and where it changes from one to the other."""
    found = {}
    for name in names:
        crowd = CROWDS[name]()
        model = model_with_falls(crowd) if name in ("falling", "thrown") else simulation.crowd_model(crowd)
        pairs = [("cpu", "cpu"), ("cuda", "cuda"), ("cpu", "cuda"), ("cuda", "cpu")]
        model = with_names(model) if config.DISABLE_JIT else model
        found[name] = {", ".join(pair): digests(crowd, model, pair) for pair in pairs}
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1:])
