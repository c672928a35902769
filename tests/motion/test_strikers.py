"""Strikers beyond fists and feet: elbows, knees, heads and what hands hold, found in unlabelled motion."""

from dataclasses import replace

import kicker
import numpy as np
import pytest

from crowdsim.motion import quaternion
from crowdsim.motion.body import Body, build_body
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strikers import CARRIERS, GROUPS, LIMBS, STRIKER, mirror_limb
from crowdsim.motion.strikes import HANDS_AND_FEET, find_strikes
from crowdsim.motion.tracks import clip_tracks
from crowdsim.performer.session import perform_solo
from crowdsim.performer.skeleton import ARMS, FOREARMS, HANDS, SPINE, SPINE1, build_skeleton

EVERYTHING = range(len(LIMBS))


def names_found(clip: Clip, body: Body | None = None, limbs=None) -> list[tuple[str, float]]:
    body = build_body(clip.skeleton) if body is None else body
    asked = [limb for limb in EVERYTHING if body.strikers["joint"][limb] >= 0] if limbs is None else limbs
    found = find_strikes(clip_tracks(clip, body), body.height, clip.fps, asked)
    return [(LIMBS[limb], round(frame / clip.fps, 2)) for limb, frame in zip(found.limbs, found.frames, strict=True)]


def turn(clip: Clip, joint: int, keys: list[tuple[float, tuple[float, float, float]]]) -> None:
    """Let a joint follow rotation vectors at times, in place."""
    times = np.arange(clip.frame_count) / clip.fps
    vectors = np.stack(
        [kicker._smooth(times, [(at, np.degrees(vector[k])) for at, vector in keys]) for k in range(3)], axis=1
    )
    clip.rotations[:, joint] = quaternion.multiply(quaternion.from_rotation_vector(vectors), clip.rotations[:, joint])


def test_the_table_has_a_row_for_each_limb_and_pairs_of_sides():
    table = build_body(build_skeleton()).strikers
    assert table.dtype == STRIKER
    assert len(table) == len(LIMBS) == len(CARRIERS)
    sides = [0 if name.startswith("left") else 1 if name.startswith("right") else 2 for name in LIMBS]
    assert table["side"].tolist() == sides
    assert sorted(limb for group in GROUPS.values() for limb in group) == list(EVERYTHING)
    for limb in EVERYTHING:
        other = LIMBS[limb].replace("left", "?").replace("right", "left").replace("?", "right")
        assert LIMBS[mirror_limb(limb)] == other


def test_hands_and_feet_are_the_points_that_the_body_has():
    body = build_body(build_skeleton())
    np.testing.assert_array_equal(body.strikers["offset"][[0, 1]], body.fist_offsets)
    np.testing.assert_array_equal(body.strikers["offset"][[2, 3]], body.foot_offsets)
    assert (body.strikers["joint"][[8, 9]] == -1).all()


def test_a_knee_that_rises_strikes_only_where_knees_are_asked_for():
    clip = kicker.stand(3.0)
    kicker.lift_knee(clip, 1.5, 1)
    assert names_found(clip, limbs=HANDS_AND_FEET) == []
    (name, at), *others = names_found(clip)
    assert (name, others) == ("right_knee", [])
    assert at == pytest.approx(1.5, abs=0.1)


def test_the_knee_of_a_kick_is_no_strike_of_a_knee():
    clip = kicker.stand(3.0)
    kicker.kick(clip, 1.5, 0, "front")
    assert [name for name, _ in names_found(clip)] == ["left_foot"]


@pytest.mark.parametrize("side", [0, 1])
def test_an_elbow_that_swings_ahead_with_a_folded_arm_strikes(side):
    clip, sign = kicker.stand(3.0), 1.0 - 2.0 * side
    turn(clip, FOREARMS[side], [(0.0, (0.0, -0.4 * sign, 0.0)), (3.0, (0.0, -0.4 * sign, 0.0))])
    # The upper arm hangs, then points ahead and up.
    rest, raised = (0.0, 0.0, 0.0), (-1.5, -1.1 * sign, 0.0)
    turn(clip, ARMS[side], [(1.3, rest), (1.5, raised), (1.9, rest)])
    found = [name for name, _ in names_found(clip)]
    assert found == [("left_elbow", "right_elbow")[side]]


def test_a_head_that_is_thrust_forward_strikes():
    clip = kicker.stand(3.0)
    for joint in (SPINE, SPINE1):
        turn(clip, joint, [(1.3, (-0.1, 0, 0)), (1.5, (0.35, 0, 0)), (2.0, (0, 0, 0))])
    (name, at), *others = names_found(clip, limbs=[10])
    assert (name, others) == ("head", [])
    assert at == pytest.approx(1.5, abs=0.1)


def test_what_a_hand_holds_strikes_further_out_than_the_hand():
    clip = perform_solo("straight").clip
    held = ({"joint": HANDS[1], "side": 1, "offset": [-0.45, 0.0, 0.2], "radius": 0.02},)
    bare = build_body(clip.skeleton)
    body = replace(bare, props=held)
    found = find_strikes(clip_tracks(clip, body), body.height, clip.fps, [1, 9])
    assert sorted(found.limbs.tolist()) == [1, 9]
    points = clip_tracks(clip, body)
    at = found.frames[found.limbs == 9][0]
    distances = np.linalg.norm(points.strikers[at, [1, 9]] - points.pelvises[at], axis=1)
    assert distances[1] > distances[0] + 0.2
    np.testing.assert_array_equal(clip_tracks(clip, bare).others[:, :4], points.others[:, :4])
    assert np.isnan(clip_tracks(clip, bare).others[:, 5]).all()
