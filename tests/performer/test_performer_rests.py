"""The embedded boxer stands at ease and walks off, and comes back to the guard, without sliding or jumping."""

from functools import cache

import numpy as np
import pytest
from falling import lowest_points

from crowdsim.motion.body import build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Clip
from crowdsim.performer import skeleton as bones
from crowdsim.performer.rests import AT_EASE, ON_THE_SPOT, RESTS
from crowdsim.performer.session import Performance, perform, perform_solo

FPS = 60.0
TAKES = [(kind, seed) for kind in RESTS for seed in (1, 2)]
HANG = 0.10
"""Height of a hanging fist over the pelvis at the most [m]."""


@cache
def performed(kind: str, seed: int) -> Performance:
    return perform_solo(kind, seed)


@cache
def posed(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    clip = performed(kind, seed).clip
    return forward_kinematics(clip.skeleton, clip.root_positions, clip.rotations)


def accelerations(clip: Clip) -> np.ndarray:
    positions, _ = forward_kinematics(clip.skeleton, clip.root_positions, clip.rotations)
    return np.linalg.norm(np.diff(positions, 2, axis=0), axis=-1) * FPS**2


@cache
def usual_accelerations() -> np.ndarray:
    """The 99.9th percentile of the acceleration of each joint in ordinary motion."""
    return np.percentile(np.concatenate([accelerations(one.clip) for one in perform(60, 1)]), 99.9, axis=0)


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_hands_hang_at_ease_and_are_up_before_and_after(kind: str, seed: int) -> None:
    (rest,) = performed(kind, seed).truth.rests
    assert rest.kind == kind
    positions, _ = posed(kind, seed)
    over = (positions[:, list(bones.HANDS), 1] - positions[:, None, bones.HIPS, 1]).max(axis=1)
    assert (over[rest.down : rest.up] < HANG).all()
    guard = np.concatenate([over[: rest.start], over[rest.end :]])
    assert (guard > 3.0 * HANG).all()
    assert 2.0 * FPS < rest.up - rest.down < (9.0 if kind in AT_EASE else 14.0) * FPS


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_rests_neither_slide_nor_jump_nor_sink(kind: str, seed: int) -> None:
    performance = performed(kind, seed)
    positions, rotations = posed(kind, seed)
    planted = performance.truth.contacts
    balls = positions[:, list(bones.TOES)][..., [0, 2]]
    speeds = np.linalg.norm(np.diff(balls, axis=0), axis=-1) * FPS
    assert speeds[planted[1:] & planted[:-1]].max() < 0.01
    assert (accelerations(performance.clip) < 1.1 * usual_accelerations()).all()
    lows = lowest_points(build_body(performance.clip.skeleton), positions, rotations).min(axis=1)
    assert -0.04 < lows.min() <= lows.max() < 0.01


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_bodies_at_ease_stay_where_they_are_and_others_go_back_or_turn_and_walk_off(kind: str, seed: int) -> None:
    performance = performed(kind, seed)
    (rest,) = performance.truth.rests
    before, after = performance.truth.stance[[rest.start, rest.end]]
    far, turn = np.hypot(*(after - before)[:2]), abs(after[2] - before[2])
    hips = posed(kind, seed)[0][:, bones.HIPS][:, [0, 2]]
    if kind in ON_THE_SPOT:
        assert far < 0.1
        assert turn < 0.05
    elif kind in AT_EASE:
        steps = {"step_back": 0.6, "back_off": 1.0, "back_away": 1.8}[kind]
        ahead = [np.sin(before[2]), np.cos(before[2])]
        assert -(hips[rest.down] - hips[rest.start]) @ ahead == pytest.approx(steps, abs=0.2)
        assert turn < 0.05
        assert np.ptp(hips[rest.down : rest.up], axis=0).max() < 0.15
    else:
        assert 2.5 < far < 6.0
        assert np.pi / 2 < turn < np.pi
        # He stands at ease before he goes, and then again.
        (walk,) = [travel for travel in performance.truth.travels if travel.gait == "stroll"]
        assert rest.down + FPS < walk.start < walk.end < rest.up - 4.0 * FPS
        for first, last in ((rest.down, walk.start - 10), (walk.end + 20, rest.up)):
            assert np.ptp(hips[first:last], axis=0).max() < 0.15


def test_rests_come_behind_all_other_clips_and_change_none_of_them() -> None:
    plain, rested = perform(20, 4, falls=1), perform(20, 4, falls=1, rests=2)
    assert len(rested) == len(plain) + 2 * len(RESTS)
    for one, other in zip(plain, rested, strict=False):
        np.testing.assert_array_equal(one.clip.rotations, other.clip.rotations)
    assert [one.truth.rests[0].kind for one in rested[len(plain) :]] == list(np.repeat(RESTS, 2))


def test_takes_of_a_session_rest_between_steps() -> None:
    for performance in perform(10, 4, rests=1)[1:]:
        truth = performance.truth
        (rest,) = truth.rests
        assert not truth.strikes
        for contacts in (truth.contacts[: rest.start], truth.contacts[rest.end :]):
            assert len(contacts) >= FPS
            # Each foot is put down at least once.
            assert (np.sum(np.diff(contacts.astype(int), axis=0) == 1, axis=0) >= 1).all()


def test_the_mirror_image_of_walking_off_goes_the_other_way() -> None:
    one, other = perform_solo("walk_off_left", 3), perform_solo("walk_off_left", 3, stance="southpaw")
    assert other.truth.rests[0].kind == "walk_off_right"
    np.testing.assert_allclose(one.truth.stance * [-1.0, 1.0, -1.0], other.truth.stance)
