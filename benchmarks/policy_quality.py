"""How good trained policies are, on the embedded boxer and on real capture (--mocap or CROWDSIM_MOCAP).

Return: discounted reward over 10 s from 400 random starts with a still target, in the mean. `approach`: the target
stands 0.6 to 4 m away, in any direction; a success is to come within 0.6 m in 10 s. `punch`: the target is in the
region that strikes reach; a success is a strike that lands within 3 s.

The reference is the better of two: the same behaviour on a grid of four times the cells (twice the distances, twice
the bearings), and a beam search at run time (128 nodes wide, 10 actions deep, exact rewards, that finer policy's
values behind its leaves; over the first 160 starts, on which the ratio to it is taken). `random_return_ratio` is the
return of drawn actions over that of the reference; it is negative where their cuts cost more than they earn.

Without --json also: return against resolution, with the paper's grids, for both look-ups; what coarser numbers lose;
and what the price of transitions does.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np

from crowdsim.graph.motion_graph import build_graph
from crowdsim.policy import bundle
from crowdsim.policy.actions import build_actions
from crowdsim.policy.evaluation import Episodes, random_starts, run_episodes
from crowdsim.policy.fingerprint import capture_files
from crowdsim.policy.policy import Behaviour, Policy
from crowdsim.policy.pruning import prune_graph
from crowdsim.policy.ranges import strike_reach
from crowdsim.policy.recipe import BehaviourSpec, Recipe, load_recipe
from crowdsim.policy.rewards import TransitionTerm, target_body
from crowdsim.policy.train import load_motion, train_behaviour

STARTS, SEARCHED = 400, 160
WIDTH, DEPTH = 128, 10
SECONDS = {"approach": 10.0, "punch": 3.0}
POLICIES = Path(__file__).resolve().parent.parent / "policies"
LARGEST = 500e6
"""Tables above this many bytes are left out of the comparison [B]."""


def prepare(recipe: Recipe, name: str, mocap: str | None) -> Policy:
    """Return motion, graph and actions of a recipe as a policy that has learned nothing yet."""
    database = load_motion(recipe, capture_files(recipe, mocap))
    graph, body = build_graph(database, recipe.graph), target_body(database)
    if recipe.prune is not None:
        graph = prune_graph(database, graph, recipe.behaviours, body, recipe.prune)
    nothing = np.zeros(0, np.float32)
    return Policy(name, database, graph, build_actions(database, graph), (), body, nothing, {}, {}, "", {})


def train(policy: Policy, name: str, spec: BehaviourSpec, precision: str = "float32") -> Behaviour:
    """Return a behaviour trained over the policy's actions."""
    return train_behaviour(name, spec, policy.database, policy.actions, policy.body, precision)[0]


def changed(spec: BehaviourSpec, counts: dict[str, int], **more: Any) -> BehaviourSpec:
    """Return a behaviour with other numbers of grid points and other settings."""
    told = spec.model_dump(mode="json")
    for axis, count in counts.items():
        told["axes"][axis]["count"] = count
    return BehaviourSpec.model_validate({**told, **more})


def play(policy: Policy, behaviour: Behaviour, states: Any, targets: Any, **options: Any) -> Episodes:
    """Return what came of a behaviour from each start."""
    rate = policy.database.control_rate
    return run_episodes(policy.actions, behaviour, policy.body, rate, states, targets, **options)


def starts_of(policy: Policy, name: str) -> tuple[Any, Any]:
    """Return states and targets that a behaviour starts from."""
    reach = strike_reach(policy.database)
    if name == "approach":
        return random_starts(policy, STARTS, (0.6, 4.0), (-np.pi, np.pi), reach.head_height)
    return random_starts(policy, STARTS, reach.distance, reach.bearing, reach.head_height)


def success(name: str, episodes: Episodes) -> tuple[float, float]:
    """Return the share of episodes that succeed in time, and the median time of those that ever do [s]."""
    times = episodes.arrivals if name == "approach" else episodes.landings
    share = float(np.mean(times <= SECONDS[name]))
    return share, float(np.nanmedian(times)) if np.isfinite(times).any() else float("nan")


def judge(policy: Policy, name: str, spec: BehaviourSpec, precision: str, threads: int) -> dict[str, Any]:
    """Return how good one behaviour is, beside the reference and beside random choice."""
    states, targets = starts_of(policy, name)
    learned = train(policy, name, spec, precision)
    counts = {axis: one.count for axis, one in spec.axes.given().items()}
    finer = {axis: count * (2 if axis in ("distance", "bearing") else 1) for axis, count in counts.items()}
    fine = train(policy, name, changed(spec, finer, lookup="v", finer=1))
    ours = play(policy, learned, states, targets, threads=threads)
    theirs = play(policy, fine, states, targets, threads=threads)
    drawn = play(policy, learned, states, targets, choice="random", threads=threads)
    few = slice(0, SEARCHED)
    searched = play(policy, fine, states[few], targets[few], choice="search", width=WIDTH, depth=DEPTH, threads=threads)
    to_fine = float(ours.returns.mean() / theirs.returns.mean())
    to_search = float(ours.returns[few].mean() / searched.returns.mean())
    share, median = success(name, ours)
    reference = max(theirs.returns.mean(), theirs.returns.mean() * to_fine / to_search)
    return {
        "return_ratio_to_reference": min(to_fine, to_search),
        "time_ratio_to_search": ours.seconds_a_decision / searched.seconds_a_decision,
        "random_return_ratio": float(drawn.returns.mean() / reference),
        "success_share": share,
        "median_seconds": median,
        "details": {
            "return": float(ours.returns.mean()),
            "return_ratio_to_finer_grid": to_fine,
            "return_ratio_to_search": to_search,
            "microseconds_a_decision": ours.seconds_a_decision * 1e6,
            "search_microseconds_a_decision": searched.seconds_a_decision * 1e6,
            "megabytes": learned.table.nbytes / 1e6,
            "cuts_per_second": ours.cuts_per_second,
            "uncut_seconds": ours.uncut_seconds,
            "random_cuts_per_second": drawn.cuts_per_second,
            "random_success_share": success(name, drawn)[0],
            "strikes_landed_per_minute": float(ours.landed.mean() * 6.0),
            "actions_used": ours.actions_used,
        },
    }


def resolutions(policy: Policy, name: str, spec: BehaviourSpec, threads: int) -> Iterator[str]:
    """Yield return against resolution, a line each, for both look-ups; the recipe's own table comes last."""
    states, targets = starts_of(policy, name)
    shapes: list[tuple[str, BehaviourSpec]] = []
    own, spec = spec, changed(spec, {}, finer=1)
    if name == "punch":
        paper = load_recipe(POLICIES / "boxer_paper.yaml").behaviours["punch"].axes.model_dump(mode="json")
        shapes.append(("strikes' reach", changed(spec, {}, axes=paper)))
        sizes = [(10, 10, 4), (10, 20, 4), (16, 24, 6), (24, 36, 8)]
        shapes += [("", changed(spec, dict(zip(("distance", "bearing", "height"), n, strict=True)))) for n in sizes]
    else:
        sizes2 = [(5, 13), (10, 16), (21, 24), (42, 48)]
        shapes += [("", changed(spec, dict(zip(("distance", "bearing"), n, strict=True)))) for n in sizes2]
    shapes.append((f"fitted, finer {own.finer}" if own.finer > 1 else "", own))
    yield f"  {'grid':<26}{'look-up':>8}{'MB':>9}{'return':>9}{'success':>9}{'us a decision':>15}"
    for note, one in shapes:
        for lookup in ("q", "v"):
            counts = [axis.count for axis in one.axes.given().values()]
            entries = int(np.prod(counts)) * (
                policy.actions.action_count if lookup == "q" else policy.actions.state_count
            )
            label = f"{' x '.join(map(str, counts))} {note}"
            if 4 * entries > LARGEST:
                yield f"  {label:<26}{lookup:>8}{4e-6 * entries:9.1f}     left out: too large"
                continue
            episodes = play(
                policy, train(policy, name, changed(one, {}, lookup=lookup)), states, targets, threads=threads
            )
            share, _ = success(name, episodes)
            yield (
                f"  {label:<26}{lookup:>8}{4e-6 * entries:9.1f}{episodes.returns.mean():9.3f}{share:9.1%}"
                f"{episodes.seconds_a_decision * 1e6:15.2f}"
            )


def precisions(policy: Policy, name: str, spec: BehaviourSpec, threads: int) -> Iterator[str]:
    """Yield what is lost by values of fewer bytes, a line each."""
    states, targets = starts_of(policy, name)
    small = {"approach": {"distance": 10, "bearing": 16}, "punch": {"distance": 10, "bearing": 20, "height": 4}}
    for lookup, counts in (("v", {}), ("q", small[name])):
        exact = train(policy, name, changed(spec, counts, lookup=lookup))
        best = 0.0
        for precision, size in (("float32", 4), ("float16", 2), ("int8", 1)):
            table, low, step = bundle.encode(exact.table, precision)
            episodes = play(policy, replace(exact, table=table, low=low, step=step), states, targets, threads=threads)
            best = best or float(episodes.returns.mean())
            shape = " x ".join(str(count) for count in exact.grid.shape)
            loss = 1.0 - episodes.returns.mean() / best
            yield f"  {lookup}  {shape:<14}{precision:<9}{len(table) * size / 1e6:8.1f} MB   return lost {loss:7.2%}"


def prices(policy: Policy, name: str, spec: BehaviourSpec, threads: int) -> Iterator[str]:
    """Yield what the price of transitions does, a line each; what is earned is the return without it."""
    states, targets = starts_of(policy, name)
    rewards = [term.model_dump(mode="json") for term in spec.rewards if term.kind != "transition"]
    price = next((term for term in spec.rewards if isinstance(term, TransitionTerm)), None)
    if price is None:
        return
    yield f"  {'price':>7}{'earned':>9}{'success':>9}{'cuts/s':>8}{'uncut s':>9}"
    for factor in (0.0, 0.25, 0.5, 1.0, 2.0):
        told = {"kind": "transition", "weight": price.weight * factor, "each": price.each * factor}
        learned = train(policy, name, changed(spec, {}, rewards=[*rewards, told]))
        episodes = play(policy, learned, states, targets, threads=threads)
        share, _ = success(name, episodes)
        yield (
            f"  {factor:6.2f}x{episodes.earned.mean():9.3f}{share:9.1%}{episodes.cuts_per_second:8.2f}"
            f"{episodes.uncut_seconds:9.2f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="How good trained policies are.")
    parser.add_argument("--json", action="store_true", help="print one JSON document and nothing else")
    parser.add_argument("--mocap", default=os.environ.get("CROWDSIM_MOCAP"), help="folder of motion capture")
    parser.add_argument("--policy", action="append", help="a recipe's stem; several may be named")
    parser.add_argument("--threads", type=int, default=min(2, numba.config.NUMBA_NUM_THREADS))
    options = parser.parse_args()
    numba.set_num_threads(options.threads)
    told: dict[str, Any] = {}
    for stem in options.policy or ["boxer", "boxer_cmu"]:
        recipe = load_recipe(POLICIES / f"{stem}.yaml")
        if recipe.motion.capture is not None and not options.mocap:
            print(f"{stem}: left out, it needs --mocap or CROWDSIM_MOCAP", file=sys.stderr)
            continue
        policy = prepare(recipe, stem, options.mocap)
        told[stem] = {}
        for name, spec in recipe.behaviours.items():
            told[stem][name] = judge(policy, name, spec, recipe.precision, options.threads)
            if options.json:
                continue
            print(f"{stem} {name}: {policy.actions.action_count} actions of {policy.actions.state_count} states")
            for key, value in {**told[stem][name], **told[stem][name]["details"]}.items():
                if key != "details":
                    print(f"  {key:<34}{value:12.4f}")
            for title, table in (
                ("Return against resolution", resolutions),
                ("What coarser numbers lose", precisions),
                ("What the price of transitions does", prices),
            ):
                print(f" {title}")
                for line in table(policy, name, spec, options.threads):
                    print(line, flush=True)
    if options.json:
        json.dump(told, sys.stdout, indent=2)
        print()


if __name__ == "__main__":
    main()
