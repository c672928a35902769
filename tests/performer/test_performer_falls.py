"""The embedded boxer falls, lies, gets up and staggers as a body of flesh on a floor does."""

from functools import cache

import numpy as np
import pytest
from falling import lowest_points

from crowdsim.motion import quaternion
from crowdsim.motion.body import Body, build_body
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.skeleton import Clip
from crowdsim.performer import skeleton as bones
from crowdsim.performer.cheers import CHEERS
from crowdsim.performer.falls import FALLS, STAGGERS
from crowdsim.performer.session import Performance, perform, perform_solo

FPS = 60.0
TAKES = [(kind, seed) for kind in FALLS for seed in (1, 2, 3)]
FORWARD, BACK, LEFT, RIGHT = (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)
WAYS = {
    **dict.fromkeys(("forward", "timber_forward", "crumple_forward"), FORWARD),
    **dict.fromkeys(("backward", "timber_back", "crumple_back", "sit", "spin_left", "spin_right"), BACK),
    **dict.fromkeys(("left", "wall", "fold", "knee_left"), LEFT),
    **dict.fromkeys(("right", "knee_right"), RIGHT),
}
LOW_WITHIN = {**dict.fromkeys(FALLS, 0.4), "timber_back": 0.8, "timber_forward": 0.8}
"""Time in which the pelvis is a fifth lower [s]."""


@cache
def performed(kind: str, seed: int) -> Performance:
    return perform_solo(kind, seed)


@cache
def posed(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    clip = performed(kind, seed).clip
    return forward_kinematics(clip.skeleton, clip.root_positions, clip.rotations)


@cache
def body() -> Body:
    return build_body(performed("forward", 1).clip.skeleton)


def lows(kind: str, seed: int) -> np.ndarray:
    return lowest_points(body(), *posed(kind, seed))


def of(joints: list[int]) -> np.ndarray:
    return np.isin(body().capsule_joints, joints)


def accelerations(clip: Clip) -> np.ndarray:
    positions, _ = forward_kinematics(clip.skeleton, clip.root_positions, clip.rotations)
    return np.linalg.norm(np.diff(positions, 2, axis=0), axis=-1) * FPS**2


@cache
def usual_accelerations() -> np.ndarray:
    """The 99.9th percentile of the acceleration of each joint in ordinary motion."""
    return np.percentile(np.concatenate([accelerations(one.clip) for one in perform(60, 1)]), 99.9, axis=0)


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_falls_last_as_long_as_falls_do(kind: str, seed: int) -> None:
    truth = performed(kind, seed).truth
    (fall,) = truth.falls
    assert fall.kind == kind
    assert fall.start >= FPS
    assert 0.7 * FPS <= fall.down - fall.start <= 1.6 * FPS
    assert fall.rise - fall.down == 2.0 * FPS
    assert 1.5 * FPS <= fall.end - fall.rise <= 2.6 * FPS
    assert performed(kind, seed).clip.frame_count - fall.end >= FPS


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_nothing_sinks_into_the_floor(kind: str, seed: int) -> None:
    low, clip = lows(kind, seed), performed(kind, seed).clip
    assert low.min() > -0.013  # a toe in the guard, whose shoe is thought to be stiff
    (fall,) = performed(kind, seed).truth.falls
    assert low[fall.start + 15 : fall.end - 30].min() > -0.004
    assert clip.frame_count == len(low)


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_a_body_rests_on_the_floor_while_it_lies(kind: str, seed: int) -> None:
    low, (fall,) = lows(kind, seed), performed(kind, seed).truth.falls
    lying = low[fall.down + 6 : fall.rise]
    assert lying.min(axis=1).max() < 0.004
    trunk = of([bones.HIPS, bones.SPINE, bones.SPINE1, bones.SPINE2])
    assert lying[:, trunk].min(axis=1).max() < 0.04
    positions = posed(kind, seed)[0]
    assert positions[fall.down : fall.rise, : bones.NECK].max(axis=(0, 1))[1] < 0.30
    # It breathes.
    moved = np.ptp(positions[fall.down + 20 : fall.rise - 20, bones.NECK], axis=0)
    assert 1e-3 < np.linalg.norm(moved) < 0.05


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_hands_or_hips_meet_the_floor_before_head_and_trunk(kind: str, seed: int) -> None:
    low, (fall,) = lows(kind, seed), performed(kind, seed).truth.falls

    def met(parts: np.ndarray) -> int:
        down = low[fall.start : fall.rise, parts].min(axis=1) < 0.012
        return int(np.argmax(down)) if down.any() else len(down)

    hands = of([*bones.HANDS, *bones.FOREARMS, bones.HIPS, *bones.LEGS, *bones.UP_LEGS])
    first = met(hands)
    assert first < met(of([bones.HEAD])) - 2
    assert first <= met(of([bones.SPINE1, bones.SPINE2]))


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_trunks_fall_the_way_they_are_named_for(kind: str, seed: int) -> None:
    performance = performed(kind, seed)
    (fall,) = performance.truth.falls
    trunk = posed(kind, seed)[0][:, [bones.HIPS, bones.NECK]].mean(axis=1)
    way = (trunk[fall.down] - trunk[fall.start])[[0, 2]]
    assert np.dot(way / np.linalg.norm(way), WAYS[kind]) > np.cos(np.radians(35.0))


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_bodies_are_soon_lower(kind: str, seed: int) -> None:
    (fall,) = performed(kind, seed).truth.falls
    heights = performed(kind, seed).clip.root_positions[fall.start :, 1]
    assert int(np.argmax(heights < 0.8 * heights[0])) <= LOW_WITHIN[kind] * FPS


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Mean distance of joints of two motions (T, J, 3), one of them mirrored or not, seen from where they begin [m]."""
    names = performed("forward", 1).clip.skeleton.names
    mirrored = [names.index(name.replace("Left", "#").replace("Right", "Left").replace("#", "Right")) for name in names]
    images = [one, one[:, mirrored] * [-1.0, 1.0, 1.0]]
    begun = [np.mean(each[0], axis=0) * [1.0, 0.0, 1.0] for each in (*images, other)]
    return min(float(np.linalg.norm(image - start - other + begun[2], axis=-1).mean())
               for image, start in zip(images, begun[:2], strict=True))  # fmt: skip


def groups(motions: list[np.ndarray], least: float) -> int:
    """How many of some motions are further than ``least`` from all before them."""
    kept: list[np.ndarray] = []
    for motion in motions:
        if all(apart(motion, other) > least for other in kept):
            kept.append(motion)
    return len(kept)


def test_falls_ways_to_lie_and_to_get_up_differ() -> None:
    falls, lying, rising = [], [], []
    for kind in FALLS:
        (fall,) = performed(kind, 1).truth.falls
        positions = posed(kind, 1)[0]
        falls.append(positions[fall.start : fall.start + 60 : 6])
        heading = np.arctan2(*(positions[fall.rise, bones.NECK] - positions[fall.rise, bones.HIPS])[[0, 2]])
        turned = quaternion.rotate(quaternion.about_y(-heading), positions)
        lying.append(turned[fall.rise : fall.rise + 1])
        rising.append(turned[fall.rise + 12 : fall.rise + 84 : 6])
    assert groups(falls, 0.10) >= 12
    assert groups(lying, 0.10) >= 7
    assert groups(rising, 0.12) >= 6


def test_two_takes_of_a_fall_differ() -> None:
    for kind in FALLS:
        (one, other) = ((posed(kind, seed)[0], performed(kind, seed).truth.falls[0]) for seed in (1, 2))
        motions = [positions[fall.rise : fall.rise + 1] for positions, fall in (one, other)]
        assert apart(*motions) > 0.015


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_falling_gains_speed_as_weight_does(kind: str, seed: int) -> None:
    (fall,) = performed(kind, seed).truth.falls
    height = posed(kind, seed)[0][:, bones.SPINE2, 1]
    speed = np.gradient(height) * FPS
    fastest = fall.start + int(np.argmin(speed[fall.start : fall.down]))
    assert -4.0 < speed[fastest] < -1.2
    # No body falls faster than freely, half a centimetre and what the guard bounces aside.
    since = np.arange(fall.down - fall.start) / FPS
    fallen = height[fall.start] - height[fall.start : fall.down]
    assert (fallen < 0.5 * 9.81 * since**2 + 0.10).all()
    assert fastest - fall.start > (0.15 if kind.startswith(("crumple", "knee", "sit", "wall", "fold")) else 0.3) * FPS


@pytest.mark.parametrize(("kind", "seed"), [*TAKES, *((kind, 1) for kind in STAGGERS)])
def test_nothing_jerks(kind: str, seed: int) -> None:
    clip = performed(kind, seed).clip
    ratio = accelerations(clip) / usual_accelerations()
    assert ratio.max() < 2.0
    # Clips of staggers are of different lengths: the guard before and after them is longer than they are.
    assert (ratio > 1.0).mean() < (0.036 * FPS / clip.frame_count if kind in STAGGERS else 0.008)


@pytest.mark.parametrize(("kind", "seed"), TAKES)
def test_knees_bend_the_right_way_and_feet_that_carry_stay(kind: str, seed: int) -> None:
    clip, (fall,) = performed(kind, seed).clip, performed(kind, seed).truth.falls
    for knee in bones.LEGS:
        w, x, y, z = np.moveaxis(clip.rotations[:, knee], -1, 0)
        assert (2.0 * np.arctan2(x * np.sign(w), np.abs(w))).min() > -1e-6
        assert np.abs(np.stack([y, z])).max() < 1e-6
    ball = posed(kind, seed)[0][fall.rise + 72 : fall.end, bones.TOES[0]]
    assert np.linalg.norm(np.ptp(ball[:, [0, 2]], axis=0)) < 0.015


@pytest.mark.parametrize("kind", STAGGERS)
def test_staggers_throw_the_trunk_and_feet_catch_it(kind: str) -> None:
    performance = performed(kind, 2)
    (stagger,) = performance.truth.staggers
    assert 0.55 * FPS < stagger.end - stagger.start < 1.75 * FPS
    planted = performance.truth.contacts[stagger.start : stagger.end]
    lifted = np.sum(np.diff(planted.astype(int), axis=0) == -1, axis=0)
    assert lifted.sum() >= 2
    positions = posed(kind, 2)[0]
    lean = (positions[:, bones.NECK] - positions[:, bones.HIPS])[:, [0, 2]]
    thrown = lean[stagger.start : stagger.end] - lean[: stagger.start].mean(axis=0)
    way = {"back": (0.0, -1.0), "left": (1.0, 0.0), "right": (-1.0, 0.0)}[kind.split("_")[-1]]
    assert (thrown @ np.array(way)).max() > 0.18


def test_falls_are_performed_only_when_asked_for_and_change_nothing_else() -> None:
    without, with_falls = perform(20, 5), perform(20, 5, falls=1)
    count = len(FALLS) + len(STAGGERS) + len(CHEERS)
    assert len(with_falls) == len(without) + count
    for one, other in zip(without, with_falls, strict=False):
        assert one.clip.rotations.tobytes() == other.clip.rotations.tobytes()
        assert not one.truth.falls
        assert not one.truth.staggers
    again = perform(20, 5, falls=1)
    for one, other in zip(with_falls, again, strict=True):
        assert one.clip.name == other.clip.name
        assert one.clip.rotations.tobytes() == other.clip.rotations.tobytes()
    two = [one.clip.name for one in falling_twice()]
    assert len(two) == len(set(two)) == 2 * count


@cache
def falling_twice() -> list[Performance]:
    """What a session with two takes of every fall, stagger and celebration has behind its fights."""
    return perform(10, 5, falls=2)[1:]


def test_takes_of_a_session_fall_and_stagger_amid_fights() -> None:
    struck = hurt = 0
    for performance in falling_twice():
        truth = performance.truth
        if truth.cheers:
            continue
        (span,) = [(fall.start, fall.end) for fall in truth.falls] + [(s.start, s.end) for s in truth.staggers]
        assert span[0] >= FPS
        assert performance.clip.frame_count - span[1] >= FPS
        frames = np.array([strike.frame for strike in truth.strikes])
        # The boxer throws no punch during a fall or stagger.
        assert not ((frames > span[0]) & (frames < span[1])).any()
        struck += bool((frames < span[0]).any())
        hurt += bool((frames > span[1]).any())
    assert min(struck, hurt) > 7


def test_a_southpaw_falls_to_the_other_side() -> None:
    orthodox, southpaw = perform_solo("left", 4), perform_solo("left", 4, stance="southpaw")
    assert southpaw.truth.falls[0].kind == "right"
    np.testing.assert_allclose(
        southpaw.clip.root_positions, orthodox.clip.root_positions * np.array([-1.0, 1.0, 1.0]), atol=1e-12
    )
