"""Bundles hold falls as actions behind those that states choose among."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from falling import falling_policy, recipe
from naive_policy import action_values

from crowdsim.errors import PolicyError
from crowdsim.graph.features import frame_features
from crowdsim.motion import ground
from crowdsim.performer.cheers import CHEERS
from crowdsim.performer.falls import FALLS, STAGGERS
from crowdsim.policy.actions import stillness_between
from crowdsim.policy.bundle import load_policy, write_arrays, write_bundle
from crowdsim.policy.falls import LIE, _arrivals
from crowdsim.policy.flattening import flatten_policy
from crowdsim.policy.policy import Policy
from crowdsim.training.train import train_policy


@cache
def plain_policy() -> Policy:
    return train_policy(recipe(0), "plain")[0]


def test_falls_lie_behind_all_other_actions() -> None:
    policy = falling_policy()
    falls, graph, actions = policy.falls, policy.graph, policy.actions
    assert falls is not None
    assert len(falls.fall) == 2 * len(FALLS)
    assert len(falls.stagger) == 2 * len(STAGGERS)
    assert len(falls.cheer) == 2 * len(CHEERS)
    np.testing.assert_array_equal(falls.actions, np.arange(graph.choice_count, graph.action_count))
    assert actions.offsets[-1] == graph.action_offsets[-1] == graph.choice_count
    for name in ("next", "lengths", "costs"):
        assert len(getattr(actions, name)) == graph.action_count
    assert graph.without_falls.action_count == graph.choice_count
    assert len(graph.action_has_transition) == len(graph.action_states) == graph.choice_count


def test_a_fall_leads_to_lying_and_a_rise_from_there_to_a_state() -> None:
    policy = falling_policy()
    falls, graph, rate = policy.falls, policy.graph, policy.database.control_rate
    assert falls is not None
    before, last = graph.action_first - 1, graph.action_first + graph.action_lengths - 1
    np.testing.assert_array_equal(last[falls.fall], before[falls.lie])
    assert (last[falls.lie] <= before[falls.rise]).all()
    assert (0.6 * rate <= graph.action_lengths[falls.fall]).all()
    assert (graph.action_lengths[falls.fall] <= 1.7 * rate).all()
    assert (graph.action_lengths[falls.lie] <= round(LIE * rate)).all()
    assert (graph.action_lengths[falls.lie] >= 0.8 * LIE * rate).all()
    np.testing.assert_array_equal(graph.action_next[falls.fall], graph.action_next[falls.rise])
    np.testing.assert_array_equal(graph.action_next[falls.lie], graph.action_next[falls.rise])
    heights = policy.database.pelvises[policy.database.stride * last, 1]
    assert (heights[falls.fall] < 0.3).all()
    assert (heights[falls.rise] > 0.7).all()
    assert (heights[falls.stagger] > 0.7).all()
    assert (heights[falls.cheer] > 0.7).all()


def test_rises_end_where_they_pass_least_visibly_into_a_state() -> None:
    policy = falling_policy()
    falls, graph, database = policy.falls, policy.graph, policy.database
    assert falls is not None
    features = frame_features(database, recipe().graph)
    stillness, rate = stillness_between(database), database.control_rate
    actions = np.concatenate([falls.rise, falls.stagger, falls.cheer])
    stops = np.concatenate([falls.stop, falls.stagger_stop, falls.cheer_stop])
    later = 0
    for action, stop in zip(actions, stops, strict=True):
        last = graph.action_first[action] + graph.action_lengths[action] - 1
        assert stop <= last <= stop + round(0.6 * rate)
        later += last > stop
        costs = np.array(
            [
                np.linalg.norm(features[frame] - features[graph.state_frames], axis=1)
                * stillness(np.array(frame), graph.state_frames)
                + 0.03 * (frame - stop) / rate
                for frame in range(stop, last + 1)
            ]
        )
        assert costs[-1, graph.action_next[action]] == pytest.approx(costs.min(), rel=1e-5)
    assert later > 0


def test_rises_and_staggers_end_before_anything_strikes() -> None:
    policy = falling_policy()
    falls, graph, database = policy.falls, policy.graph, policy.database
    assert falls is not None
    strikes = database.strike_frames
    for action, stop in [
        *zip(falls.rise, falls.stop, strict=True),
        *zip(falls.stagger, falls.stagger_stop, strict=True),
    ]:
        last = graph.action_first[action] + graph.action_lengths[action] - 1
        assert not np.any((strikes > stop * database.stride) & (strikes <= last * database.stride))


def test_rises_and_staggers_end_before_the_next_fall() -> None:
    policy = falling_policy()
    database, graph = policy.database, policy.graph.without_falls
    stops = database.falls.stops
    again = np.stack([stops + 3, stops + 10], axis=1)
    falls = replace(
        database.falls,
        staggers=np.concatenate([database.falls.staggers, again]),
        stagger_directions=np.zeros(len(database.falls.staggers) + len(again), np.float32),
    )
    rises, _, _ = _arrivals(replace(database, falls=falls), graph, recipe().graph)
    assert (rises >= stops).all()
    assert (rises < stops + 3).all()


def test_paths_of_falls_follow_the_motion_and_throw_nothing() -> None:
    policy = falling_policy()
    falls, actions, database = policy.falls, policy.actions, policy.database
    assert falls is not None
    for action in falls.actions:
        assert actions.strike_offsets[action] == actions.strike_offsets[action + 1]
        first, length = int(policy.graph.action_first[action]), int(actions.lengths[action])
        stances = database.ground[database.stride * np.arange(first - 1, first + length)]
        expected = [ground.compose(ground.inverse(stances[0]), stance) for stance in stances[1:]]
        path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]]
        np.testing.assert_allclose(path, expected, atol=1e-5)
    assert not actions.shifts[falls.actions].any()


def test_directions_are_bearings_of_the_trunk_in_the_ground_frame() -> None:
    policy = falling_policy()
    falls, graph, database = policy.falls, policy.graph, policy.database
    assert falls is not None
    for action, direction in zip(falls.fall, falls.direction, strict=True):
        frames = database.stride * np.array(
            [graph.action_first[action] - 1, graph.action_first[action] - 1 + graph.action_lengths[action]]
        )
        trunks = 0.5 * (database.necks + database.pelvises)[frames].astype(float)
        first, last = (ground.to_world(database.ground[f], trunk) for f, trunk in zip(frames, trunks, strict=True))
        seen = ground.to_local(database.ground[frames[0]], last) - ground.to_local(database.ground[frames[0]], first)
        assert abs(ground.wrap(np.arctan2(seen[0], seen[2]) - direction)) < 0.15


def test_no_ordinary_action_shows_a_fall() -> None:
    policy = falling_policy()
    graph = policy.graph
    fallen = policy.database.falls.mask(policy.database.frame_count)
    for action in range(graph.choice_count):
        first = int(graph.action_first[action])
        assert not fallen[first - 1 : first + int(graph.action_lengths[action])][1:].any()
    assert not fallen[graph.state_frames].any()
    assert not fallen[graph.transition_from].any()
    assert not fallen[graph.transition_to].any()


def test_a_policy_without_falls_has_none() -> None:
    policy = plain_policy()
    assert policy.falls is None
    assert policy.graph.choice_count == policy.graph.action_count
    assert not [name for name in flatten_policy(policy)[1] if name.startswith("falls")]
    assert "falls" not in policy.statistics
    assert len(falling_policy().statistics["falls"]["directions"]) == len(FALLS)


def test_a_bundle_keeps_falls(tmp_path: Path) -> None:
    policy = falling_policy()
    write_bundle(tmp_path / "falling", policy, {})
    again = load_policy(tmp_path / "falling")
    assert again.falls is not None
    assert policy.falls is not None
    for name, values in vars(policy.falls).items():
        np.testing.assert_array_equal(getattr(again.falls, name), values)
    for name, values in vars(policy.database.falls).items():
        np.testing.assert_array_equal(getattr(again.database.falls, name), values)
    target, weights = (0.2, 1.5, 0.7), {"approach": 1.0, "punch": 1.0}
    for state in (0, policy.graph.state_count - 1):
        np.testing.assert_array_equal(
            action_values(again, weights, state, target), action_values(policy, weights, state, target)
        )


def _moved(name: str) -> Callable[[dict[str, np.ndarray]], None]:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays[name] = arrays[name].copy()
        arrays[name][0] += 1

    return change


def _missing(arrays: dict[str, np.ndarray]) -> None:
    del arrays["falls_rise"]


def _fewer(arrays: dict[str, np.ndarray]) -> None:
    for name in ("falls_fall", "falls_lie", "falls_rise", "falls_direction", "falls_stop"):
        arrays[name] = arrays[name][:-1]


def _stops(name: str, off: int) -> Callable[[dict[str, np.ndarray]], None]:
    def change(arrays: dict[str, np.ndarray]) -> None:
        last = arrays["graph_action_first"] + arrays["graph_action_lengths"] - 1
        action = arrays[{"falls_stop": "falls_rise"}.get(name, name.removesuffix("_stop"))][0]
        arrays[name] = arrays[name].copy()
        arrays[name][0] = last[action] + 1 if off > 0 else arrays["graph_action_first"][action] - 1

    return change


def _half(arrays: dict[str, np.ndarray]) -> None:
    del arrays["falls_stagger_stop"]


def _beyond(arrays: dict[str, np.ndarray]) -> None:
    arrays["graph_action_next"] = arrays["graph_action_next"].copy()
    arrays["graph_action_next"][-1] = len(arrays["graph_state_frames"])


@pytest.mark.parametrize(
    "change",
    [
        *(_moved(f"falls_{name}") for name in ("fall", "lie", "rise", "stagger", "cheer")),
        _missing,
        _fewer,
        _beyond,
        _half,
    ]
    + [_stops(name, off) for name in ("falls_stop", "falls_stagger_stop", "falls_cheer_stop") for off in (-1, 1)],
)
def test_falls_from_strangers_are_checked(tmp_path: Path, change: Callable[[dict[str, np.ndarray]], None]) -> None:
    document, arrays = flatten_policy(falling_policy())
    change(arrays)
    write_arrays(tmp_path / "foreign", document, arrays, {})
    with pytest.raises(PolicyError):
        load_policy(tmp_path / "foreign")


def test_in_older_bundles_bodies_stand_when_rises_and_staggers_end(tmp_path: Path) -> None:
    document, arrays = flatten_policy(falling_policy())
    for name in ("falls_stop", "falls_stagger_stop"):
        del arrays[name]
    write_arrays(tmp_path / "older", document, arrays, {})
    falls, graph = load_policy(tmp_path / "older").falls, falling_policy().graph
    assert falls is not None
    last = graph.action_first + graph.action_lengths - 1
    np.testing.assert_array_equal(falls.stop, last[falls.rise])
    np.testing.assert_array_equal(falls.stagger_stop, last[falls.stagger])


def test_in_older_bundles_nobody_celebrates(tmp_path: Path) -> None:
    document, arrays = flatten_policy(falling_policy())
    count, first = len(arrays["graph_action_next"]), int(arrays["falls_cheer"][0])
    assert first + len(arrays["falls_cheer"]) == count
    ends = arrays["actions_path_offsets"][first]
    for name, values in arrays.items():
        if name.startswith(("graph_action_", "actions_")) and len(values) in (count, count + 1):
            arrays[name] = values[: first + len(values) - count]
    arrays["actions_paths"] = arrays["actions_paths"][:ends]
    del arrays["falls_cheer"], arrays["falls_cheer_stop"]
    write_arrays(tmp_path / "older", document, arrays, {})
    falls = load_policy(tmp_path / "older").falls
    assert falls is not None
    assert len(falls.cheer) == 0


def test_fights_are_learned_away_from_falls() -> None:
    policy = falling_policy()
    database, graph = policy.database, policy.graph
    beside = database.beside_falls
    assert not beside[graph.state_frames].any()
    last = graph.action_first + graph.action_lengths - 1
    choices = graph.choice_count
    touched = [beside[a : b + 1].any() for a, b in zip(graph.action_first[:choices], last[:choices], strict=True)]
    assert not any(touched)
    # What is beside falls reaches a second before them, or to the start of the clip.
    starts, rate = database.clip_starts, database.control_rate
    for first, end in database.falls.spans:
        clip = np.searchsorted(starts, first, side="right") - 1
        assert beside[max(first - round(1.2 * rate), starts[clip]) : end + 1].all()
    assert not beside[: starts[1]].any()
