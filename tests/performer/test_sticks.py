"""The performer with a stick: blows are found as its strikes, hands stay on it, and it keeps off the own head."""

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.motion import quaternion
from crowdsim.motion.body import HEAD_RADIUS, build_body
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.strikes import find_strikes
from crowdsim.motion.tracks import clip_tracks
from crowdsim.performer.session import Performance, perform, perform_solo
from crowdsim.performer.skeleton import HANDS
from crowdsim.performer.sticks import _BELOW, GRIPS, stick_point

BLOWS = [(grip, blow) for grip, one in GRIPS.items() for blow in one.blows]


def with_stick(performance: Performance):
    """The clip of a performance, its body with the stick, and the paths of the body's points."""
    clip = performance.clip
    held = ({"joint": HANDS[1], "side": 1, "offset": list(stick_point(1)), "radius": 0.016},)
    body = replace(build_body(clip.skeleton), props=held)
    return clip, body, clip_tracks(clip, body)


def struck(performance: Performance):
    clip, body, tracks = with_stick(performance)
    return find_strikes(tracks, body.height, clip.fps, [9])


@pytest.mark.parametrize(("grip", "blow"), BLOWS)
@pytest.mark.parametrize("seed", [1, 2])
def test_each_blow_is_one_strike_of_the_stick(grip, blow, seed):
    performance = perform_solo(blow, seed, stick=grip)
    (truth,) = performance.truth.strikes
    found = struck(performance)
    assert found.limbs.tolist() == [9]
    assert abs(found.frames[0] - truth.frame) <= 4
    # The stick reaches further than an arm does.
    assert np.hypot(found.positions[0, 0], found.positions[0, 2]) > 0.9


@pytest.mark.parametrize("grip", GRIPS)
def test_most_blows_of_a_session_are_found(grip):
    performances = perform(40.0, 5, stick=grip)
    true = sum(len(one.truth.strikes) for one in performances)
    found = sum(len(struck(one).frames) for one in performances)
    assert true > 20
    assert 0.8 * true < found <= 1.1 * true


def test_the_stick_keeps_off_the_head_of_its_owner():
    for performance in perform(30.0, 3, stick="one_hand"):
        _, _, tracks = with_stick(performance)
        shares = np.linspace(0.0, 1.0, 12)[:, None, None]
        points = tracks.fists[:, 1] + shares * (tracks.others[:, 5] - tracks.fists[:, 1])
        near = np.linalg.norm(points - tracks.heads, axis=2).min(axis=0) < 0.8 * HEAD_RADIUS
        assert near.mean() < 0.02


def test_both_hands_stay_on_a_stick_for_two():
    (performance,) = perform(20.0, 3, stick="two_hands")
    _, body, tracks = with_stick(performance)
    _, rotations = clip_kinematics(performance.clip)
    offset = np.array(stick_point(1)) - body.fist_offsets[1]
    along = quaternion.rotate(rotations[:, HANDS[1]], offset / np.linalg.norm(offset))
    gaps = np.linalg.norm(tracks.fists[:, 0] - (tracks.fists[:, 1] - _BELOW * along), axis=1)
    assert np.median(gaps) < 0.01
    assert np.percentile(gaps, 99) < 0.1


def test_without_a_stick_the_session_is_the_boxers():
    plain, none = (perform(8.0, 2, **more)[0].clip for more in ({}, {"stick": None}))
    assert plain.rotations.tobytes() == none.rotations.tobytes()
    assert perform(8.0, 2, stick="one_hand")[0].clip.rotations.tobytes() != plain.rotations.tobytes()


def test_an_unknown_grip_is_refused():
    with pytest.raises(ValueError, match="unknown grip 'three_hands'; expected one of one_hand, two_hands"):
        perform(8.0, 2, stick="three_hands")
    with pytest.raises(ValueError, match="unknown move 'jab'"):
        perform_solo("jab", stick="one_hand")
