"""Bundles hold walks at ease behind rests; fights and rests on the spot are the same with them as without."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from resting import recipe, resting_policy, staying_policy

from crowdsim.crowd.model import build_model
from crowdsim.errors import PolicyError
from crowdsim.graph.features import frame_features
from crowdsim.motion.rests import DOWN, UP
from crowdsim.policy.bundle import load_policy, write_arrays
from crowdsim.policy.flattening import flatten_policy
from crowdsim.policy.policy import Policy
from crowdsim.policy.rests import Rests, rests_of
from crowdsim.poses.motion import prepare_motion


def rests(policy: Policy) -> Rests:
    assert policy.rests is not None
    return policy.rests


def ends() -> tuple[np.ndarray, np.ndarray]:
    """The frame that each action is laid on, and its last one."""
    graph = resting_policy().graph
    return graph.action_first - 1, graph.action_first + graph.action_lengths - 1


def test_walks_lie_behind_rests() -> None:
    found, count = rests(resting_policy()), resting_policy().graph.action_count
    walks = found.walks
    assert len(walks.take) > 20
    np.testing.assert_array_equal(np.concatenate([walks.take, walks.hold]), np.arange(found.leave[-1] + 1, count))
    assert not np.diff(resting_policy().actions.strike_offsets)[found.actions].any()
    assert resting_policy().statistics["rests"]["walks"] == 4


def test_a_walk_begins_in_a_pose_like_one_at_ease_before_it() -> None:
    found, (before, last) = rests(resting_policy()), ends()
    graph, walks, spans = resting_policy().graph, found.walks, rests_of(found)
    features = frame_features(resting_policy().database, recipe().graph).astype(float)
    contacts = resting_policy().database.contacts[:: resting_policy().database.stride]
    own = graph.action_costs[: graph.choice_count][graph.action_has_transition]
    assert graph.action_costs[walks.take].max() <= np.percentile(own, 90) + 1e-6
    for take, piece in zip(walks.take, walks.piece, strict=True):
        pose, first = last[found.hold[piece]], before[take]
        np.testing.assert_allclose(
            np.linalg.norm(features[pose] - features[first]), graph.action_costs[take], rtol=1e-4
        )
        np.testing.assert_array_equal(contacts[pose], contacts[first])
        (walk,) = np.flatnonzero((spans.walks[:, 0] <= first) & (first <= spans.walks[:, 1]) & spans.walked)
        assert spans.walks[walk, 1] < last[take] <= spans.frames[walk, UP]
        (rest,) = np.flatnonzero((spans.frames[:, DOWN] <= pose) & (pose <= spans.frames[:, UP]))
        assert not spans.walked[rest]


def test_a_walk_leads_part_by_part_to_a_rest_in_which_none_begins() -> None:
    found, (before, last) = rests(resting_policy()), ends()
    count = len(found.hold)
    hold = np.concatenate([found.hold, found.walks.hold])
    following = np.concatenate([found.next, found.walks.next])
    for take, row in zip(found.walks.take, found.walks.row, strict=True):
        actions, at = [take], int(row)
        while at >= count:
            at = int(following[at])
            actions.append(hold[at])
        assert all(last[one] == before[other] for one, other in pairwise(actions))
        assert len(actions) > 3
        for _ in range(20):
            at = int(following[at])
            assert at < count
            assert at not in found.walks.piece
        # The way back to the guard begins at the walk's end, too.
        (rest,) = np.flatnonzero(
            (found.frames[:, DOWN] <= last[actions[-1]]) & (last[actions[-1]] <= found.frames[:, UP])
        )
        assert rests_of(found).walked[rest]


def test_no_rest_that_ends_a_walk_is_entered_from_the_guard() -> None:
    found, (_, last) = rests(resting_policy()), ends()
    spans = rests_of(found)
    for action in found.enter:
        (rest,) = np.flatnonzero((found.frames[:, DOWN] <= last[action]) & (last[action] <= found.frames[:, UP]))
        assert not spans.walked[rest]


def test_fights_and_rests_on_the_spot_are_the_same_to_the_byte_with_walks_as_without() -> None:
    one, other = resting_policy(), staying_policy()
    count = other.graph.choice_count
    assert one.graph.choice_count == count
    for name in ("next", "lengths", "shifts", "costs"):
        np.testing.assert_array_equal(getattr(one.actions, name)[:count], getattr(other.actions, name)[:count])
    falls = rests(other).enter[0]
    assert rests(one).enter[0] == falls
    np.testing.assert_array_equal(one.actions.lengths[:falls], other.actions.lengths[:falls])
    np.testing.assert_array_equal(one.values, other.values)
    np.testing.assert_array_equal(one.graph.transition_costs, other.graph.transition_costs)
    np.testing.assert_array_equal(rests(one).state, rests(other).state)
    mine, theirs = prepare_motion(one), prepare_motion(other)
    assert mine.gait == theirs.gait
    for group in ("hinges", "legs", "arms"):
        for left, right in zip(getattr(mine, group), getattr(theirs, group), strict=True):
            np.testing.assert_array_equal(left, right)


def test_a_policy_without_walks_has_no_arrays_of_them() -> None:
    _, arrays = flatten_policy(staying_policy())
    assert not [name for name in arrays if name.startswith("walks")]
    model = build_model([staying_policy()])
    # Ways into rests that lead away are all that is left.
    assert len(model.walks) == np.count_nonzero(model.ways_to_rest["walk"] >= 0)
    assert (model.rests["first_walk"] == model.rests["end_walk"]).all()
    assert (model.rests["leave"] >= 0).all()


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("walks_take", lambda values: values[::-1], "behind the actions of states and falls"),
        ("walks_spans", lambda values: values[:, ::-1], "frames that ascend"),
        ("walks_piece", lambda values: values + 1000, "pieces of rests"),
        ("walks_row", lambda values: values - 1000, "parts of walks, or pieces of rests"),
        ("walks_next", lambda values: np.full_like(values, values.max()), "parts that come later"),
        ("walks_spans", None, "without the other arrays of walks"),
    ],
)
def test_bundles_with_broken_walks_are_refused(tmp_path: Path, name: str, change, message: str) -> None:
    document, arrays = flatten_policy(resting_policy())
    broken = {**arrays, name: np.ascontiguousarray(change(arrays[name]))} if change else dict(arrays)
    if change is None:
        del broken[name]
    write_arrays(tmp_path / "broken", document, broken, {})
    with pytest.raises(PolicyError, match=message):
        load_policy(tmp_path / "broken")
