import naive_opponents
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from crowdsim.crowd.kd_tree import LEAF, build_tree, fit_tree, nearest, neighbours, sort_tree
from crowdsim.crowd.kernels.kd_queries import observe
from crowdsim.crowd.kernels.kd_tree import widen
from crowdsim.crowd.kernels.layout import Observed
from crowdsim.crowd.workers import Workers


def positions(kind, count, seed=0):
    rng = np.random.default_rng(seed)
    team = rng.integers(0, 2, count).astype(np.int32)
    if kind == "lattice":
        side = int(np.ceil(np.sqrt(count)))
        x, z = np.divmod(np.arange(count), side)
        order = rng.permutation(count)
        return x[order].astype(float), z[order].astype(float), team
    if kind == "one place":
        return np.full(count, 3.5), np.full(count, -1.25), team
    if kind == "line":
        return np.zeros(count), rng.permutation(count).astype(float), team
    x, z = rng.uniform(-20, 20, (2, count))
    if kind == "armies":
        x = x + 1000.0 * team
    if kind == "clusters":
        x, z = np.round(x / 10) * 10 + rng.normal(0, 0.1, count), np.round(z / 10) * 10 + rng.normal(0, 0.1, count)
    return x, z, team


KINDS = ["spread", "lattice", "one place", "line", "armies", "clusters"]
everything = {"kind": st.sampled_from(KINDS), "count": st.integers(1, 300), "seed": st.integers(0, 99)}


def ask_all(tree, order, skip_team=True, workers=None):
    """Nearest opponent of every point, by the numbers that the points came with."""
    own = np.arange(len(order), dtype=np.int32)
    skipped = tree.team if skip_team else np.full(len(order), -1, np.int32)
    found, distance = nearest(tree, tree.xs, tree.zs, own, skipped, workers or Workers(1))
    result = np.empty(len(order), int)
    result[order] = np.where(found >= 0, order[found], -1)
    return result, distance


@settings(deadline=None, max_examples=60)
@given(skip_team=st.booleans(), **everything)
def test_the_nearest_opponent_is_that_of_a_direct_comparison(kind, count, seed, skip_team):
    x, z, team = positions(kind, count, seed)
    tree, order = build_tree(x, z, team)
    found, _ = ask_all(tree, order, skip_team)
    skipped = team if skip_team else np.full(count, -1)
    assert found.tolist() == [naive_opponents.nearest(x, z, team, x[i], z[i], i, skipped[i]) for i in range(count)]


@settings(deadline=None, max_examples=40)
@given(most=st.integers(1, 9), **everything)
def test_neighbours_are_those_of_a_direct_comparison_nearest_first(kind, count, seed, most):
    x, z, team = positions(kind, count, seed)
    tree, order = build_tree(x, z, team)
    own = np.arange(count, dtype=np.int32)
    counts, points = neighbours(tree, tree.xs, tree.zs, own, 1.5, most)
    for place, i in enumerate(order):
        expected = naive_opponents.neighbours(x, z, x[i], z[i], i, 1.5, most)
        assert order[points[place, : counts[place]]].tolist() == expected


@pytest.mark.parametrize("kind", KINDS)
def test_points_that_move_are_found_where_they_are_once_boxes_are_widened(kind):
    count, rng = 500, np.random.default_rng(1)
    tree, order = build_tree(*positions(kind, count, 1))
    for i in rng.choice(count, 20).tolist():
        tree.xs[i], tree.zs[i] = rng.uniform(-9, 9, 2)
        widen(tree, i)
    x, z = np.empty((2, count))
    x[order], z[order] = tree.xs, tree.zs
    counts, points = neighbours(tree, tree.xs, tree.zs, np.arange(count, dtype=np.int32), 1.5, 6)
    for place, i in enumerate(order):
        expected = naive_opponents.neighbours(x, z, x[i], z[i], i, 1.5, 6)
        assert order[points[place, : counts[place]]].tolist() == expected


@settings(deadline=None, max_examples=40)
@given(most=st.integers(1, 9), **everything)
def test_observing_in_groups_finds_what_single_queries_find(kind, count, seed, most):
    observe_and_compare(kind, count, seed, most, 0.5)


@pytest.mark.parametrize(("kind", "count"), [("clusters", 3000), ("one place", 20_000)])
def test_observing_finds_the_same_where_more_is_near_than_can_be_shared(kind, count):
    observe_and_compare(kind, count, 0, 5, 30 / count)


def observe_and_compare(kind, count, seed, most, share):
    x, z, team = positions(kind, count, seed)
    tree, order = build_tree(x, z, team)
    rng = np.random.default_rng(seed)
    due = np.flatnonzero(rng.random(count) < share).astype(np.int32)
    skipped = np.where(rng.random(count) < 0.2, rng.integers(-2, 0, count), tree.team).astype(np.int32)
    guess = rng.integers(-1, count, count).astype(np.int32)
    slot_of = np.argsort(order).astype(np.int32)
    found, counts, points = (np.empty(shape, np.int32) for shape in (len(due), len(due), (len(due), most)))
    observe(tree, due, skipped, guess, slot_of, 1.5, Observed(found, counts, points))
    skipped = skipped[due]
    single, _ = nearest(tree, tree.xs[due], tree.zs[due], due, skipped)
    assert found.tolist() == np.where(skipped == -2, -1, single).tolist()
    single_counts, single_points = neighbours(tree, tree.xs[due], tree.zs[due], due, 1.5, most)
    assert counts.tolist() == single_counts.tolist()
    for q in range(len(due)):
        assert set(points[q, : counts[q]]) == set(single_points[q, : counts[q]])


@pytest.mark.parametrize("kind", KINDS)
def test_five_thousand_avatars_get_the_distances_of_scipy(kind):
    x, z, team = positions(kind, 5000)
    tree, order = build_tree(x, z, team)
    found, distance = ask_all(tree, order)
    for side in (0, 1):
        theirs = cKDTree(np.column_stack([x, z])[team != side])
        expected, _ = theirs.query(np.column_stack([x, z])[order[tree.team == side]])
        np.testing.assert_allclose(np.sqrt(distance[tree.team == side]), expected, rtol=1e-12, atol=1e-12)
    assert (team[found] != team).all()


def test_among_equally_distant_opponents_the_lower_number_decides():
    x, z = np.array([0.0, 1.0, -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0, -1.0])
    for numbers in ([0, 1, 2, 3, 4], [4, 3, 2, 1, 0], [2, 4, 0, 3, 1]):
        centre = numbers.index(0)
        team = np.arange(5, dtype=np.int32)
        tree, order = build_tree(x[numbers], z[numbers], team)
        found, _ = ask_all(tree, order)
        assert found[centre] == (1 if centre == 0 else 0)


def test_refitted_boxes_stay_exact_after_avatars_have_moved():
    rng = np.random.default_rng(5)
    x, z, team = positions("spread", 2000)
    tree, order = build_tree(x, z, team)
    tree.xs[:] += rng.normal(0, 5, 2000)
    tree.zs[:] += rng.normal(0, 5, 2000)
    fit_tree(tree)
    found, _ = ask_all(tree, order)
    x[order], z[order] = tree.xs, tree.zs
    for i in range(0, 2000, 17):
        assert found[i] == naive_opponents.nearest(x, z, team, x[i], z[i], i, team[i])


def test_two_threads_sort_fit_and_find_the_same_as_one():
    x, z, team = positions("spread", 60_000)
    tree, order = build_tree(x, z, team)
    with Workers(2) as two:
        again, same = build_tree(x, z, team)
        again.xs[:], again.zs[:] = x, z
        assert np.array_equal(sort_tree(again, two), same)
        again.boxes[:] = np.nan
        fit_tree(again, two)
        assert np.array_equal(again.boxes[1:], tree.boxes[1:])
        assert np.array_equal(ask_all(tree, order)[0], ask_all(again, same, workers=two)[0])


def test_thirty_avatars_are_one_leaf():
    x, z, team = positions("spread", 30)
    tree, _ = build_tree(x, z, team)
    assert tree.depth == 0
    assert LEAF == 32


@pytest.mark.parametrize("count", [31, 32, 33, 64, 65, 1000, 4097])
def test_no_leaf_holds_more_than_its_share(count):
    tree, _ = build_tree(*positions("spread", count)[:2])
    leaves = 1 << tree.depth
    sizes = np.diff([(leaf * count) >> tree.depth for leaf in range(leaves + 1)])
    assert sizes.max() <= LEAF
    assert sizes.sum() == count


def test_without_another_team_no_opponent_is_found():
    x, z, _ = positions("spread", 100)
    tree, order = build_tree(x, z, np.zeros(100, np.int32))
    assert (ask_all(tree, order)[0] == -1).all()


def test_no_points_make_a_tree_in_which_nothing_is_found():
    tree, _ = build_tree([], [], [])
    found, _ = nearest(tree, np.zeros(1), np.zeros(1), np.full(1, -1, np.int32), np.full(1, -1, np.int32))
    assert found.tolist() == [-1]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_position_that_is_not_finite_is_refused_by_its_index(bad):
    with pytest.raises(ValueError, match="point 1 is at"):
        build_tree([0.0, bad], [0.0, 0.0])
