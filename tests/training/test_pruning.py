"""Pruning: the transitions that are worth most to the behaviours are kept, and nothing else changes."""

import numpy as np
import pytest
from naive_pruning import transitions_worth_keeping

from crowdsim.errors import RecipeError
from crowdsim.graph.motion_graph import build_graph
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.actions import STEP, STILLEST, build_actions, joint_speeds, stillness
from crowdsim.policy.alignment import align_actions
from crowdsim.policy.rewards import target_body
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.evaluation import run_episodes
from crowdsim.training.motion_loading import load_motion
from crowdsim.training.pruning import judge_transitions, prune_graph
from crowdsim.training.ranges import FAR, sample_targets, strike_reach
from crowdsim.training.recipe import PruningSpec, load_recipe
from crowdsim.training.train import train_policy

RECIPE = """\
version: 1
motion:
  performer:
    seconds: 20
    seed: 3
graph:
  branching: 16
behaviours:
  approach:
    axes:
      distance:
        minimum: 0
        maximum: 5
        count: 11
      bearing:
        count: 16
    rewards:
      - kind: proximity
      - kind: transition
        weight: 0.3
  punch:
    axes:
      distance:
        count: 8
        fade: 0.5
      bearing:
        count: 12
    rewards:
      - kind: strike
      - kind: transition
        weight: 0.3
"""


@pytest.fixture(scope="module")
def recipe(tmp_path_factory):
    path = tmp_path_factory.mktemp("pruning") / "wide.yaml"
    path.write_text(RECIPE)
    return load_recipe(path)


@pytest.fixture(scope="module")
def motion(recipe):
    return load_motion(recipe, [])


@pytest.fixture(scope="module")
def wide(recipe, motion):
    return build_graph(motion, recipe.graph)


def prune(motion, wide, recipe, **settings):
    return prune_graph(motion, wide, recipe.behaviours, target_body(motion), PruningSpec(**settings))


def test_kept_transitions_are_among_the_given_ones_and_no_frame_has_too_many(motion, wide, recipe):
    graph = prune(motion, wide, recipe, transitions=3, spacing=0.0, landing=0.0)
    before = set(zip(wide.transition_from.tolist(), wide.transition_to.tolist(), strict=True))
    after = set(zip(graph.transition_from.tolist(), graph.transition_to.tolist(), strict=True))
    assert after < before
    assert np.bincount(graph.transition_from).max() == 3
    assert np.bincount(wide.transition_from).max() > 3
    assert graph.frames_kept.sum() > 0.9 * wide.frames_kept.sum()


def test_decisions_lie_apart(motion, wide, recipe):
    graph = prune(motion, wide, recipe, transitions=4, spacing=0.5)
    sources = np.unique(graph.transition_from)
    clips = np.searchsorted(motion.clip_starts, sources, side="right")
    apart = np.diff(sources)[np.diff(clips) == 0]
    assert apart.min() >= round(0.5 * motion.control_rate)
    assert graph.action_lengths.mean() > 1.5 * wide.action_lengths.mean()


def test_no_transition_enters_just_before_a_decision(motion, wide, recipe):
    near, clear = (prune(motion, wide, recipe, transitions=4, spacing=0.4, landing=landing) for landing in (0.0, 0.33))
    shortest = [graph.action_lengths[graph.action_has_transition].min() for graph in (near, clear)]
    assert shortest[0] == 1
    assert shortest[1] >= round(0.33 * motion.control_rate)
    assert np.bincount(clear.transition_from).max() == 4


def test_judged_transitions_match_naive(motion, wide, recipe):
    actions, body = build_actions(motion, wide), target_body(motion)
    keep, gains = judge_transitions(motion, wide, actions, recipe.behaviours, body, most=3)
    expected_keep, expected_gains = transitions_worth_keeping(motion, wide, actions, recipe.behaviours, body, most=3)
    states = np.arange(0, wide.captured_states(motion.captured_frames), 7)
    assert len(keep) == len(gains) == wide.action_count // 2
    some = np.concatenate([np.arange(*wide.action_offsets[s : s + 2]) for s in states])
    np.testing.assert_array_equal(keep[some], expected_keep[some])
    np.testing.assert_allclose(gains[some], expected_gains[some], rtol=1e-4, atol=1e-7)


def returns_of(recipe, motion, graph, name, far):
    """Mean return of 400 episodes of a behaviour that is learned on a graph, towards targets ``far`` away."""
    actions, body = build_actions(motion, graph), target_body(motion)
    behaviour, _ = train_behaviour(name, recipe.behaviours[name], motion, actions, body)
    draw = np.random.default_rng(1)
    states = draw.integers(0, actions.state_count, 400).astype(np.int32)
    distance, bearing = draw.uniform(*far, 400), draw.uniform(-np.pi, np.pi, 400)
    targets = np.stack([distance * np.sin(bearing), np.full(400, 1.5), distance * np.cos(bearing)], axis=-1)
    return run_episodes(actions, behaviour, body, motion.control_rate, states, targets).returns.mean()


@pytest.mark.parametrize(
    ("name", "far", "share"), [("approach", (0.6, 4.0), 0.95), ("punch", (0.3, 1.6), 0.75)], ids=["approach", "punch"]
)
def test_the_most_valuable_transitions_earn_more_than_as_many_cheap_ones(tmp_path, name, far, share):
    shares = []
    for seed in (3, 4, 5):
        (tmp_path / "wide.yaml").write_text(RECIPE.replace("seed: 3", f"seed: {seed}"))
        recipe = load_recipe(tmp_path / "wide.yaml")
        motion = load_motion(recipe, [])
        wide = build_graph(motion, recipe.graph)
        cheap = build_graph(motion, recipe.graph.model_copy(update={"branching": 5}))
        worthy = prune(motion, wide, recipe, transitions=5, spacing=0.0, landing=0.0)
        earned = [returns_of(recipe, motion, graph, name, far) for graph in (cheap, worthy, wide)]
        assert worthy.action_count < 0.5 * wide.action_count
        assert earned[1] > 1.03 * earned[0]
        shares.append(earned[1] / earned[2])
    # Half of the targets that transitions are judged by move; here none does.
    assert np.mean(shares) > share


def test_targets_lie_all_around_and_half_of_them_within_reach(motion):
    targets = sample_targets(motion)
    distance, bearing = np.hypot(targets[:, 0], targets[:, 2]), np.arctan2(targets[:, 0], targets[:, 2])
    low, high = strike_reach(motion).distance
    assert np.count_nonzero((distance >= low) & (distance <= high)) >= len(targets) // 2
    assert distance.max() <= FAR
    assert np.histogram(bearing, 4, (-np.pi, np.pi))[0].min() > len(targets) // 8
    assert distance.max() > 0.9 * FAR


def test_training_prunes_alike_on_two_threads_and_reports_it(recipe):
    pruned = recipe.model_copy(update={"prune": PruningSpec(transitions=4)})
    stages = []
    one, timings = train_policy(pruned, "wide", progress=lambda stage, done, total: stages.append(stage))
    two, _ = train_policy(pruned, "wide", threads=2)
    whole, _ = train_policy(recipe, "wide")
    assert one.graph.action_count < 0.6 * whole.graph.action_count
    assert one.values.tobytes() == two.values.tobytes()
    assert one.graph.action_first.tobytes() == two.graph.action_first.tobytes()
    assert one.fingerprint != whole.fingerprint
    assert timings["prune"] > 0.0
    assert "prune, transitions" in stages


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("prune: {ways: 3}", r"prune\.ways: unknown key, it is now called 'transitions'"),
        ("prune: {transition: 3}", r"prune\.transition: unknown key.*did you mean 'transitions'"),
        ("prune: {transitions: 0}", r"prune\.transitions: is 0, expected a whole number from 1 to 1000"),
        ("prune: {landing: soon}", r"prune\.landing: is 'soon', expected a number"),
        ("prune: {spacing: -1}", r"prune\.spacing: is -1, expected a number from 0.0 to 1000.0"),
    ],
)
def test_wrong_settings_are_reported_with_their_position(tmp_path, line, message):
    (tmp_path / "bad.yaml").write_text(RECIPE + line + "\n")
    with pytest.raises(RecipeError, match=message):
        load_recipe(tmp_path / "bad.yaml")


def test_a_transition_at_rest_counts_as_more_visible_than_one_in_motion(motion, wide):
    speeds = joint_speeds(motion)
    assert speeds.shape == (motion.frame_count,)
    factors = stillness(motion, wide)
    before = wide.state_frames[wide.action_states]
    slow = np.minimum(speeds[before], speeds[wide.action_first - 1])
    assert np.all(np.diff(factors[np.argsort(slow)]) <= 0.0)
    assert factors.max() <= STILLEST
    actions, steps = build_actions(motion, wide), align_actions(motion, wide).steps
    expected = wide.action_costs / wide.threshold * factors + STEP * steps
    np.testing.assert_allclose(actions.costs, expected, rtol=1e-6)
    assert np.all((actions.costs > 0.0) == wide.action_has_transition)


def test_joint_speeds_match_differences_of_positions(motion):
    frame, reach = 40, 3
    steps = []
    for row in (frame + np.arange(-reach, reach + 1)) * motion.stride:
        rows = slice(row, row + 2)
        places, _ = forward_kinematics(motion.skeleton, motion.root_positions[rows], motion.rotations[rows])
        steps.append(np.linalg.norm(np.diff(places.astype(float), axis=0)[0], axis=-1) * motion.playback_rate)
    assert joint_speeds(motion)[frame] == pytest.approx(np.sqrt(np.mean(np.square(steps))), rel=1e-6)
