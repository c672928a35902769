"""Poses leave bodies alone that are down: a fall shows as it was captured."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from falling import falling_database, lowest_points
from take.synthetic_take import build_take, sampler

from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.poses.down_state import fallen_rows, falls_soon, near_fallen
from crowdsim.poses.motion import prepare_motion
from crowdsim.poses.sampler import Poses
from crowdsim.take.take import Events, Take

FRAMES, RATE, FPS = 100, 15.0, 60.0
FALL = 3
"""Place of the fall in the queue of each avatar; lying, twice, and rising follow."""


@cache
def takes() -> tuple[Take, Any]:
    """Avatars that stand, fall, lie, rise and stand, all near one another, each by another fall."""
    motion = falling_database()
    falls, first, lengths, queues = motion.falls, [40, 90, 140], [6, 5, 7], []
    for row in range(len(falls.starts)):
        base = len(first)
        first += [falls.starts[row] + 1, falls.downs[row] + 1, falls.rises[row] + 1, 200 + 3 * row]
        lengths += [falls.downs[row] - falls.starts[row], 8, falls.stops[row] - falls.rises[row], 30]
        queues.append([0, 1, 2, base, base + 1, base + 1, base + 2, base + 3, 0, 1])
    start = [(0.7 * (n % 4), 0.7 * (n // 4), 0.8 * n) for n in range(len(queues))]
    take, policy = build_take(queues, np.array(first), np.array(lengths), FRAMES, motion=motion, start=start)
    count = len(queues)
    return replace(take, opponent=np.tile((np.arange(count, dtype=np.int32) + 1) % count, (FRAMES, 1))), policy


def spans() -> np.ndarray:
    """First and last control frame of each avatar's fall, and those in which it begins and ends to lie. (N, 4)."""
    take, _ = takes()
    falls = falling_database().falls
    fall = falls.downs - falls.starts
    begin = np.full(take.avatar_count, 18)
    return np.stack([begin, begin + fall, begin + fall + 16, begin + fall + 16 + falls.stops - falls.rises], axis=1)


def posed(take: Take, policy: Any) -> Poses:
    return sampler(take, policy).sample(0, int(FRAMES / RATE * FPS) - 8, FPS)[0]


def test_frames_between_standing_and_standing_are_down() -> None:
    take, policy = takes()
    motion = prepare_motion(policy)
    down = fallen_rows(take, [motion], 0, FRAMES)
    for n, (first, _, _, last) in enumerate(spans()):
        expected = (np.arange(FRAMES) > first) & (np.arange(FRAMES) < last)
        np.testing.assert_array_equal(down[:, n], expected)
        times = np.arange(FRAMES) / RATE
        soon = falls_soon(take, [motion], np.full(FRAMES, n), times)
        assert soon[expected].all()
        assert soon[first - 2]
        assert not soon[: first - 4].any()
        assert not soon[last:].any()
    assert not motion.frames.contacts[motion.down].any()


def test_those_near_a_body_that_is_down_are_found() -> None:
    take, policy = takes()
    motions, some = [prepare_motion(policy)], np.array([1, 4, 6])
    down = fallen_rows(take, motions, 0, FRAMES)
    places = np.stack([take.x, take.z], axis=-1).astype(float)
    gaps = np.linalg.norm(places[:, some, None] - places[:, None], axis=-1)
    expected = (np.where(down[:, None], gaps, np.inf) < 0.9).any(axis=2)
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(near_fallen(take, motions, 0, FRAMES, some, 0.9), expected)


def test_nobody_who_is_down_turns_a_head_or_gives_way() -> None:
    take, policy = takes()
    motions = [prepare_motion(policy)]
    down = fallen_rows(take, motions, 0, FRAMES)
    quiet = np.array([down[max(f - 4, 0) : f + 5].all(axis=0) for f in range(FRAMES)])
    layers, everyone = sampler(take, policy).poser.layers, np.arange(take.avatar_count)
    turns = layers["gaze"].turns.rows(np.arange(FRAMES), everyone)
    assert np.abs(turns[quiet]).max() < 1e-9
    assert np.abs(turns[:10]).max() > 0.05
    pushes = layers["separation"].pushes.rows(np.arange(FRAMES), everyone)
    quiet = np.array([down[max(f - 1, 0) : f + 2].all(axis=0) for f in range(FRAMES)])
    assert not pushes[quiet].any()


def test_bodies_lie_as_they_were_captured() -> None:
    take, policy = takes()
    motion = falling_database()
    poses = posed(take, policy)
    positions, _ = poses.joints()
    captured, _ = forward_kinematics(motion.skeleton, motion.root_positions, motion.rotations)
    for n, (first, down, _, _) in enumerate(spans()):
        # The middle of the first piece of lying, away from blends.
        for frame in range(max(down - 4, first + 9), down + 1):
            row = int(frame * FPS / RATE)
            playback = motion.stride * (int(motion.falls.downs[n]) - down + frame)
            place = np.array([take.x[frame, n], take.z[frame, n], take.heading[frame, n]], float)
            expected = ground.to_world(place, ground.to_local(motion.ground[playback], captured[playback]))
            # A heel that was captured under the floor is lifted onto it.
            np.testing.assert_allclose(positions[row, n], expected, atol=0.013)


def test_posed_falls_neither_sink_nor_float() -> None:
    take, policy = takes()
    positions, rotations = posed(take, policy).joints()
    body = falling_database().body
    for n, (first, down, rise, last) in enumerate(spans()):
        low = lowest_points(body, positions[:, n].astype(float), rotations[:, n].astype(float))
        rows = [int(frame * FPS / RATE) for frame in (first, down, rise, last)]
        assert low[rows[0] + 32 : rows[3] - 30].min() > -0.012
        assert low[rows[1] : rows[2]].min(axis=1).max() < 0.012


def test_a_hit_on_who_falls_adds_nothing() -> None:
    take, policy = takes()
    when = spans()[0]

    def struck(frame: float) -> Take:
        row = {
            "frame": frame, "attacker": 1, "victim": 0, "hand": 0, "limb": 0, "point": (0.0, 1.4, 0.0),
            "speed": 9.0, "landed": True,
        }  # fmt: skip
        kinds = {"frame": np.float64, "speed": np.float32, "landed": bool, "point": np.float32}
        return replace(
            take,
            events=Events(**{name: np.array([value], kinds.get(name, np.int32)) for name, value in row.items()}),
        )

    still = posed(take, policy).rotations[:, 0]
    head = falling_database().body.roles["neck"]

    def moved(frame: float) -> float:
        other = posed(struck(frame), policy).rotations[:, 0]
        gap = quaternion.multiply(quaternion.conjugate(still[:, :head].astype(float)), other[:, :head].astype(float))
        return float(np.abs(quaternion.to_rotation_vector(gap)).max())

    assert moved(6.0) > 0.02
    assert moved(float(when[0]) - 1.0) < 1e-6
    assert moved(float(when[1]) + 3.0) < 1e-6
