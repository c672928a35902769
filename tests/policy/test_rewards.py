"""Rewards: the compiled ones against the plain ones, and what they mean."""

import math
from functools import lru_cache
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import pytest
from naive_policy import action_reward, comes_through, random_actions
from naive_policy import surface_distance as naive_distance

from crowdsim.core.bodies import PosedBody, lands_on_posed_body
from crowdsim.crowd.kernels.records import ACTION, REACH
from crowdsim.crowd.kernels.rewards import Options, add_strikes
from crowdsim.errors import RecipeError
from crowdsim.policy.actions import Actions
from crowdsim.policy.axes.axis import Target
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.kernels import rewards as kernels
from crowdsim.policy.policy import Behaviour, build_lookup_tables
from crowdsim.policy.rewards import (
    WASTED,
    AnyTerm,
    ProximityTerm,
    StrikeTerm,
    TargetBody,
    Term,
    TransitionTerm,
    pack_terms,
    posed_distance,
    surface_distance,
)
from crowdsim.policy.rewards import lands as landing
from crowdsim.policy.terms import strike
from crowdsim.policy.terms.registry import TERMS as REGISTERED
from crowdsim.policy.terms.registry import names
from crowdsim.training.model import build_model, build_movement

BODY = TargetBody()
TERMS = [
    StrikeTerm(kind="strike", tolerance=0.12),
    StrikeTerm(kind="strike", tolerance=0.3, speed_weight=2.0, weight=3.0),
    ProximityTerm(kind="proximity", distance=0.5),
    ProximityTerm(kind="proximity", form="max", facing=True, distance=0.8, sigma=0.2),
    TransitionTerm(kind="transition", weight=0.5, each=0.1),
    StrikeTerm(kind="strike", weight=2.0, tolerance=0.2, form="sum"),
    StrikeTerm(kind="strike", tolerance=0.2, effort=0.3),
    StrikeTerm(kind="strike", weight=1.5, tolerance=0.2, waste=0.4),
    StrikeTerm(kind="strike", tolerance=0.3, form="sum", effort=0.1, waste=0.2, weight=0.7),
    ProximityTerm(kind="proximity", distance=(0.4, 0.9), sigma=0.3),
    ProximityTerm(kind="proximity", distance=(0.4, 0.9), facing=True, aside=0.2, sigma=0.3),
    ProximityTerm(kind="proximity", distance=(0.2, 0.5), facing=True, aside=0.1, form="max", weight=0.5),
]
NAMES = [
    "strike", "fast strike", "proximity", "greatest proximity ahead", "transition", "sum of strikes", "effort", "waste",
    "all of a strike", "a band", "a band ahead", "greatest in a band ahead",
]  # fmt: skip


GRID = build_grid([Axis("distance", 0.0, 2.0, 2)])


def compiled(actions, action, target, terms, velocity=(0.0, 0.0), discount=0.97):
    table = np.zeros(actions.state_count * GRID.cells, np.float32)
    behaviour = Behaviour("one", GRID, "v", table, 1.0, tuple(terms), discount)
    seen = Target(*map(float, target), *map(float, velocity), 0.0)
    return kernels.action_reward(build_lookup_tables(actions, (behaviour,), BODY), 0, action, seen)


def strike_lands(fist, origin, head, terms):
    """Whether a strike lands by the first of some terms."""
    return bool(strike.lands.py_func(fist, origin, head, strike.read_surface.py_func(terms.view(np.recarray)[0])))


@pytest.mark.parametrize("term", TERMS, ids=NAMES)
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


@pytest.mark.parametrize(
    "terms",
    [
        TERMS,
        [StrikeTerm(kind="strike", form="sum", effort=0.2, waste=0.7), *TERMS[3:]],
        [ProximityTerm(kind="proximity", distance=(0.4, 0.7), facing=True, aside=0.2, weight=2.0)],
        [ProximityTerm(kind="proximity", distance=0.6, sigma=0.01)],  # too far to count almost everywhere
    ],
    ids=["all", "spent", "facing", "narrow"],
)
def test_a_model_earns_in_each_cell_what_the_plain_version_says(terms):
    actions = random_actions(states=3)
    axes = [Axis("distance", 0.1, 1.5, 6), Axis("bearing", -math.pi, math.pi, 7, True), Axis("height", 1.2, 1.8, 3)]
    grid, movement = build_grid(axes), build_movement(0.6, 3, 0.4)
    earned = build_model(actions, grid, tuple(terms), BODY, 0.97, movement).rewards(0, actions.action_count)
    outcomes = list(zip(movement.probabilities, movement.velocities, strict=True))
    expected = [
        [
            sum(p * action_reward(actions, a, target, tuple(terms), BODY, 0.97, way) for p, way in outcomes)
            for target in grid.targets()
        ]
        for a in range(actions.action_count)
    ]
    np.testing.assert_allclose(earned, expected, rtol=1e-5, atol=5e-6)
    assert np.count_nonzero(np.abs(expected) > 1e-3) > 20


class Toy(Term):
    """A term that is not registered."""

    kind: Literal["toy"] = "toy"


def test_a_term_that_is_not_registered_is_refused_by_name():
    grid = build_grid([Axis("distance", 0.0, 2.0, 3)])
    for use in (
        lambda: pack_terms([*TERMS, Toy()], BODY),
        lambda: build_model(random_actions(), grid, (*TERMS, Toy()), BODY, 0.97),
    ):
        with pytest.raises(RecipeError) as error:
            use()
        assert str(error.value) == "'toy' is no reward term, expected one of strike, proximity, transition, hit"


def test_every_registered_term_has_a_key_in_recipes():
    assert set(get_args(get_args(AnyTerm)[0])) == set(REGISTERED)
    assert names() == ["strike", "proximity", "transition", "hit"]


def test_terms_add_up():
    actions = random_actions()
    target = (0.2, 1.4, 0.7)
    for action in range(len(actions.next)):
        parts = math.fsum(compiled(actions, action, target, (term,)) for term in TERMS)
        assert compiled(actions, action, target, TERMS) == pytest.approx(parts, abs=1e-9)


def test_a_fist_lands_within_the_tolerance_of_the_surface_of_head_or_torso():
    head = np.array([0.0, 1.5, 1.0])
    term = pack_terms([StrikeTerm(kind="strike", tolerance=0.1)], BODY)
    for point, lands in [
        ((0.0, 1.5, 1.0 - 0.11 - 0.099), True),
        ((0.0, 1.5, 1.0 - 0.11 - 0.101), False),
        ((0.0, 1.1, 1.0 - 0.15 - 0.099), True),  # the torso
        ((0.0, 1.1, 1.0 - 0.15 - 0.101), False),
        ((0.0, 1.1, 1.0 - 0.15 + 0.099), True),  # inside
        ((0.0, 1.1, 1.0 - 0.15 + 0.101), False),
        ((0.0, 1.1, 1.0), False),  # deep inside, far from any surface
        ((0.0, 0.5, 1.0), False),  # below the pelvis
        ((0.0, 1.49, 1.0), True),  # in the head, where the torso ends
        ((0.0, 1.492, 1.005), False),  # deeper in the head, and still where the torso ends
    ]:
        assert landing(surface_distance(point, head, BODY), 0.1) is lands
        assert strike_lands(tuple(point), tuple(point[::2]), tuple(head), term) is lands


def test_the_distance_from_a_surface_is_signed_and_that_of_head_and_torso_together():
    head = np.array([0.0, 1.5, 1.0])
    assert surface_distance((0.0, 1.5 + 0.11 + 0.2, 1.0), head, BODY) == pytest.approx(0.2)
    assert surface_distance(head, head, BODY) == pytest.approx(-0.11)
    assert surface_distance((0.0, 1.1, 1.0), head, BODY) == pytest.approx(-0.15)
    # On the torso's surface, but a centimetre from the middle of the head.
    assert surface_distance((0.0, 1.5 - 0.16 + 0.15, 1.0), head, BODY) == pytest.approx(0.01 - 0.11)


@lru_cache
def points_near_a_body(scale):
    """Points around a body of a size, their distances from it by the naive twin, and its head, joints and radii."""
    points = np.random.default_rng(7).uniform([-0.4, 0.6, -0.4], [0.4, 1.9, 0.4], (800, 3))
    points = points.astype(np.float32).astype(float)
    head = np.array([0.01, 1.5, -0.02])
    neck, pelvis, *radii = BODY.under(head, scale)
    return points, [naive_distance(point, head, neck, pelvis, *radii) for point in points], head, neck, pelvis, radii


@pytest.mark.parametrize("tolerance", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("scale", [1.0, 1.3])
def test_compiled_control_and_training_land_as_the_naive_twin_does(tolerance, scale):
    body = TargetBody(**{name: size * scale for name, size in BODY})
    term = pack_terms([StrikeTerm(kind="strike", tolerance=tolerance)], body)
    points, distances, head, neck, pelvis, radii = points_near_a_body(scale)
    landed = 0
    by_actions = lands_in_control(points, head, term)
    for point, distance, added in zip(points, distances, by_actions, strict=True):
        if abs(abs(distance) - tolerance) < 1e-6:
            continue
        lands = abs(distance) <= tolerance
        landed += lands
        assert surface_distance(point, head, body) == pytest.approx(distance, abs=1e-7)
        assert landing(surface_distance(point, head, body), tolerance) == lands
        assert strike_lands(tuple(point), tuple(point[::2]), tuple(head), term) == lands
        posed = PosedBody(tuple(head), tuple(neck), tuple(pelvis), *map(float, radii))
        assert lands_on_posed_body(tuple(point), posed, tolerance) == lands
        assert added == lands
    assert 20 < landed < len(points) - 20


class Rewarded(NamedTuple):
    """What control reads of a model for strikes."""

    actions: Any
    strikes: Any
    earnings: Any
    terms: Any


def lands_in_control(points, head, term, origin=None):
    """Whether an action with one strike at each point earns anything by what control adds to its value."""
    count = len(points)
    actions, strikes = np.zeros(count + 1, ACTION), np.zeros(count, REACH)
    actions["strikes"] = np.arange(count + 1)
    strikes["x"], strikes["y"], strikes["z"] = points.T
    strikes["from_x"], strikes["from_z"] = points[:, [0, 2]].T if origin is None else origin
    strikes["owner"], earnings = np.arange(count), np.tile(np.array([1.0, 0.0], np.float32), (count, 1))
    row = term.copy()
    row["column"] = 0
    out = np.zeros(count)
    model = Rewarded(actions, strikes, earnings, row)
    target = Target(*head)
    add_strikes(model, 0, Options(0, count, out), target, 1.0, np.empty(count))
    return out == 1.0


def test_a_kick_that_comes_through_a_body_does_not_land_on_its_far_side():
    term = pack_terms([StrikeTerm(kind="strike", tolerance=0.1)], TargetBody())
    head, origin = np.array([0.0, 1.6, 0.8]), (0.0, 0.0)
    ends = {0.45: False, 0.65: True, 0.74: True, 0.95: False, 1.3: False}
    points = np.array([[0.0, 1.2, end] for end in ends])
    np.testing.assert_array_equal(lands_in_control(points, head, term, origin), list(ends.values()))
    # A punch may land there, if an arm gets there at all.
    assert lands_in_control(points, head, term).tolist() == [False, True, True, True, False]
    for point, expected in zip(points, ends.values(), strict=True):
        assert strike_lands(tuple(point), origin, tuple(head), term) is expected
        assert comes_through(point, origin, head) is bool(point[2] > 0.84)


def test_posed_bodies_are_as_far_away_as_the_naive_twin_says():
    draw = np.random.default_rng(8)
    points, heads, necks, pelvises = draw.normal(0.0, 0.3, (4, 50, 3))
    radii = draw.uniform(0.05, 0.3, (2, 50))
    found = posed_distance(points, heads, necks, pelvises, *radii)
    expected = [naive_distance(*row) for row in zip(points, heads, necks, pelvises, *radii, strict=True)]
    np.testing.assert_allclose(found, expected, atol=1e-7)


def test_summed_proximity_does_not_depend_on_how_motion_is_divided_into_actions():
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


def one_action(strikes=(), path=((0.0, 0.0, 0.0),)):
    """The actions of one state that has one: along a path, striking at places and times."""
    count = len(strikes)
    return Actions(
        offsets=np.array([0, 1], np.int32),
        next=np.zeros(1, np.int32),
        lengths=np.array([len(path)], np.int32),
        shifts=np.zeros((1, 3), np.float32),
        costs=np.zeros(1, np.float32),
        path_offsets=np.array([0, len(path)], np.int32),
        paths=np.array(path, np.float32),
        strike_offsets=np.array([0, count], np.int32),
        strike_times=np.array([time for time, _ in strikes], np.float32),
        strike_positions=np.array([place for _, place in strikes], np.float32).reshape(-1, 3),
        strike_origins=np.array([place[::2] for _, place in strikes], np.float32).reshape(-1, 2),
        strike_speeds=np.ones(count, np.float32),
        strike_ids=np.arange(count, dtype=np.int32),
    )


def both(actions, target, term):
    """What a term says by the plain version, which the compiled one must say too."""
    plain = action_reward(actions, 0, target, (term,), BODY, 0.9)
    assert compiled(actions, 0, target, (term,), discount=0.9) == pytest.approx(plain, rel=1e-6, abs=1e-9)
    return plain


def test_effort_is_spent_on_every_strike_and_waste_on_those_far_from_the_target():
    head = np.array([0.0, 1.5, 1.0])
    on, near, far = ((0.0, 1.5, 1.0 - away) for away in (0.11, WASTED - 0.01, WASTED + 0.01))
    actions = one_action([(1.0, on), (2.0, near), (3.0, far)])
    strike = {"kind": "strike", "weight": 2.0}
    assert both(actions, head, StrikeTerm(**strike)) == pytest.approx(2 * 0.9)
    assert both(actions, head, StrikeTerm(**strike, effort=0.1)) == pytest.approx(
        2 * (0.9 - 0.1 * (0.9 + 0.81 + 0.729))
    )
    assert both(actions, head, StrikeTerm(**strike, waste=0.1)) == pytest.approx(2 * (0.9 - 0.1 * 0.729))


def test_landed_strikes_add_up_where_their_sum_is_asked_for():
    head = np.array([0.0, 1.5, 1.0])
    on, off = (0.0, 1.5, 1.0 - 0.11), (0.0, 1.5, 0.2)
    actions = one_action([(1.0, on), (2.0, off), (3.0, on)])
    assert both(actions, head, StrikeTerm(kind="strike", form="sum")) == pytest.approx(0.9 + 0.729)
    assert both(actions, head, StrikeTerm(kind="strike", form="max")) == pytest.approx(0.9)


def test_proximity_to_a_band_is_constant_within_and_zero_outside():
    actions = one_action()
    band = ProximityTerm(kind="proximity", distance=(0.4, 0.9), sigma=0.5)
    for distance, gap in [(0.4, 0.0), (0.6, 0.0), (0.9, 0.0), (0.3, 0.1), (1.1, 0.2), (0.0, 0.4)]:
        for bearing in (0.0, 1.0, np.pi):
            target = np.array([distance * np.sin(bearing), 1.5, distance * np.cos(bearing)])
            assert both(actions, target, band) == pytest.approx(0.9 * math.exp(-gap / 0.5), rel=1e-6)


def test_to_the_side_of_straight_ahead_is_as_good_so_far():
    actions = one_action()
    term = ProximityTerm(kind="proximity", distance=(0.4, 0.9), sigma=0.5, facing=True, aside=0.2)
    for x, z, gap in [(0.0, 0.5, 0.0), (0.2, 0.5, 0.0), (-0.2, 0.9, 0.0), (0.5, 0.9, 0.3), (-0.5, 1.3, 0.5)]:
        assert both(actions, np.array([x, 1.5, z]), term) == pytest.approx(0.9 * math.exp(-gap / 0.5), rel=1e-6)


def test_a_target_that_stops_is_rewarded_where_it_stops():
    actions = one_action([(3.0, (0.0, 1.5, 1.0 - 0.11))], path=[(0.0, 0.0, 0.0)] * 4)
    start, velocity = np.array([0.0, 1.5, 0.8]), (0.0, 0.1)
    strike, near = StrikeTerm(kind="strike", tolerance=0.05), ProximityTerm(kind="proximity", distance=1.0, sigma=0.5)
    for term, lasts, expected in [
        (strike, 2.0, 0.9**3),
        (strike, 1.0, 0.0),
        (strike, math.inf, 0.0),
        (near, 2.0, sum(0.9**t * math.exp(-gap / 0.5) for t, gap in zip(range(1, 5), (0.1, 0, 0, 0), strict=True))),
    ]:
        found = action_reward(actions, 0, start, (term,), BODY, 0.9, velocity, lasts)
        assert found == pytest.approx(expected, abs=1e-9)


def test_only_transitions_have_a_cost():
    actions = random_actions()
    term = TransitionTerm(kind="transition", weight=0.5, each=0.1)
    for action, cost in enumerate(actions.costs):
        expected = -(0.5 * cost + 0.1) if cost > 0 else 0.0
        assert compiled(actions, action, (0, 1, 1), (term,)) == pytest.approx(expected, abs=1e-7)
