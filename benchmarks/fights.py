"""Do avatars fight? Strikes landed in the shipped brawls, beside avatars that draw their actions.

    python benchmarks/fights.py [--mocap DIR] [--json]

`strict` is what runs report: at the strike's frame the fist is within 10 cm of the surface of the opponent's head or
torso, where that is then. `generous` asks for less: the fist comes within 25 cm of a point 1.15 m above where the
opponent stood when the attacker decided. Both are strikes a minute and avatar.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.crowd.scenario import load_scenario
from crowdsim.runner import run
from crowdsim.take.take import Take

SCENES = ("brawl_30", "brawl_30_cmu")
DRAWN = ["types.boxer.temperature=100", "types.boxer.candidates={margin: 100, maximum: 64}"]
HEIGHT, NEAR = 1.15, 0.25
"""The point's height, and how near the fist must come [m]."""


def decided(take: Take) -> np.ndarray:
    """Return the frame in which the action that each avatar does was chosen. Shape (frames, N)."""
    fresh = np.ones(take.action.shape, bool)
    fresh[1:] = (np.diff(take.action, axis=0) != 0) | (np.diff(take.action_frame, axis=0) < 0.0)
    frames = np.arange(len(fresh))[:, None]
    return np.maximum.accumulate(np.where(fresh, frames, 0), axis=0)


def judge(take: Take) -> dict[str, float]:
    """Return strikes landed a minute and avatar by both measures, and thrown."""
    events = take.events
    minutes = take.seconds / 60.0 * take.avatar_count
    fights = events.victim >= 0
    attacker, victim = (np.asarray(who)[fights].astype(int) for who in (events.attacker, events.victim))
    frame = decided(take)[np.floor(events.frame[fights]).astype(int), attacker]
    places = np.stack([take.x[frame, victim], np.full(len(frame), HEIGHT), take.z[frame, victim]], axis=-1)
    near = np.linalg.norm(events.point[fights] - places, axis=-1) <= NEAR
    return {
        "thrown": len(events.frame) / minutes,
        "strict": float(events.landed.sum()) / minutes,
        "generous": float(near.sum()) / minutes,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Do avatars fight?")
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder of capture")
    parser.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
    options = parser.parse_args()
    told: dict[str, Any] = {}
    for name in SCENES:
        if name.endswith("cmu") and options.mocap is None:
            print(f"{name}: left out, it needs --mocap or CROWDSIM_MOCAP", file=sys.stderr)
            continue
        told[name] = {
            how: judge(run(load_scenario(name, overrides), mocap=options.mocap))
            for how, overrides in (("learned", []), ("random", DRAWN))
        }
    if options.json:
        print(json.dumps(told, indent=2))
        return
    print(f"{'a minute and avatar':<30}{'thrown':>9}{'strict':>9}{'generous':>10}")
    for name, found in told.items():
        for how, numbers in found.items():
            print(f"{name + ', ' + how:<30}{numbers['thrown']:9.1f}{numbers['strict']:9.1f}{numbers['generous']:10.1f}")


if __name__ == "__main__":
    main()
