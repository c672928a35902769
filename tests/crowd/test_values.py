"""What actions are worth in control, against the plain version, for targets that move and stop."""

from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import set_situations
from naive_policy import action_values
from synthetic_policy import policy, with_axes, with_headings

from crowdsim.crowd.buffers import empty_scratch
from crowdsim.crowd.kernels.values import value_actions
from crowdsim.crowd.model import build_model
from crowdsim.policy.axes.axis import UNSEEN_STRIKE, Target
from crowdsim.policy.bundle import encode
from crowdsim.policy.environment import Axis
from crowdsim.policy.kernels.axes import Corners
from crowdsim.policy.kernels.values import evaluate_actions
from crowdsim.policy.rewards import HitTerm, ProximityTerm, StrikeTerm, TransitionTerm


def near(**fields):
    return ProximityTerm(kind="proximity", **fields)


def strike(**fields):
    return StrikeTerm(kind="strike", **{"tolerance": 0.3, **fields})


PRICE = TransitionTerm(kind="transition", weight=0.4, each=0.2)
TERMS = {
    "the greatest strike": [strike()],
    "the sum of strikes": [strike(form="sum", weight=2.0)],
    "effort": [strike(effort=0.3, weight=1.5)],
    "waste": [strike(waste=0.4, weight=1.5)],
    "all of a strike": [strike(form="sum", effort=0.1, waste=0.2), strike(tolerance=0.1, waste=0.3)],
    "a band": [near(distance=(0.4, 1.2), sigma=0.3)],
    "a band ahead": [near(distance=(0.4, 1.2), sigma=0.3, facing=True, aside=0.3)],
    "bands alike but in width": [
        near(distance=(0.4, 1.2), facing=True, aside=0.3),
        near(distance=(0.4, 1.2), facing=True, aside=0.3, sigma=2.0, weight=0.3),
    ],
    "bands that differ in one number": [
        near(distance=(0.4, 1.2)),
        near(distance=(0.4, 1.3)),
        near(distance=(0.3, 1.3)),
        near(distance=(0.3, 1.3), facing=True),
        near(distance=(0.3, 1.3), facing=True, aside=0.2),
    ],
    "the greatest in a band": [near(distance=(0.4, 1.2), form="max"), near(distance=0.5, form="max", facing=True)],
    "all": [near(distance=(0.4, 0.9)), strike(effort=0.1, waste=0.1), PRICE, near(distance=2.0, facing=True)],
}


SEEN = {
    "velocity": [Axis("velocity", -0.1, 0.2, 4, fade=0.1)],
    "impact": [Axis("impact", 0.0, 6.0, 4, fade=1.0)],
    "heading and impact": [Axis("heading", -np.pi, np.pi, 4, wraps=True), Axis("impact", 1.0, 4.0, 3, stretch=2.0)],
}


def with_terms(chosen, terms):
    """A policy whose behaviours have these terms."""
    behaviours = tuple(replace(each, terms=tuple(terms)) for each in chosen.behaviours)
    return replace(chosen, behaviours=behaviours)


def stretched(chosen):
    """A policy whose grids are finer near."""

    def squeezed(axis):
        return replace(axis, stretch=1.5) if axis.name != "bearing" else axis

    behaviours = []
    for each in chosen.behaviours:
        grid = replace(each.grid, axes=tuple(squeezed(axis) for axis in each.grid.axes))
        behaviours.append(replace(each, grid=grid))
    return replace(chosen, behaviours=tuple(behaviours))


def compare(chosen, seed=0, count=60):
    """Compare all values of random states, targets, movements and weights; return them."""
    rng = np.random.default_rng(seed)
    model = build_model([chosen])
    scratch = empty_scratch(model, 1, count)
    states, weights = rng.integers(chosen.actions.state_count, size=count), rng.uniform(0, 2, (count, 2))
    targets = rng.uniform([-2.5, 1.0, -2.5], [2.5, 1.9, 2.5], (count, 3))
    moving = rng.normal(0.0, 0.1, (count, 2))
    lasts = rng.choice([0.0, 0.7, 2.0, 3.5, np.inf], count)
    headings = rng.uniform(-np.pi, np.pi, count)
    impacts = np.where(rng.random(count) < 0.7, rng.uniform(0.0, 8.0, count), UNSEEN_STRIKE)
    scratch.order[:], scratch.cohorts[:], scratch.policies[:] = rng.permutation(count), np.arange(count), 0
    scratch.states[:] = states
    set_situations(scratch, np.column_stack([targets, moving, headings, impacts, lasts]))
    scratch.values[:] = np.nan
    value_actions(model, weights, scratch, 0, count)
    found = []
    for k in range(count):
        named = {each.name: weights[k, column] for column, each in enumerate(chosen.behaviours)}
        velocity = (moving[k, 0], 0.0, moving[k, 1])
        expected = action_values(chosen, named, states[k], (*targets[k], headings[k], impacts[k]), velocity, lasts[k])
        found.append(scratch.values[k, : len(expected)].copy())
        np.testing.assert_allclose(found[-1], expected, rtol=2e-5, atol=2e-5)
    return np.concatenate(found)


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS.keys())
def test_values_for_a_moving_target_are_those_of_the_plain_version(terms):
    chosen = policy(4, "v")
    found = compare(with_terms(chosen, terms))
    assert np.abs(found - compare(with_terms(chosen, []))).max() > 0.05, "the terms count"


@pytest.mark.parametrize("lookup", ["v", "q"])
@pytest.mark.parametrize("precision", ["float32", "int16", "int8"])
def test_values_on_stretched_grids_are_those_of_the_plain_version(lookup, precision):
    chosen = stretched(policy(4, lookup))
    behaviours = []
    for each in chosen.behaviours:
        table, low, step = encode(each.table, precision)
        behaviours.append(replace(each, table=table, low=low, step=step))
    values = np.concatenate([each.table for each in behaviours])
    chosen = replace(chosen, behaviours=tuple(behaviours), values=values)
    assert build_model([chosen]).table.dtype == {"float32": np.float32, "int16": np.uint16, "int8": np.uint8}[precision]
    assert np.abs(compare(chosen) - compare(policy(4, lookup))).max() > 0.05, "the stretch counts"


@pytest.mark.parametrize("lookup", ["v", "q"])
def test_values_for_a_target_that_faces_some_way_are_those_of_the_plain_version(lookup):
    chosen = with_headings(policy(4, lookup))
    assert [axis.name for axis in chosen.behaviours[1].grid.axes] == ["distance", "bearing", "height", "heading"]
    assert np.abs(compare(chosen) - compare(policy(4, lookup))).max() > 0.05, "the heading counts"


@pytest.mark.parametrize("lookup", ["v", "q"])
@pytest.mark.parametrize("axes", SEEN.values(), ids=SEEN.keys())
def test_values_on_further_axes_are_those_of_the_plain_version(lookup, axes):
    chosen = with_axes(policy(4, lookup), *axes)
    if axes[-1].name == "impact":
        first, last = chosen.behaviours
        hit = HitTerm(kind="hit", distance=(0.5, 0.9), weight=2.0, sigma=0.2)
        chosen = replace(chosen, behaviours=(replace(first, terms=(*first.terms, hit)), last))
    assert np.abs(compare(chosen) - compare(policy(4, lookup))).max() > 0.05, "the axes count"


@pytest.mark.parametrize("lookup", ["v", "q"])
@pytest.mark.parametrize("terms", [TERMS["all"], [PRICE], TERMS["bands that differ in one number"]])
@pytest.mark.parametrize("seen", ["velocity", "impact"])
def test_values_in_training_are_those_of_the_plain_version(lookup, terms, seen):
    chosen = with_headings(stretched(with_terms(policy(4, lookup), terms)))
    chosen = with_axes(chosen, Axis("velocity", -0.1, 0.1, 3) if seen == "velocity" else Axis("impact", 0.0, 6.0, 3))
    first, last = chosen.behaviours
    chosen = replace(chosen, behaviours=(first, replace(last, scale=0.7)))
    tables, rng = chosen.lookup_tables(), np.random.default_rng(1)
    corners, out = Corners(np.empty(64, np.int64), np.empty(64)), np.empty(100)
    for _ in range(100):
        state, weights = int(rng.integers(chosen.actions.state_count)), rng.uniform(0, 2, 2) * rng.integers(0, 2, 2)
        target = rng.uniform([-2.0, 1.0, -2.0], [2.0, 1.8, 2.0])
        vx, vz = rng.normal(0.0, 0.1, 2) * rng.integers(0, 2)
        heading = rng.uniform(-4.0, 4.0)
        impact = float(rng.choice([0.3, 2.5, 4.0, UNSEEN_STRIKE]))
        n = evaluate_actions(tables, weights, state, Target(*target, vx, vz, heading, impact, np.inf), corners, out)
        named = {each.name: weight for each, weight in zip(chosen.behaviours, weights, strict=True)}
        expected = action_values(chosen, named, state, (*target, heading, impact), (vx, 0.0, vz))
        np.testing.assert_allclose(out[:n], expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("lookup", ["v", "q"])
def test_a_target_that_stops_at_once_equals_one_at_rest(lookup):
    chosen = policy(4, lookup)
    weights, target = {each.name: 1.0 for each in chosen.behaviours}, (0.3, 1.5, 1.0)
    for state in range(chosen.actions.state_count):
        still = action_values(chosen, weights, state, target)
        np.testing.assert_array_equal(action_values(chosen, weights, state, target, (0.2, 0.0, 0.1), 0.0), still)
        moving = action_values(chosen, weights, state, target, (0.2, 0.0, 0.1))
        assert not np.allclose(moving, still)


@pytest.mark.parametrize("lookup", ["v", "q"])
def test_a_behaviour_without_a_scale_counts_for_nothing(lookup):
    chosen = policy(4, lookup)
    first, last = chosen.behaviours
    mute = replace(chosen, behaviours=(first, replace(last, scale=0.0)))
    for target in ((0.3, 1.5, 1.0), (-1.0, 1.4, 0.2)):
        both = action_values(mute, {first.name: 1.0, last.name: 1.0}, 3, target)
        np.testing.assert_array_equal(both, action_values(chosen, {first.name: 1.0}, 3, target))
    compare(mute)


@pytest.mark.parametrize("lookup", ["v", "q"])
def test_a_transition_costs_what_it_costs_the_behaviour_that_it_costs_most(lookup):
    priced = with_terms(policy(4, lookup), [PRICE])
    first, last = priced.behaviours
    priced = replace(priced, behaviours=(first, replace(last, scale=first.scale / 3.0)))
    # Tables of Q-values hold the price already; with the look-up v the terms of the reward add it.
    without = replace(priced, behaviours=tuple(replace(each, terms=()) for each in priced.behaviours))
    actions, target = priced.actions, (0.3, 1.5, 1.0)
    counted = 0
    for weights in ((1.0, 0.2), (0.2, 1.0), (1.0, 0.0), (0.0, 0.0)):
        named = {each.name: weight for each, weight in zip(priced.behaviours, weights, strict=True)}
        shares = [w / each.scale for w, each in zip(weights, priced.behaviours, strict=True)]
        for state in range(actions.state_count):
            costs = actions.costs[actions.offsets[state] : actions.offsets[state + 1]].astype(float)
            price = 0.4 * costs + 0.2 * (costs > 0.0)
            both, free = (action_values(each, named, state, target) for each in (priced, without))
            held = sum(shares) * price if lookup == "q" else 0.0
            np.testing.assert_allclose(both, free + held - max(shares) * price, atol=1e-6)
            counted += (costs > 0.0).any()
    assert counted > 20
    compare(priced)
