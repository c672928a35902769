"""Heads turn towards opponents."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from take.synthetic_take import actions, build_take, database, sampler

from crowdsim.crowd.events import Events
from crowdsim.poses.facing import face_direction
from crowdsim.poses.layers.gaze import MOST
from crowdsim.poses.sampler import Poses
from crowdsim.take.take import Take


def pair(opponents: tuple[int, int], frames: int = 40, seed: int = 0) -> tuple[Take, object]:
    first, lengths = actions(2 * frames, seed=seed)
    queues = [list(range(frames)), list(range(frames, 2 * frames))]
    take, policy = build_take(queues, first, lengths, frames, start=[(0.0, 0.0, 0.0), (1.5, 0.0, 1.0)])
    return replace(take, opponent=np.tile(np.array(opponents, np.int32), (frames, 1))), policy


def faces(poses: Poses, joint: int, ahead: np.ndarray) -> np.ndarray:
    """Heading in which a joint looks. Shape (T, n)."""
    rotations = poses.joints()[1][:, :, joint].astype(float)
    flat = Rotation.from_quat(rotations.reshape(-1, 4), scalar_first=True).apply(ahead)
    return np.arctan2(flat[:, 0], flat[:, 2]).reshape(rotations.shape[:2])


def off(poses: Poses, take: Take, avatar: int) -> np.ndarray:
    """Angle between an avatar's face and the way to the other one [rad]. Shape (T,)."""
    body = database().body
    face = faces(poses, body.roles["head"], face_direction(body))[:, avatar]
    heads = poses.joints()[0][:, :, body.roles["head"]]
    way = heads[:, 1 - avatar] - heads[:, avatar]
    return np.abs(np.angle(np.exp(1j * (face - np.arctan2(way[:, 0], way[:, 2])))))


@pytest.mark.parametrize("seed", range(3))
def test_heads_turn_towards_opponents_and_nothing_below_them_does(seed: int) -> None:
    take, policy = pair((1, 0), seed=seed)
    blind, _ = pair((-1, -1), seed=seed)
    seeing, unseeing = (sampler(one, policy).sample(0, 150, 60)[0] for one in (take, blind))
    for avatar in range(2):
        before, after = off(unseeing, take, avatar), off(seeing, take, avatar)
        front = before < np.radians(60.0)
        assert (after[front] < np.radians(40.0)).all()
        assert (after <= before + np.radians(12.0)).all()
    roles = database().body.roles
    kept = [joint for role, joint in roles.items() if role not in ("neck", "head")]
    np.testing.assert_array_equal(seeing.rotations[:, :, kept], unseeing.rotations[:, :, kept])
    np.testing.assert_array_equal(seeing.root_positions, unseeing.root_positions)
    assert not np.array_equal(seeing.rotations, unseeing.rotations)


def test_heads_turn_about_the_vertical_alone() -> None:
    take, policy = pair((1, 0))
    blind, _ = pair((-1, -1))
    head = database().body.roles["head"]
    seeing, unseeing = (sampler(one, policy).sample(0, 150, 60)[0].joints()[1][:, :, head] for one in (take, blind))
    turns = Rotation.from_quat(seeing.reshape(-1, 4).astype(float), scalar_first=True)
    turns = turns * Rotation.from_quat(unseeing.reshape(-1, 4).astype(float), scalar_first=True).inv()
    vectors = turns.as_rotvec()
    assert np.abs(vectors[:, [0, 2]]).max() < 1e-4
    assert np.abs(vectors[:, 1]).max() < MOST + 0.2


def test_a_new_opponent_turns_heads_without_a_jerk() -> None:
    first, lengths = actions(1, longest=1)
    take, policy = build_take([[0], [0], [0]], first, lengths, 40, speeds=[0.001] * 3,
                              start=[(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])  # fmt: skip
    opponent = np.full((40, 3), -1, np.int32)
    opponent[:20, 0], opponent[20:, 0] = 1, 2
    poses = sampler(replace(take, opponent=opponent), policy).sample(0, 150, 60)[0]
    body = database().body
    face = np.unwrap(faces(poses, body.roles["head"], face_direction(body))[:, 0])
    assert abs(face[10] - face[-10]) > np.radians(50.0)
    assert np.abs(np.diff(face, 2)).max() * 3600.0 < 60.0


def test_an_opponent_who_walks_around_an_avatar_turns_its_head_without_a_jerk() -> None:
    first, lengths = actions(1, longest=1)
    take, policy = build_take([[0], [0]], first, lengths, 90, speeds=[0.001] * 2,
                              start=[(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])  # fmt: skip
    angle = np.linspace(0.0, 2.0 * np.pi, 90, dtype=np.float32)
    x, z = np.array(take.x), np.array(take.z)
    x[:, 1], z[:, 1] = np.sin(angle), np.cos(angle)
    opponent = np.tile(np.array([1, -1], np.int32), (90, 1))
    poses = sampler(replace(take, x=x, z=z, opponent=opponent), policy).sample(0, 350, 60)[0]
    body = database().body
    face = np.unwrap(faces(poses, body.roles["head"], face_direction(body))[:, 0])
    assert np.ptp(face) > np.radians(90.0)
    assert np.abs(np.diff(face, 2)).max() * 3600.0 < 10.0


def test_turns_of_a_stretch_are_those_of_the_whole_and_fade_with_distance() -> None:
    take, policy = pair((1, -2))
    targets = np.zeros((40, 1, 3), np.float32)
    targets[..., 2] = 20.0
    take = replace(take, targets=targets, target_names=("ball",))
    whole, some = (sampler(take, policy).poser.layers["gaze"].turns for _ in range(2))
    part = some.rows(np.arange(9, 21), np.array([0]))
    whole = whole.rows(np.arange(40), np.arange(2))
    np.testing.assert_array_equal(part, whole[9:21, :1])
    assert (whole[:, 0] != 0.0).any()
    assert (whole[:, 1] == 0.0).all()


def falling_scene(blows: list[tuple[float, int, int, bool]]) -> tuple[Take, object]:
    """Four avatars that stand still, the last at a distance: strikes are frame, attacker, victim, whether it fells."""
    first, lengths = actions(1, longest=1)
    places = [(0.0, 0.0, 0.0), (-1.5, 1.5, 0.0), (-2.0, 2.5, 0.0), (0.0, 7.0, 0.0)]
    take, policy = build_take([[0]] * 4, first, lengths, 60, speeds=[0.001] * 4, start=places)
    frame, attacker, victim, down = (np.array(column) for column in zip(*blows, strict=True))
    count = len(blows)
    events = Events(
        frame=frame.astype(np.float32),
        attacker=attacker.astype(np.int32),
        victim=victim.astype(np.int32),
        hand=np.zeros(count, np.uint8),
        point=np.zeros((count, 3), np.float32),
        speed=np.full(count, 5.0, np.float32),
        landed=np.ones(count, bool),
        down=down.astype(bool),
    )
    return replace(take, opponent=np.full((60, 4), -1, np.int32), events=events), policy


def turned(blows: list[tuple[float, int, int, bool]]) -> np.ndarray:
    """How far each head turns for some blows, against the same blows without a fall [rad]. Shape (F, 4)."""
    body = database().body
    found = []
    for some in (blows, [(*blow[:3], False) for blow in blows]):
        take, policy = falling_scene(some)
        poses = sampler(take, policy).sample(0, 230, 60)[0]
        found.append(faces(poses, body.roles["head"], face_direction(body)))
    return np.abs(np.angle(np.exp(1j * (found[0] - found[1]))))


def test_avatars_near_by_look_at_one_that_falls_and_back() -> None:
    turns = turned([(20.0, 2, 1, True)])
    looks = turns[:, 0]
    assert looks[:80].max() < 0.02
    assert looks.max() > np.radians(20.0)
    assert (looks > 0.5 * looks.max()).sum() > 45
    assert looks[-12:].max() < 0.02
    # Neither those that take part, nor one that is far away.
    assert turns[:, 1:].max() < 0.02


def test_avatars_that_exchange_blows_do_not_look_at_others_that_fall() -> None:
    assert turned([(20.0, 2, 1, True), (35.0, 3, 0, False)]).max() < 0.02
