"""Mirrored motion: a graph that is its own mirror image, and half of whose states are solved."""

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.graph.motion_graph import build_graph
from crowdsim.graph.states import graph_of_transitions
from crowdsim.graph.transitions import Transitions
from crowdsim.policy.actions import build_actions
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.policy.rewards import target_body
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.mirroring import mirrored_points, solved_states, values_with_images
from crowdsim.training.motion_loading import load_motion
from crowdsim.training.pruning import prune_graph
from crowdsim.training.recipe import PruningSpec, Recipe
from crowdsim.training.solution import value_spread

GRID = {"distance": {"minimum": 0, "maximum": 5, "count": 11}, "bearing": {"count": 15}}
STILL, MOVING = {"speed": 0.0}, {"speed": 1.0, "directions": 3, "still": 0.4}
SPEC = {
    "axes": GRID,
    "rewards": [{"kind": "strike"}, {"kind": "proximity", "facing": True}, {"kind": "transition", "weight": 0.3}],
    "solver": {"kind": "value_iteration", "tolerance": 1e-5},
}


def recipe_of(**behaviour):
    return Recipe.model_validate(
        {
            "version": 1,
            "motion": {"performer": {"seconds": 20, "seed": 3}},
            "graph": {"branching": 8},
            "behaviours": {"fight": {**SPEC, **behaviour}},
        }
    )


@pytest.fixture(scope="module")
def motion():
    return load_motion(recipe_of(), [])


@pytest.fixture(scope="module")
def wide(motion):
    return build_graph(motion, recipe_of().graph)


@pytest.fixture(scope="module")
def pruned(motion, wide):
    return prune_graph(motion, wide, recipe_of().behaviours, target_body(motion), PruningSpec(transitions=4))


@pytest.mark.parametrize("name", ["wide", "pruned"])
def test_the_graph_of_mirrored_motion_is_its_own_mirror_image(motion, name, request):
    graph, frames = request.getfixturevalue(name), motion.frame_count
    half = motion.captured_frames
    assert 2 * half == frames
    transitions = dict(
        zip(zip(graph.transition_from, graph.transition_to, strict=True), graph.transition_costs, strict=True)
    )
    images = {((i + half) % frames, (j + half) % frames): cost for (i, j), cost in transitions.items()}
    assert images == transitions
    np.testing.assert_array_equal(graph.frames_kept, np.roll(graph.frames_kept, half))
    assert graph.captured_states(half) == graph.state_count // 2


def test_a_graph_that_is_not_its_own_mirror_image_is_known(motion, wide):
    transitions = Transitions(wide.transition_from, wide.transition_to, wide.transition_costs)
    whole = graph_of_transitions(transitions, motion.clip_starts, wide.threshold)
    less = graph_of_transitions(
        transitions.chosen(np.arange(len(transitions)) != 5), motion.clip_starts, wide.threshold
    )
    half = motion.captured_frames
    assert whole.captured_states(half) == wide.state_count // 2
    assert less.captured_states(half) == less.state_count
    assert wide.captured_states(motion.frame_count) == wide.state_count


@pytest.mark.parametrize("target", [STILL, MOVING], ids=["still", "moving"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"lookup": "q"},
        {"finer": 2},
        {"axes": {**GRID, "heading": {"count": 6}}},
        {
            "axes": {**GRID, "velocity": {"count": 3}, "impact": {"count": 4}},
            "rewards": [*SPEC["rewards"], {"kind": "hit"}],
        },
    ],
    ids=["v", "q", "finer", "heading", "velocity and impact"],
)
def test_values_of_captured_states_and_their_images_are_those_of_all_states(motion, pruned, target, options):
    spec = recipe_of(target=target, **options).behaviours["fight"]
    actions, body = build_actions(motion, pruned), target_body(motion)
    solved = solved_states(motion, pruned, [spec])
    assert solved == pruned.state_count // 2
    half, of_half = train_behaviour("fight", spec, motion, actions, body, solved=solved)
    whole, of_whole = train_behaviour("fight", spec, motion, actions, body)
    assert half.table.shape == whole.table.shape
    assert of_half.values.shape == of_whole.values.shape
    spread = value_spread(of_whole.values)
    np.testing.assert_allclose(of_half.values, of_whole.values, atol=1e-3 * spread)
    np.testing.assert_allclose(half.table, whole.table, atol=1e-3 * spread)
    assert half.scale == pytest.approx(whole.scale, rel=0.05)


def test_all_states_are_solved_where_halves_may_differ(motion, pruned):
    count = pruned.state_count
    one_sided = {**GRID, "bearing": {"minimum": -1.0, "maximum": 2.0, "count": 8}}
    paper = {"backup": "max_of_interpolated"}
    for changes in ({"axes": one_sided}, paper, {**paper, "solver": {"kind": "q_learning"}}):
        assert solved_states(motion, pruned, recipe_of(**changes).behaviours.values()) == count
    own = replace(motion, clip_names=tuple(f"clip {c}" for c in range(len(motion.clip_names))))
    assert own.captured_frames == own.frame_count
    assert solved_states(own, pruned, recipe_of().behaviours.values()) == count


@pytest.mark.parametrize("count", [7, 8])
def test_the_mirror_image_of_a_cell_is_where_the_mirror_image_of_its_target_is(count):
    axes = [Axis("distance", 0.5, 2.0, 3), Axis("bearing", -np.pi, np.pi, count, wraps=True), Axis("height", 1, 2, 2)]
    grid = build_grid([*axes, Axis("heading", -np.pi, np.pi, count + 1, wraps=True)])
    observed = grid.observed()
    targets = np.stack([*observed[:3], np.sin(observed.heading), np.cos(observed.heading)]).astype(np.float32)
    images = values_with_images(targets, grid)[len(targets) :]
    np.testing.assert_allclose(images, targets * [[-1.0], [1.0], [1.0], [-1.0], [1.0]], atol=1e-6)


@pytest.mark.parametrize("name", ["bearing", "heading"])
def test_angles_that_reach_as_far_to_the_left_as_to_the_right_have_mirror_images(name):
    assert mirrored_points(Axis(name, -1.0, 1.0, 4)).tolist() == [3, 2, 1, 0]
    assert mirrored_points(Axis(name, -1.0, 1.5, 4)) is None
    assert mirrored_points(Axis(name, 0.1, 0.1 + 2 * np.pi, 4, wraps=True)) is None


def test_distances_are_their_own_mirror_images():
    plain = build_grid([Axis("distance", 0.5, 2.0, 3)])
    values = np.arange(3.0).reshape(1, 3)
    np.testing.assert_array_equal(values_with_images(values, plain), [values[0], values[0]])
