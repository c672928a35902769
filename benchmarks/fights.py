"""Strikes landed in the shipped brawls with learned actions, beside avatars with random actions.

    python benchmarks/fights.py [--mocap DIR] [--json] [--quick]

`strict` is what runs report: at the strike's frame the fist is within 10 cm of the surface of the opponent's head or
torso at that time. `generous` asks for less: the fist comes within 25 cm of a point 1.15 m above the opponent's
position at the attacker's decision. Both are strikes per avatar per minute.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from _quick import small_policies

from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.take import Take

SCENES = ("brawl_30", "brawl_30_cmu")
DRAWN = ["types.boxer.temperature=100", "types.boxer.candidates={margin: 100, maximum: 64}"]
QUICK: dict[str, Any] = {"frames": 120, "fraction": 0.2}
"""What is run of a scenario with ``--quick``."""
HEIGHT, NEAR = 1.15, 0.25
"""The point's height, and how near the fist must come [m]."""


def decided(take: Take) -> np.ndarray:
    """Return the frame in which the action that each avatar does was chosen. Shape (frames, N)."""
    fresh = np.ones(take.action.shape, bool)
    fresh[1:] = (np.diff(take.action, axis=0) != 0) | (np.diff(take.action_frame, axis=0) < 0.0)
    frames = np.arange(len(fresh))[:, None]
    return np.maximum.accumulate(np.where(fresh, frames, 0), axis=0)


def judge(take: Take) -> dict[str, float]:
    """Return strikes landed per avatar per minute by both measures, and thrown."""
    events = take.events
    minutes = take.seconds / 60.0 * take.avatar_count
    fights = events.victim >= 0
    attacker, victim = (np.asarray(who)[fights].astype(int) for who in (events.attacker, events.victim))
    frame = decided(take)[np.floor(events.frame[fights]).astype(int), attacker]
    positions = np.stack([take.x[frame, victim], np.full(len(frame), HEIGHT), take.z[frame, victim]], axis=-1)
    near = np.linalg.norm(events.point[fights] - positions, axis=-1) <= NEAR
    return {
        "thrown": len(events.frame) / minutes,
        "strict": float(events.landed.sum()) / minutes,
        "generous": float(near.sum()) / minutes,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Do avatars fight?")
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder of capture")
    parser.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
    parser.add_argument("--quick", action="store_true", help="seconds: six avatars, 8 s, small policies")
    options = parser.parse_args()
    outcome: dict[str, Any] = {}
    changes = QUICK if options.quick else {}
    with ExitStack() as stack:
        if options.quick:
            stack.enter_context(small_policies())
        for name in SCENES:
            if name.endswith("cmu") and options.mocap is None and not options.quick:
                print(f"{name}: left out, it needs --mocap or CROWDSIM_MOCAP", file=sys.stderr)
                continue
            outcome[name] = {
                how: judge(run(load_scenario(name, overrides, **changes), mocap=options.mocap))
                for how, overrides in (("learned", ()), ("random", DRAWN))
            }
    if options.json:
        print(json.dumps(outcome, indent=2))
        return
    print(f"{'per avatar per minute':<30}{'thrown':>9}{'strict':>9}{'generous':>10}")
    for name, found in outcome.items():
        for how, numbers in found.items():
            print(f"{name + ', ' + how:<30}{numbers['thrown']:9.1f}{numbers['strict']:9.1f}{numbers['generous']:10.1f}")


if __name__ == "__main__":
    main()
