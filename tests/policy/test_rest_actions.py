"""Bundles hold rests as actions behind those of states and falls, and learn the same with them as without."""

from pathlib import Path

import numpy as np
import pytest
from resting import recipe, resting_policy, restless_policy

from crowdsim.errors import PolicyError
from crowdsim.graph.features import frame_features
from crowdsim.performer.rests import AT_EASE
from crowdsim.policy.bundle import load_policy, write_arrays, write_bundle
from crowdsim.policy.flattening import flatten_policy
from crowdsim.policy.rests import Rests


def rests() -> Rests:
    found = resting_policy().rests
    assert found is not None
    return found


def ends() -> tuple[np.ndarray, np.ndarray]:
    """The frame that each action is laid on, and its last one."""
    graph = resting_policy().graph
    return graph.action_first - 1, graph.action_first + graph.action_lengths - 1


def test_rests_lie_behind_falls() -> None:
    policy = resting_policy()
    assert policy.falls is not None
    last = int(policy.falls.actions[-1]) + 1
    np.testing.assert_array_equal(rests().actions, np.arange(last, policy.graph.action_count))
    assert not np.diff(policy.actions.strike_offsets)[rests().actions].any()


def test_behaviours_choose_among_the_same_actions_and_learn_the_same_as_without_rests() -> None:
    one, other = resting_policy(), restless_policy()
    count = other.graph.choice_count
    assert one.graph.choice_count == count
    for name in ("next", "lengths", "shifts"):
        np.testing.assert_array_equal(getattr(one.actions, name)[:count], getattr(other.actions, name)[:count])
    np.testing.assert_allclose(one.actions.costs[:count], other.actions.costs[:count], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(one.values, other.values, rtol=1e-4, atol=1e-5)


def test_pieces_follow_one_another_without_end() -> None:
    found, (before, last) = rests(), ends()
    for piece in range(len(found.hold)):
        after = found.next[piece]
        gap = before[found.hold[after]] - last[found.hold[piece]]
        # Behind the last piece, and in place of the first one, the way begins anew out of another pose.
        if gap:
            features = frame_features(resting_policy().database, recipe().graph)
            poses = features[[before[found.hold[after]], last[found.hold[piece]]]]
            assert np.linalg.norm(poses[1] - poses[0]) < 0.08


def test_all_rests_on_the_spot_of_a_stance_are_shown_before_one_comes_again() -> None:
    found, (_, last) = rests(), ends()
    walked = resting_policy().database.rests.walked
    shown = []
    for row in np.unique(found.row):
        piece, pieces, order = int(row), set(), []
        while piece not in pieces:
            pieces.add(piece)
            piece = int(found.next[piece])
            number = int(np.searchsorted(found.frames[:, -1], last[found.hold[piece]]))
            order += [number] if order[-1:] != [number] else []
        assert len(set(order)) >= len(order) - 1
        assert not walked[order].any()
        shown.append(frozenset(order))
    # Hands on the knees, of either stance, lead to nothing else on the spot.
    assert sum(len(rests) == 1 for rests in shown) <= 2
    assert set().union(*shown) == set(np.flatnonzero(~walked).tolist())


def test_a_rest_is_entered_at_no_greater_cost_than_nine_in_ten_transitions_have() -> None:
    policy, found = resting_policy(), rests()
    graph = policy.graph
    features = frame_features(policy.database, recipe().graph).astype(float)
    before, last = ends()
    costs = np.linalg.norm(features[graph.state_frames[found.state]] - features[before[found.enter]], axis=1)
    np.testing.assert_allclose(graph.action_costs[found.enter], costs, rtol=1e-4)
    own = graph.action_costs[: graph.choice_count][graph.action_has_transition]
    assert costs.max() <= np.percentile(own, 90) + 1e-6
    for action, row in zip(found.enter, found.row, strict=True):
        rest = found.frames[np.searchsorted(found.frames[:, -1], last[action])]
        assert rest[0] <= before[action] <= rest[1]
        assert rest[2] <= last[action] <= rest[3]
        assert last[action] == before[found.hold[found.next[row]]]


def test_ways_back_end_in_the_guard_near_a_state() -> None:
    policy, found, (_, last) = resting_policy(), rests(), ends()
    features = frame_features(policy.database, recipe().graph).astype(float)
    for action in found.leave:
        rest = found.frames[np.searchsorted(found.frames[:, -1], last[action])]
        assert rest[4] <= last[action] <= rest[5]
        state = features[policy.graph.state_frames[policy.graph.action_next[action]]]
        assert np.linalg.norm(features[last[action]] - state) < 0.25
        assert policy.graph.action_lengths[action] < 3.0 * policy.database.control_rate


def test_a_recipe_that_asks_for_rests_in_vain_warns() -> None:
    assert restless_policy().rests is None
    (warning,) = [line for line in restless_policy().statistics["warnings"] if line.startswith("no rests")]
    assert "stands at ease" in warning
    assert resting_policy().statistics["rests"]["count"] == 2 * len(AT_EASE)


def test_bundles_keep_rests(tmp_path: Path) -> None:
    write_bundle(tmp_path / "resting", resting_policy(), {})
    read = load_policy(tmp_path / "resting")
    assert read.rests is not None
    for one, other in ((rests(), read.rests), (rests().walks, read.rests.walks)):
        for name, values in vars(one).items():
            if name != "walks":
                np.testing.assert_array_equal(getattr(other, name), values)
    np.testing.assert_array_equal(read.database.rests.walks, rests().walks.spans)
    np.testing.assert_array_equal(read.database.rests.frames, rests().frames)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("rests_enter", lambda values: values[::-1], "behind the actions of states and falls"),
        ("rests_frames", lambda values: values[:, ::-1], "frames that ascend"),
        ("rests_next", lambda values: values + 1000, "expected"),
    ],
)
def test_bundles_with_broken_rests_are_refused(tmp_path: Path, name: str, change, message: str) -> None:
    document, arrays = flatten_policy(resting_policy())
    write_arrays(tmp_path / "broken", document, {**arrays, name: np.ascontiguousarray(change(arrays[name]))}, {})
    with pytest.raises(PolicyError, match=message):
        load_policy(tmp_path / "broken")
