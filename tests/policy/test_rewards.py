"""Rewards: the compiled ones against the plain ones, and what they mean."""

import math

import numpy as np
import pytest
from naive_policy import random_actions

from crowdsim.policy import kernels
from crowdsim.policy.rewards import (
    ProximityTerm,
    StrikeTerm,
    TargetBody,
    TransitionTerm,
    action_reward,
    pack_terms,
    surface_distance,
)

BODY = TargetBody()
TERMS = [
    StrikeTerm(kind="strike", tolerance=0.12),
    StrikeTerm(kind="strike", tolerance=0.3, speed_weight=2.0, weight=3.0),
    ProximityTerm(kind="proximity", distance=0.5),
    ProximityTerm(kind="proximity", form="max", facing=True, distance=0.8, sigma=0.2),
    TransitionTerm(kind="transition", weight=0.5, each=0.1),
]


def compiled(actions, action, target, terms, velocity=(0.0, 0.0), discount=0.97):
    packed = pack_terms(terms, BODY)
    return kernels.reward(actions, action, *target, *velocity, packed, 0, len(packed), math.log(discount))


@pytest.mark.parametrize("term", TERMS, ids=lambda term: f"{term.kind}-{term.weight:g}")
@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.05, -0.03)])
def test_compiled_rewards_are_those_of_the_plain_version(term, velocity):
    actions = random_actions()
    draw = np.random.default_rng(1)
    nonzero = 0
    for _ in range(300):
        action = int(draw.integers(len(actions.next)))
        target = draw.uniform([-1.0, 1.0, -0.5], [1.0, 1.8, 1.2])
        plain = action_reward(actions, action, target, (term,), BODY, 0.97, velocity)
        assert compiled(actions, action, target, (term,), velocity) == pytest.approx(plain, rel=1e-5, abs=1e-6)
        nonzero += plain != 0.0
    assert nonzero > 5


def test_terms_add_up():
    actions = random_actions()
    target = (0.2, 1.4, 0.7)
    for action in range(len(actions.next)):
        parts = sum(compiled(actions, action, target, (term,)) for term in TERMS)
        assert compiled(actions, action, target, TERMS) == pytest.approx(parts, abs=1e-9)


def test_a_fist_lands_within_the_tolerance_of_the_surface_of_head_or_torso():
    head = np.array([0.0, 1.5, 1.0])
    term = pack_terms([StrikeTerm(kind="strike", tolerance=0.1)], BODY)
    for point, lands in [
        ((0.0, 1.5, 1.0 - 0.11 - 0.099), True),
        ((0.0, 1.5, 1.0 - 0.11 - 0.101), False),
        ((0.0, 1.1, 1.0 - 0.15 - 0.099), True),  # the torso
        ((0.0, 1.1, 1.0 - 0.15 - 0.101), False),
        ((0.0, 1.1, 1.0), False),  # deep inside, far from any surface
        ((0.0, 0.5, 1.0), False),  # below the pelvis
    ]:
        assert (min(surface_distance(point, head, BODY)) <= 0.1) is lands
        assert kernels.strike_lands(*point, *head, term, 0) is lands


def test_summed_proximity_does_not_depend_on_where_actions_are_cut():
    actions = random_actions(longest=4)
    action = int(np.flatnonzero(actions.lengths == 4)[0])
    term = ProximityTerm(kind="proximity", distance=0.5)
    target = np.array([0.3, 1.4, 1.1])
    path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]].astype(float)
    byhand = sum(
        0.97 ** (t + 1) * math.exp(-abs(math.hypot(target[0] - x, target[2] - z) - 0.5) / 0.5)
        for t, (x, z, _) in enumerate(path)
    )
    assert compiled(actions, action, target, (term,)) == pytest.approx(byhand, rel=1e-5)


def test_a_transition_costs_only_where_the_capture_is_cut():
    actions = random_actions()
    term = TransitionTerm(kind="transition", weight=0.5, each=0.1)
    for action, cost in enumerate(actions.costs):
        expected = -(0.5 * cost + 0.1) if cost > 0 else 0.0
        assert compiled(actions, action, (0, 1, 1), (term,)) == pytest.approx(expected, abs=1e-7)
