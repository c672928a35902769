"""How natural transitions look: a classifier tries to distinguish them from captured motion.

    python benchmarks/motion_quality.py [--mocap DIR] [--json] [--windows 1000] [--seconds 0.4] [--noise 0.01]
                                        [--policy BUNDLE ...] [--brawls 3] [--quick]

Sixty avatars fight, everyone against everyone, with a trained policy. Windows of 0.4 s around their transitions
(`made`) are compared with windows of the capture around the frames that the transitions leave and enter, so the
classes differ by the transition alone. `apart` are those with no other transition near; `every` are drawn evenly from
all transitions of the graph, whether or not an avatar would choose them. Features are velocities and accelerations of
the joints at 60 Hz in the ground frame of the window's middle. Clips are split in halves: a classifier is trained on
transitions and capture of one half and tested on the other. The result is the area under the ROC curve, the mean of
four splits; 0.5 is guessing, 1 is certainty. Two brawls of one policy differ by 0.02 or more, so `made` and `apart`
are means over brawls with different seeds. Of two classifiers, logistic regression and random trees that also get
speeds and magnitudes of accelerations, the better one counts.

`ours` are poses as they are exported, with blends and foot plants, but without the changes that strikes make to arms
and hit reactions make to bodies; `crossfade` mixes both motions over 0.4 s; `hard` does nothing; `motions alone` omits
the moment of a hard transition, so what it shows is the choice of motions, which no blend can change. Noise of 0.01
mm, a tenth of the error of good optical capture, is added to all positions: the performer's planted feet are exactly
still, and without noise a classifier would find rounding errors.

`decisions` are complete poses, with strikes and hit reactions: windows around transitions against windows around
decisions without one, for three classifiers that get jerks too, beside the capture behind these windows. See
`decisions.py`. `smoothness` is how often joints of complete poses accelerate more than the 99.9th percentile of the
capture, near transitions and near strikes that land, with jumps of joints and drops of the pelvis. See
`smoothness.py`.

The motion is the embedded performer's
(`policies/boxer.yaml`) and, with --mocap or CROWDSIM_MOCAP, the capture of `policies/boxer_cmu.yaml`; policies that
are not trained are trained first.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _motion.decisions import judge_decisions
from _motion.fall_motion import measure_falls
from _motion.rest_motion import measure_rests
from _motion.shown_motion import Shown, read_shown
from _motion.smoothness import measure_smoothness
from _motion.text import lines_of_policy
from _motion.transition_judge import NOISE, judge, mean_of
from _motion.transition_windows import alone, made, usable, without_strikes
from _quick import command_line, small_policies, with_policy

from crowdsim.policy.policy import Policy
from crowdsim.poses.sampler import PoseSampler
from crowdsim.runs.runner import run
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.take import Take
from crowdsim.training.train import ready_policy

SCENE = ["groups.0.count=60", "types.boxer.scale=1", "groups.0.placement.radius=7", "fps=60", "duration=1000"]
QUICK = ["groups.0.count=12", "groups.0.placement.radius=3", "duration=600"]
"""What is other in a quick brawl."""


def fight(policy: Policy, seed: int = 0, quick: bool = False) -> Take:
    """Sixty fight by a policy."""
    changes = [*SCENE, *(QUICK if quick else []), *with_policy(policy.name), f"seed={seed}"]
    scenario = load_scenario("brawl_30", changes)
    return run(scenario, [policy], threads=2)


def _plain(outcome: Any) -> Any:
    """Return plain data with null for what is no number: too few transitions."""
    if isinstance(outcome, dict):
        return {key: _plain(value) for key, value in outcome.items()}
    if isinstance(outcome, list):
        return [_plain(value) for value in outcome]
    return None if isinstance(outcome, float) and not np.isfinite(outcome) else outcome


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of each policy."""
    result: dict[str, Any] = {}
    noise = 1e-3 * options.noise
    for name in options.policy or ["boxer", *(["boxer_cmu"] if options.mocap else [])]:
        print(f"{name} ...", file=sys.stderr, flush=True)
        policy = ready_policy(name, options.mocap, threads=2)
        database = policy.database
        half = round(0.5 * options.seconds * database.playback_rate)
        brawls: list[dict[str, Any]] = []
        runs: list[Shown] = []
        smooth: list[dict[str, Any]] = []
        for seed in range(options.brawls):
            take = fight(policy, seed, options.quick)
            shown_run = read_shown(PoseSampler(take, [policy], threads=2))
            smooth.append(measure_smoothness(shown_run))
            runs.append(replace(shown_run, rotations=np.empty(0), local=np.empty(0)))
            sampler = without_strikes(take, policy)
            leave, enter, shown, apart = made(sampler, half, options.windows, np.random.default_rng(seed))
            fighters, seconds = sampler.take.avatar_count, sampler.take.seconds
            transitions = sampler.window(0, np.arange(fighters), np.array([0.0, seconds])).transitions
            brawls.append(
                {
                    "transitions_per_second": len(transitions.times) / (fighters * seconds),
                    "made": judge(database, leave, enter, shown, noise=noise),
                    "apart": judge(database, leave[apart], enter[apart], shown[apart], noise=noise),
                }
            )
        every = usable(database, policy.graph, options.windows, np.random.default_rng(0))
        result[Path(name).name] = {
            **mean_of(brawls),
            "decisions": judge_decisions(runs, options.windows, noise),
            "smoothness": mean_of(smooth),
            "made_in_each": [brawl["made"]["ours"]["auc"] for brawl in brawls],
            "every": judge(database, *every, alone(database, *every, half), noise=noise),
            "falls": measure_falls(policy, options.brawls, half, options.windows, noise, options.quick),
            "rests": measure_rests(policy, options.brawls, half, options.windows, noise, options.quick),
        }
    return result


def main() -> None:
    """Read the command line, measure and print."""
    parser = command_line(__doc__, "seconds: two small brawls, small policies")
    parser.add_argument("--mocap", type=Path, default=os.environ.get("CROWDSIM_MOCAP"), help="folder with capture")
    parser.add_argument("--windows", type=int, default=1000, help="most transitions that are classified")
    parser.add_argument("--policy", nargs="+", help="recipes or bundles other than boxer and boxer_cmu")
    parser.add_argument("--seconds", type=float, default=0.4, help="length of a window, 0.2 to 1.6")
    parser.add_argument("--brawls", type=int, default=3, help="brawls whose transitions are classified")
    parser.add_argument("--noise", type=float, default=1e3 * NOISE, help="noise on all positions [mm]")
    options = parser.parse_args()
    if options.quick:
        options.windows, options.brawls = min(options.windows, 80), 2
    if options.noise < 0.0:
        parser.error(f"--noise is {options.noise}, expected 0 or more")
    if not 0.2 <= options.seconds <= 1.6:
        parser.error(f"--seconds is {options.seconds}, expected 0.2 to 1.6")
    if options.brawls < 1:
        parser.error(f"--brawls is {options.brawls}, expected 1 or more")
    # Two clips, so that classifiers can be asked about what they have not seen.
    with small_policies(60.0, falls=True, wanted=options.quick):
        result = measure(options)
    if options.json:
        print(json.dumps(_plain(result), indent=2, allow_nan=False))
        return
    for name, outcome in result.items():
        print("\n".join(lines_of_policy(name, outcome)))


if __name__ == "__main__":
    main()
