"""Tables of what decides how good a policy is: its grid, its numbers' precision, its price of transitions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from _policies.learning import POLICIES, Sizes, changed, play, starts_for, success, train
from crowdsim.policy import bundle
from crowdsim.policy.policy import Policy
from crowdsim.policy.rewards import TransitionTerm
from crowdsim.training.recipe import BehaviourSpec, load_recipe

STARTS = Sizes().starts
LARGEST = 500e6
"""Tables above this many bytes are left out of the comparison [B]."""


def resolutions(policy: Policy, name: str, spec: BehaviourSpec, threads: int) -> Iterator[str]:
    """Yield return against resolution, a line each, for both look-ups; the recipe's own table comes last."""
    states, targets = starts_for(policy, spec, STARTS)
    shapes: list[tuple[str, BehaviourSpec]] = []
    own, spec = spec, changed(spec, {}, finer=1)
    if name == "punch":  # a behaviour of the paper's
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
            share, _ = success(spec, episodes)
            yield (
                f"  {label:<26}{lookup:>8}{4e-6 * entries:9.1f}{episodes.returns.mean():9.3f}{share:9.1%}"
                f"{episodes.seconds_a_decision * 1e6:15.2f}"
            )


def precisions(policy: Policy, name: str, spec: BehaviourSpec, threads: int) -> Iterator[str]:
    """Yield what is lost by values of fewer bytes, a line each."""
    states, targets = starts_for(policy, spec, STARTS)
    few = {"distance": 10, "bearing": 20 if spec.strikes else 16, "height": 4}
    small = {axis: few[axis] for axis in spec.axes.given()}
    for lookup, counts in (("v", {}), ("q", small)):
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
    states, targets = starts_for(policy, spec, STARTS)
    rewards = [term.model_dump(mode="json") for term in spec.rewards if not isinstance(term, TransitionTerm)]
    price = next((term for term in spec.rewards if isinstance(term, TransitionTerm)), None)
    if price is None:
        return
    yield f"  {'price':>7}{'earned':>9}{'success':>9}{'transitions/s':>8}{'uncut s':>9}"
    for factor in (0.0, 0.25, 0.5, 1.0, 2.0):
        outcome = {"kind": "transition", "weight": price.weight * factor, "each": price.each * factor}
        learned = train(policy, name, changed(spec, {}, rewards=[*rewards, outcome]))
        episodes = play(policy, learned, states, targets, threads=threads)
        share, _ = success(spec, episodes)
        yield (
            f"  {factor:6.2f}x{episodes.earned.mean():9.3f}{share:9.1%}{episodes.transitions_per_second:8.2f}"
            f"{episodes.seconds_between_transitions:9.2f}"
        )
