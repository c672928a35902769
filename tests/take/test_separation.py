"""Trunks and heads that lean into others give way."""

from dataclasses import replace

import naive_separation as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from take.synthetic_take import actions, build_take, database, sampler

from crowdsim.core.segments import nearest_on_segments
from crowdsim.motion import quaternion
from crowdsim.poses.kernels import separation
from crowdsim.poses.kernels.body_points import place_points
from crowdsim.poses.kernels.separation import AROUND, find_touching, push_trunks
from crowdsim.poses.layers.deflection import Deflection
from crowdsim.poses.layers.separation import trunk_points


@settings(deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["apart", "parallel", "point", "points", "crossing"]))
def test_distance_of_segments_matches_naive(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    p, q, r, s = rng.normal(size=(4, 3))
    if kind == "parallel":
        s = r + 1.7 * (q - p)
    if kind in ("point", "points"):
        q = p
    if kind == "points":
        s = r
    if kind == "crossing":
        r, s = 0.5 * (p + q) + 0.4 * s, 0.5 * (p + q) - 0.6 * s
    share, part, far = nearest_on_segments(p, q, r, s)
    assert far == pytest.approx(naive.distance(p, q, r, s), abs=1e-5)
    assert np.linalg.norm(p + share * (q - p) - r - part * (s - r)) == pytest.approx(far, abs=1e-9)
    assert 0.0 <= share <= 1.0
    assert 0.0 <= part <= 1.0


def crowd(seed: int, times: int = 3, count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Leaning bodies in a small place, some of them absent, and their radii."""
    rng = np.random.default_rng(seed)
    pelvises = rng.uniform(0.0, 1.2, (times, count, 3)) * [1.0, 0.1, 1.0] + [0.0, 0.9, 0.0]
    necks = pelvises + rng.normal(0.0, 0.1, pelvises.shape) + [0.0, 0.5, 0.0]
    heads = necks + rng.normal(0.0, 0.05, pelvises.shape) + [0.0, 0.15, 0.0]
    legs = []
    for _ in range(2):
        hips = pelvises + rng.normal(0.0, 0.1, pelvises.shape)
        knees = hips + rng.normal(0.0, 0.15, pelvises.shape) - [0.0, 0.4, 0.0]
        legs += [hips, knees, knees + rng.normal(0.0, 0.15, pelvises.shape) - [0.0, 0.4, 0.0]]
    shoulders = [necks + rng.normal(0.0, 0.15, pelvises.shape) for _ in range(2)]
    points = np.stack([heads, necks, pelvises, *legs, *shoulders], axis=2)
    points[1, 3] = points[2, 5:8] = np.nan
    return points, rng.uniform(0.04, 0.15, (count, 7, 2))


@pytest.mark.parametrize("seed", range(5))
def test_pushes_match_naive(seed: int) -> None:
    points, radii = crowd(seed)
    order = np.argsort(points[:, :, 2, 0], axis=1)
    found = np.full((*points.shape[:2], 2), np.inf)
    push_trunks(0, len(points), points, radii, order, np.arange(len(points)), AROUND, found)
    rules = separation._ROOM, separation._SOFT, separation._MOST, separation._LEFT, separation.AROUND, separation._STEEP
    for time in range(len(points)):
        expected = naive.pushes(points, time, radii, *rules, separation._FAR, separation._ROUNDS)
        np.testing.assert_allclose(found[time], expected, atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_bodies_that_touch_are_those_that_are_pushed(seed: int) -> None:
    points, radii = crowd(seed, times=6, count=8)
    points[..., [0, 2]] *= 2.0
    order = np.argsort(points[:, :, 2, 0], axis=1)
    touching, found = np.zeros(points.shape[:2], bool), np.empty((*points.shape[:2], 2))
    for time, row in enumerate(touching):
        find_touching(time, time + 1, points, radii, order, row)
    ever = np.zeros(points.shape[1], bool)
    find_touching(0, len(points), points, radii, order, ever)
    np.testing.assert_array_equal(ever, touching.any(axis=0))
    push_trunks(0, len(points), points, radii, order, np.arange(len(points)), AROUND, found)
    np.testing.assert_array_equal(touching, (found != 0.0).any(axis=-1))
    assert 0.1 < touching.mean() < 0.9


def test_points_of_bodies_are_those_that_their_joints_have() -> None:
    first, lengths = actions(60)
    queues = [list(range(start, start + 20)) for start in (0, 20, 40)]
    take, policy = build_take(queues, first, lengths, 20, scales=[1.0, 0.93, 1.07])
    cast = replace(take.cast, legs=np.array([1.0, 1.1, 0.95], np.float32), arms=np.array([0.9, 1.0, 1.0], np.float32))
    poser = sampler(replace(take, cast=cast), policy).poser
    columns, points = np.array([4, 0, 2]), np.empty((30, 5, 11, 3), np.float32)
    motion, scales = poser.motions[0], np.asarray(cast.scales, float)
    trunk, body = trunk_points(motion)
    some, whole = (
        poser.stretch(lambda block: block, np.arange(3), np.arange(30) / 30.0, "blend", motions=[one])[0]
        for one in (trunk, motion)
    )
    some.poses.roots[3, 1] = some.poses.rotations[3, 1] = np.nan
    place_points(0, 3, body, some.poses, scales, cast.stretches, columns, points)
    expected = naive.body_points(motion, *whole.part.window.world_joints(whole.poses), scales)
    expected[3, 1] = np.nan
    np.testing.assert_array_equal(points[:, columns], expected.astype(np.float32))


RADII = np.repeat([[0.1], [0.15], [0.07], [0.07], [0.07], [0.05], [0.05]], 2, axis=1)
"""Radii of a head, a trunk, shoulders, thighs and shins at both ends."""


def upright(middles: np.ndarray) -> np.ndarray:
    """Bodies that stand straight over points of the ground (..., 2), without width. Shape (..., 11, 3)."""
    points = np.zeros((*middles.shape[:-1], 11, 3))
    points[..., 1] = [1.6, 1.4, 0.9, 0.85, 0.5, 0.1, 0.85, 0.5, 0.1, 1.35, 1.35]
    points[..., [0, 2]] = middles[..., None, :]
    return points


def push_two(points: np.ndarray, found: np.ndarray) -> None:
    """Push two bodies out of one another at all times."""
    times = np.arange(len(points))
    push_trunks(
        0, len(points), points, np.tile(RADII, (2, 1, 1)), np.tile([0, 1], (len(points), 1)), times, AROUND, found
    )


@pytest.mark.parametrize("beside", [0.03, 0.12, -0.12, 0.0])
def test_who_walks_through_another_one_goes_around_it_on_one_side(beside: float) -> None:
    """Bodies do not give way backward while they come, and forward while they go."""
    along = np.linspace(-0.9, 0.9, 13)
    one = np.stack([np.full(13, beside), along], axis=-1)
    points = upright(np.stack([one, -one], axis=1) * 0.5)
    found = np.empty((13, 2, 2))
    push_trunks(
        0,
        len(points),
        points,
        np.tile(RADII, (2, 1, 1)),
        np.tile([0, 1], (13, 1)),
        np.arange(len(points)),
        AROUND,
        found,
    )
    np.testing.assert_allclose(found[:, 0], -found[:, 1], atol=1e-12)
    aside = found[:, 0, 0] * (np.sign(beside) or 1.0)
    assert (aside >= 0.0).all()
    assert aside[6] > 0.07
    assert np.abs(found[:, 0, 1]).max() < 0.02
    gaps = np.linalg.norm(one + 2.0 * found[:, 0], axis=-1)
    assert gaps.min() > 0.19 + abs(beside) / 3.0
    assert np.abs(np.diff(found[:, 0], axis=0)).max() < 0.1


def test_who_halts_in_another_one_is_pushed_back() -> None:
    along = np.concatenate([np.linspace(1.2, 0.2, 10), np.full(10, 0.2)])
    one = np.stack([np.zeros(20), along], axis=-1)
    points = upright(np.stack([one, -one], axis=1) * 0.5)
    found = np.empty((20, 2, 2))
    push_trunks(
        0,
        len(points),
        points,
        np.tile(RADII, (2, 1, 1)),
        np.tile([0, 1], (20, 1)),
        np.arange(len(points)),
        AROUND,
        found,
    )
    np.testing.assert_allclose(found[:, 0, 0], 0.0, atol=1e-9)
    assert found[-1, 0, 1] == pytest.approx(0.055, abs=0.01)
    assert (np.diff(found[:, 0, 1]) > -1e-9).all()


def test_thighs_that_cross_push_bodies_apart_and_those_that_touch_do_not() -> None:
    """Knees and feet go around legs that are hardly in one another."""
    trunk, leg = (
        [[0.0, 1.6, 0.0], [0.0, 1.4, 0.0], [0.0, 0.9, 0.0]],
        [[0.0, 0.85, 0.0], [0.25, 0.5, 0.0], [0.0, 0.1, 0.0]],
    )
    own = np.array(trunk + leg * 2 + [[0.0, 1.35, 0.0]] * 2)
    other = own * [-1.0, 1.0, 1.0] + [0.55, 0.0, 0.05]
    radii, order = np.tile(RADII, (2, 1, 1)), np.array([[0, 1]])
    pushes = []
    for apart in (0.0, 0.08):
        points = np.stack([own, np.add(other, [apart, 0.0, 0.0])])[None]
        found = np.empty((1, 2, 2))
        push_trunks(0, len(points), points, radii, order, np.arange(len(points)), AROUND, found)
        pushes.append(found[0])
    np.testing.assert_allclose(pushes[0][0], -pushes[0][1])
    assert pushes[0][1, 0] > 0.02
    assert np.abs(pushes[1]).max() < 0.5 * pushes[0][1, 0]


def test_bodies_inside_one_another_give_way_over_feet_that_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Deflection, "apply", lambda *_: None)
    first, lengths = actions(40)
    take, policy = build_take(
        [list(range(20)), list(range(20, 40))], first, lengths, 20, start=[(0.0, 0.0, 0.0), (0.22, 0.05, 3.0)]
    )
    roles, body = database().body.roles, database().body
    near, through = (sampler(one, policy).sample(0, 76, 60)[0].joints()[0].astype(float)
                     for one in (take, replace(take, collision_avoidance=False)))  # fmt: skip

    def depth(positions: np.ndarray) -> np.ndarray:
        ends = [positions[:, n, [roles["neck"], roles["pelvis"]]] for n in range(2)]
        gaps = [nearest_on_segments(*a, *b)[2] for a, b in zip(*ends, strict=True)]
        return np.asarray(2.0 * body.torso_radius - np.array(gaps))

    assert depth(through).max() > 0.08
    assert (depth(near) < np.maximum(0.75 * depth(through), 0.02)).all()
    feet = [roles["left_foot"], roles["right_foot"]]
    assert np.linalg.norm(near[:, :, feet] - through[:, :, feet], axis=-1).max() < 0.02
    moved = (near - through)[:, :, roles["pelvis"]]
    assert np.linalg.norm(np.diff(moved, 2, axis=0), axis=-1).max() * 3600.0 < 25.0


def test_heads_give_way_that_come_into_one_another_in_blends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Deflection, "apply", lambda *_: None)
    first, lengths = actions(240, longest=6, seed=4)
    queues = [list(range(120)), list(range(120, 240))]
    take, policy = build_take(queues, first, lengths, 60, start=[(0.0, 0.0, 0.0), (-0.265, -0.229, 7.0)])
    body = database().body
    depths = []
    for one in (take, replace(take, collision_avoidance=False)):
        positions, rotations = sampler(one, policy).sample(0, 232, 60)[0].joints()
        head = body.roles["head"]
        middles = positions[:, :, head] + quaternion.rotate(rotations[:, :, head], body.head_offset)
        depths.append(2.0 * body.head_radius - np.linalg.norm(middles[:, 0] - middles[:, 1], axis=-1).min())
    assert depths[1] > 0.1
    assert depths[0] < 0.03


def test_feet_in_the_air_go_along_with_bodies_that_give_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Deflection, "apply", lambda *_: None)
    motion = replace(database(), contacts=database().contacts & [True, False])  # they hop on the left foot
    first, lengths = actions(120)
    starts = [(0.4 * np.sin(n), 0.4 * np.cos(n), 1.0 * n) for n in range(6)]
    queues = [list(range(20 * n, 20 * n + 20)) for n in range(6)]
    take, policy = build_take(queues, first, lengths, 40, start=starts, motion=motion)
    near, through = (sampler(one, policy).sample(0, 120, 60)[0].joints()[0].astype(float)
                     for one in (take, replace(take, collision_avoidance=False)))  # fmt: skip
    moved = np.linalg.norm((near - through)[:, :, 0], axis=-1)
    assert moved.max() > 0.1
    legs = [
        one[:, :, motion.body.roles["right_foot"]] - one[:, :, motion.body.roles["right_hip"]]
        for one in (near, through)
    ]
    # They reach as far; but no sole goes below the floor with a pelvis that goes down.
    assert np.median(np.linalg.norm(legs[0] - legs[1], axis=-1)[moved > 0.1]) < 0.04


def test_rows_of_a_long_take_are_those_of_a_short_one(monkeypatch: pytest.MonkeyPatch) -> None:
    first, lengths = actions(90)
    queues = [list(range(start, start + 30)) for start in (0, 30, 60)]
    take, policy = build_take(queues, first, lengths, 30, start=[(0.0, 0.0, 0.0), (0.3, 0.1, 3.0), (0.1, 0.4, 1.0)])
    pushes = sampler(take, policy).poser.layers["separation"].pushes
    whole = pushes.rows(np.arange(30), np.arange(3))
    assert np.abs(whole).max() > 0.01
    monkeypatch.setattr("crowdsim.poses.kept._NUMBERS", 0)
    monkeypatch.setattr("crowdsim.poses.kept._FRAMES", 5)
    monkeypatch.setattr("crowdsim.poses.layers.separation._FRAMES_AT_ONCE", 4)
    some = sampler(take, policy).poser.layers["separation"].pushes
    for low, high in ((7, 19), (9, 12), (18, 30), (0, 4)):
        found = some.rows(np.arange(low, high), np.array([0, 2]))
        np.testing.assert_array_equal(found, whole[low:high][:, [0, 2]])
