"""Fights: strikes in shipped brawls, bouts between fighters, time to react, bodies that are down, and breaks.

    python benchmarks/fights.py [--mocap DIR] [--json] [--quick]

Brawls with learned and with random actions: `strict` is what runs report: at the strike's frame the fist is within
10 cm of the surface of the opponent's head or torso at that time. `generous` asks for less: the fist comes within 25 cm
of a point 1.15 m above the opponent's position at the attacker's decision. Both are strikes per avatar per minute.

Bouts (``bouts.py``): every pair of fighters, each with itself included, 200 times. `won` and `lost` are shares of
bouts that end by a knock-out, with the Wilson interval of 95 %. A fighter wins about half of the decided bouts with
itself (`won_of_decided`), and the red corner about half of all (`red_of_decided`).

Defence (``defence.py``): what lands on a defender, beside the same boxer without defence, and what the best response
that could be found gains against policies.

Reactions (``reaction_time.py``): the time from an attacker's decision to the impact, and the share of strikes whose
victim takes a decision of its own in between, at least 0.2 s after the attacker's: what a defence could react to.

Bodies that are down (``lying.py``), in `brawl_last_standing`: how far their lowest points are from the floor from the
start of a fall to standing, how often others tread on them, and how often they lie in one another. There too,
knock-downs (``knock_downs.py``): how soon after the blow an avatar falls, and how often away from the attacker.

Breaks between rounds (``breaks.py``), in `bout`: how soon boxers stand at ease, and for how much of the break.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from _fights import bouts, breaks, defence, knock_downs, lying, reaction_time
from _quick import command_line, small_policies

from crowdsim.poses.sampler import PoseSampler
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.take import Take
from crowdsim.training.train import ready_policy

SCENES = ("brawl_30", "brawl_30_cmu")
REACTION_SCENES: dict[str, tuple[str, tuple[str, ...]]] = {
    "brawl_30": ("brawl_30", ()),
    "duel": ("duel", ()),
    "duel, boxer_defender": ("duel", ("types.boxer.policy=boxer_defender",)),
}
"""Scenarios for reactions, and what is changed in them."""
LYING_SCENE, LYING_SEEDS = "brawl_last_standing", 8
"""Where bodies that are down are measured, and the number of seeds, from 1 on."""
BREAK_SEEDS = 20
"""Seeds of `bout` for breaks between rounds, from 1 on."""
SEEDS = 5
"""Seeds of each scene for reactions, from 1 on."""
DRAWN = [f"types.boxer.{key}={value}" for key, value in bouts.RANDOM.items()]
QUICK: dict[str, Any] = {"frames": 300, "fraction": 0.2}
"""What is run of a scenario with ``--quick``."""
QUICK_BOUTS: dict[str, Any] = {"count": 4, "seconds": 8.0}
HEIGHT, NEAR = 1.15, 0.25
"""The point's height, and how near the fist must come [m]."""


def judge(take: Take) -> dict[str, float]:
    """Return strikes landed per avatar per minute by both measures, and thrown."""
    events = take.events
    minutes = take.seconds / 60.0 * take.avatar_count
    fights = events.victim >= 0
    attacker, victim = (np.asarray(who)[fights].astype(int) for who in (events.attacker, events.victim))
    frame = reaction_time.find_decisions(take)[np.floor(events.frame[fights]).astype(int), attacker]
    positions = np.stack([take.x[frame, victim], np.full(len(frame), HEIGHT), take.z[frame, victim]], axis=-1)
    near = np.linalg.norm(events.point[fights] - positions, axis=-1) <= NEAR
    return {
        "thrown": len(events.frame) / minutes,
        "strict": float(events.landed.sum()) / minutes,
        "generous": float(near.sum()) / minutes,
    }


def measure(mocap: Path | None, quick: bool) -> dict[str, Any]:
    """Return the figures of brawls by scene, of bouts and of reactions."""
    changes = QUICK if quick else {}
    has_capture = mocap is not None or quick
    outcome: dict[str, Any] = {}
    for name in SCENES:
        if name.endswith("cmu") and not has_capture:
            print(f"{name}: left out, it needs --mocap or CROWDSIM_MOCAP", file=sys.stderr)
            continue
        outcome[name] = {
            how: judge(run(load_scenario(name, overrides, **changes), mocap=mocap))
            for how, overrides in (("learned", ()), ("random", DRAWN))
        }
    fighters = [name for name in bouts.FIGHTERS if has_capture or not name.endswith("cmu")]
    outcome["bouts"] = bouts.measure_bouts(fighters, mocap, **(QUICK_BOUTS if quick else {}))
    outcome["defence"] = defence.measure_defence(outcome["bouts"])
    spec = defence.SHORT if quick else defence.LONG
    outcome["exploitability"] = defence.measure_exploitability(spec=spec)
    outcome["reaction"] = {
        name: reaction_time.measure_reactions(
            [run(load_scenario(scene, how, seed=seed, **changes)) for seed in range(1, 2 if quick else SEEDS + 1)]
        )
        for name, (scene, how) in REACTION_SCENES.items()
    }
    policy = ready_policy("boxer", mocap, threads=2)
    takes = [
        run(load_scenario(LYING_SCENE, ("linger=3",), seed=seed, **changes), [policy])
        for seed in range(1, 2 if quick else LYING_SEEDS + 1)
    ]
    outcome["lying"] = lying.measure_lying([PoseSampler(take, [policy], threads=2) for take in takes])
    assert policy.falls is not None
    outcome["knock_downs"] = knock_downs.measure_knock_downs(takes, policy.falls.fall)
    takes = [
        run(load_scenario("bout", breaks.SCENE, seed=seed, **changes), [policy])
        for seed in range(1, 2 if quick else BREAK_SEEDS + 1)
    ]
    outcome["breaks"] = breaks.measure_breaks(takes, policy)
    return outcome


def lines(outcome: Mapping[str, Any]) -> Iterator[str]:
    """Yield the tables, a line each."""
    yield f"{'per avatar per minute':<30}{'thrown':>9}{'strict':>9}{'generous':>10}"
    for name in SCENES:
        for how, numbers in outcome.get(name, {}).items():
            yield f"{name + ', ' + how:<30}{numbers['thrown']:9.1f}{numbers['strict']:9.1f}{numbers['generous']:10.1f}"
    yield ""
    yield from bouts.lines(outcome["bouts"])
    yield ""
    yield from defence.lines(outcome["defence"], outcome["exploitability"])
    yield ""
    yield from reaction_time.lines(outcome["reaction"])
    yield ""
    yield from lying.lines(outcome["lying"])
    yield ""
    yield from knock_downs.lines(outcome["knock_downs"])
    yield ""
    yield from breaks.lines(outcome["breaks"])


def main() -> None:
    parser = command_line(
        "Do avatars fight, and who wins?", "seconds: six avatars, 20 s, a few bouts of 8 s, small policies"
    )
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder of capture")
    options = parser.parse_args()
    with small_policies(falls=True, wanted=options.quick):
        outcome = measure(options.mocap, options.quick)
    print(json.dumps(outcome, indent=2) if options.json else "\n".join(lines(outcome)))


if __name__ == "__main__":
    main()
