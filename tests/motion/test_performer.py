"""The embedded boxer: what is promised of its motion, and of the truth that comes with it."""

from __future__ import annotations

import numpy as np
import pytest

from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.performer import perform
from crowdsim.motion.performer_skeleton import BALL_HEIGHT, TOES, build_skeleton


@pytest.fixture(scope="module")
def session():
    return perform(70.0, 5)


def test_a_session_is_as_long_as_asked_and_in_several_clips(session):
    assert len(session) == 2
    assert sum(p.clip.frame_count for p in session) == 4200
    assert {p.clip.fps for p in session} == {60.0}


def test_the_same_seed_gives_the_same_bytes_and_another_seed_does_not():
    a, b, c = (perform(8.0, seed)[0].clip for seed in (3, 3, 4))
    assert a.rotations.tobytes() == b.rotations.tobytes()
    assert a.root_positions.tobytes() == b.root_positions.tobytes()
    assert not np.array_equal(a.rotations, c.rotations)


def test_the_skeleton_stands_on_the_floor_and_is_as_tall_as_said():
    skeleton = build_skeleton()
    places = skeleton.rest_positions()
    crown = places[skeleton.end_parents[0]] + skeleton.end_offsets[0]
    assert crown[1] == pytest.approx(1.75, abs=1e-9)
    assert places[TOES, 1] == pytest.approx(BALL_HEIGHT)
    assert skeleton.joint_count == 22


def test_the_ball_of_a_planted_foot_stands_still(session):
    for performance in session:
        positions, _ = clip_kinematics(performance.clip)
        balls = positions[:, TOES]
        speed = np.linalg.norm(np.diff(balls, axis=0), axis=-1) * 60.0
        planted = performance.truth.contacts
        assert speed[planted[1:] & planted[:-1]].max() < 0.01
        assert balls[..., 1].min() >= BALL_HEIGHT - 1e-9


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_a_length_that_is_not_positive_is_refused(seconds):
    with pytest.raises(ValueError, match="expected both above 0"):
        perform(seconds, 1)


def test_an_unknown_stance_is_refused_with_the_choices():
    with pytest.raises(ValueError, match="'goofy'; expected one of orthodox, southpaw"):
        perform(5.0, 1, stance="goofy")


def test_a_southpaw_is_the_mirror_image_of_an_orthodox_boxer():
    left = perform(6.0, 2)[0]
    right = perform(6.0, 2, stance="southpaw")[0]
    names = left.clip.skeleton.names
    ours, _ = clip_kinematics(left.clip)
    theirs, _ = clip_kinematics(right.clip)
    for name in ("LeftHand", "RightToe", "Head"):
        other = name.replace("Left", "?").replace("Right", "Left").replace("?", "Right")
        mirrored = theirs[:, names.index(other)] * [-1.0, 1.0, 1.0]
        np.testing.assert_allclose(ours[:, names.index(name)], mirrored, atol=1e-9)
    assert [s.hand for s in left.truth.strikes] == [1 - s.hand for s in right.truth.strikes]
    assert np.array_equal(left.truth.contacts[:, 0], right.truth.contacts[:, 1])
