"""How good trained policies are, on the embedded boxer and on real capture (--mocap or CROWDSIM_MOCAP).

Return: mean discounted reward over 10 s from 400 random starts with a still target. `approach`: the target is 0.6 to 4
m away in any direction; an episode succeeds when the avatar comes within 0.1 m of the wanted distance in 10 s.
`punch`: the target is in the region that strikes reach; an episode succeeds when a strike lands within 3 s.
`composition`: the behaviours that avatars use by default, with the recipe's weights, and the sum of their rewards;
half of the starts are those of `approach`, half those of `punch`, and an episode succeeds when a strike lands within 6
s.

The reference is the better of two: the same behaviour on a grid of four times the cells (twice the distances, twice
the bearings), and a beam search at run time (128 nodes wide, 10 actions deep, exact rewards, that finer policy's
values behind its leaves; over the first 100 starts, on which the ratio to it is taken). For a composition it learns
the sum of the rewards as one behaviour. `random_return_ratio` is the return of random actions over that of the
reference; it is negative where their transitions cost more than they earn. Part of a return does not depend on
decisions: `decided_ratio` is the return above that of random actions, over the same of the reference.

Without --json also: return against resolution, with the paper's grids, for both look-ups; the loss by coarser numbers;
and the effect of the price of transitions.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from _policies.composition import composed, joint_actions, joint_behaviour
from _policies.learning import (
    POLICIES,
    TINY,
    Sizes,
    play,
    quickly_trained,
    reference,
    starts_for,
    success,
    trained,
    wanted_within,
)
from _policies.tables import precisions, prices, resolutions
from _quick import command_line

from crowdsim.core.workers import CORES, limited
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.training.evaluation import Composition, Episodes
from crowdsim.training.recipe import BehaviourSpec, Recipe, load_recipe

SHIPPED = ("boxer", "boxer_crowd", "boxer_cmu")


def judge(
    policy: Policy, spec: BehaviourSpec, fine: Behaviour, ours: Behaviour | Composition, sizes: Sizes, threads: int
) -> dict[str, Any]:
    """Return how good a behaviour or a composition is, beside the reference and beside random choice.

    Args:
        policy: Its actions, with the costs that the reward counts.
        spec: What is rewarded.
        fine: That, learned on the reference's grid.
        ours: What is judged.
        sizes: How much is done.
        threads: Threads to use.
    """
    states, targets = starts_for(policy, spec, sizes.starts)

    def done(one: Behaviour, some: slice = slice(None), **more: Any) -> Episodes:
        return play(policy, one, states[some], targets[some], threads=threads, within=wanted_within(fine), **more)

    few = slice(0, sizes.searched)
    own = done(fine, composition=ours) if isinstance(ours, Composition) else done(ours)
    theirs, drawn = done(fine), done(fine, choice="random")
    searched = done(fine, few, choice="search", width=sizes.width, depth=sizes.depth)
    to_fine = float(own.returns.mean() / theirs.returns.mean())
    to_search = float(own.returns[few].mean() / searched.returns.mean())
    above = own.returns - drawn.returns
    decided_fine = float(above.mean() / (theirs.returns - drawn.returns).mean())
    decided_search = float(above[few].mean() / (searched.returns - drawn.returns[few]).mean())
    best = max(theirs.returns.mean(), theirs.returns.mean() * to_fine / to_search)
    share, median = success(spec, own)
    tables = ours.behaviours if isinstance(ours, Composition) else (ours,)
    return {
        "return_ratio_to_reference": min(to_fine, to_search),
        "time_ratio_to_search": own.seconds_a_decision / searched.seconds_a_decision,
        "random_return_ratio": float(drawn.returns.mean() / best),
        "success_share": share,
        "median_seconds": median,
        "details": {
            "return": float(own.returns.mean()),
            "return_ratio_to_finer_grid": to_fine,
            "return_ratio_to_search": to_search,
            "decided_ratio": min(decided_fine, decided_search),
            "decided_ratio_to_finer_grid": decided_fine,
            "decided_ratio_to_search": decided_search,
            "microseconds_a_decision": own.seconds_a_decision * 1e6,
            "search_microseconds_a_decision": searched.seconds_a_decision * 1e6,
            "megabytes": sum(one.table.nbytes for one in tables) / 1e6,
            "transitions_per_second": own.transitions_per_second,
            "seconds_between_transitions": own.seconds_between_transitions,
            "random_transitions_per_second": drawn.transitions_per_second,
            "random_success_share": success(spec, drawn)[0],
            "strikes_landed_per_minute": float(own.landed.mean() * 6.0),
            "actions_used": own.actions_used,
        },
    }


def judged(policy: Policy, recipe: Recipe, sizes: Sizes, threads: int) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield how good each behaviour of a policy is, and last their composition.

    A behaviour that is all of the composition is judged as that alone.
    """
    composition = composed(policy)
    for name, spec in recipe.behaviours.items():
        if [behaviour.name for behaviour in composition.behaviours] != [name]:
            yield name, judge(policy, spec, reference(policy, name, spec), policy.behaviour(name), sizes, threads)
    joint = replace(policy, actions=joint_actions(composition))
    spec = joint_behaviour(recipe, policy, composition)
    yield "composition", judge(joint, spec, reference(joint, "composition", spec), composition, sizes, threads)


def details(policy: Policy, name: str, spec: BehaviourSpec, threads: int) -> None:
    """Print the tables of a behaviour."""
    for title, table in (
        ("Return against resolution", resolutions),
        ("What coarser numbers lose", precisions),
        ("What the price of transitions does", prices),
    ):
        print(f" {title}")
        for line in table(policy, name, spec, threads):
            print(line, flush=True)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of each policy, and print them unless they are wanted as JSON."""
    outcome: dict[str, Any] = {}
    for stem in options.policy or SHIPPED:
        if load_recipe(POLICIES / f"{stem}.yaml").motion.capture is not None and not options.mocap:
            print(f"{stem}: left out, it needs --mocap or CROWDSIM_MOCAP", file=sys.stderr)
            continue
        recipe, policy = (quickly_trained if options.quick else trained)(stem, options.mocap, options.threads)
        outcome[stem] = {}
        for name, figures in judged(policy, recipe, TINY if options.quick else Sizes(), options.threads):
            outcome[stem][name] = figures
            if options.json:
                continue
            print(f"{stem} {name}: {policy.actions.action_count} actions of {policy.actions.state_count} states")
            for key, value in {**figures, **figures["details"]}.items():
                if key != "details":
                    print(f"  {key:<34}{value:12.4f}", flush=True)
            if name in recipe.behaviours and not options.quick:
                details(policy, name, recipe.behaviours[name], options.threads)
    return outcome


def main() -> None:
    parser = command_line("How good trained policies are.", "seconds: little motion, coarse grids, few starts")
    parser.add_argument("--mocap", default=os.environ.get("CROWDSIM_MOCAP"), help="folder of motion capture")
    parser.add_argument("--policy", action="append", help="a recipe's stem; several may be named")
    parser.add_argument("--threads", type=int, default=min(2, CORES))
    options = parser.parse_args()
    with limited(options.threads):
        outcome = measure(options)
    if options.json:
        json.dump(outcome, sys.stdout, indent=2)
        print()


if __name__ == "__main__":
    main()
