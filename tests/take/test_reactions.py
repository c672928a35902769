"""How far landed strikes throw back those whom they hit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from take.synthetic_take import actions, build_take, database, sampler
from take.test_poses import duel

from crowdsim.crowd.kernels.layout import BLOCKED
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.poses.contacts import body_points
from crowdsim.poses.kernels.columns import HEAD, TORSO
from crowdsim.poses.kernels.reactions import FADES, LENGTH, MORE, RISE, SHARE, Blows, _response, strengthen
from crowdsim.poses.layers.reactions import TrunksAt, build_trunk
from crowdsim.poses.motion import prepare_motion

FREE = np.array([np.inf])


def blows(times: list[float], ways: list[float], strengths: list[float]) -> Blows:
    """Blows on one avatar, along ways given by heading [rad]."""
    x, z = np.sin(ways), np.cos(ways)
    axes = np.stack([z, np.zeros(len(times)), -x], axis=1) * np.array(strengths)[:, None]
    none = np.zeros((len(times), 3))
    parts = np.full(len(times), HEAD)
    return Blows(np.array([0, len(times)]), np.array(times), axes, parts, none, np.zeros((len(times), 2, 3)))


def thrown(axes: np.ndarray, gain: float) -> np.ndarray:
    return np.asarray(np.linalg.norm(axes, axis=1) * gain)


def test_reactions_are_those_of_a_critically_damped_spring_that_a_soft_push_sets_in_motion() -> None:
    step, rate = 1e-4, 3.0 / RISE
    times = np.arange(0.0, FADES, step)
    push = times * np.exp(-rate * times)
    found, speed, place = np.empty(len(times)), 0.0, 0.0
    for k, force in enumerate(push):
        found[k] = place
        speed += step * (force - 2.0 * rate * speed - rate * rate * place)
        place += step * speed
    shown = np.array([_response(time) for time in times])
    np.testing.assert_allclose(shown, found / found.max(), atol=2e-3)
    assert times[np.argmax(shown)] == pytest.approx(RISE, abs=1e-3)


def test_reactions_are_smooth_where_they_begin_and_end() -> None:
    times = np.arange(-0.1, LENGTH + 0.1, 1.0 / 240.0)
    shown = np.array([_response(time) if 0.0 < time < LENGTH else 0.0 for time in times])
    bends = np.abs(np.diff(shown, 2)) * 240.0**2
    assert bends.max() < 7.5 / RISE**2
    assert bends[times[2:] < 0.01].max() < 0.3 * bends.max()
    assert bends[times[2:] > LENGTH - 0.05].max() < 0.02 * bends.max()


def test_a_blow_on_a_body_that_stays_is_as_far_as_it_is_alone() -> None:
    one = blows([1.0], [0.3], [1.0])
    np.testing.assert_allclose(strengthen(one, np.array([0.1]), np.array([0.0]), FREE), one.axes, rtol=1e-12)


@pytest.mark.parametrize("own", [-0.01, -0.05, 0.02])
def test_a_blow_outweighs_what_the_victim_comes_and_does_not_add_to_what_it_goes(own: float) -> None:
    far = thrown(strengthen(blows([1.0], [0.3], [0.5]), np.array([0.1]), np.array([own]), FREE), 0.1)[0]
    assert far + own == pytest.approx(0.05)


def test_no_blow_is_strengthened_without_bound_nor_vanishes() -> None:
    one, gain = blows([1.0], [0.0], [0.5]), np.array([0.1])
    assert thrown(strengthen(one, gain, np.array([-5.0]), FREE), 0.1)[0] == pytest.approx(0.05 + MORE)
    assert thrown(strengthen(one, gain, np.array([5.0]), FREE), 0.1)[0] == pytest.approx(0.05 * SHARE)


def test_blows_together_bring_a_body_no_further_than_there_is_room() -> None:
    three, gains = blows([1.0, 1.1, 1.2], [0.3] * 3, [0.8, 0.8, 0.8]), np.full(3, 0.1)
    alone = thrown(strengthen(three, gains, np.zeros(3), np.full(3, np.inf)), 0.1)
    close = thrown(strengthen(three, gains, np.zeros(3), np.full(3, 0.11)), 0.1)
    highest = [
        max(sum(_response(time - at) * far for at, far in zip(three.times, fars, strict=True) if 0 < time - at < LENGTH)
            for time in three.times + RISE)
        for fars in (alone, close)
    ]  # fmt: skip
    assert highest[0] > 0.15
    assert highest[1] <= 0.11 + 1e-9
    assert close[0] == alone[0]
    passed = strengthen(three, gains, np.zeros(3), np.full(3, -1.0))
    np.testing.assert_array_equal(passed, 0.0)


def test_a_blow_without_a_gain_stays_as_it_is() -> None:
    one = blows([1.0], [0.3], [0.7])
    np.testing.assert_array_equal(strengthen(one, np.array([0.0]), np.array([-0.3]), FREE), one.axes)


def test_a_blow_outweighs_the_springing_back_from_the_one_before() -> None:
    alone, gains, free = np.array([0.0, 0.0]), np.full(2, 0.1), np.full(2, np.inf)
    same = thrown(strengthen(blows([1.0, 1.0 + RISE], [0.2, 0.2], [1.0, 0.5]), gains, alone, free), 0.1)
    against = thrown(strengthen(blows([1.0, 1.0 + RISE], [0.2, 0.2 + np.pi], [1.0, 0.5]), gains, alone, free), 0.1)
    apart = thrown(strengthen(blows([1.0, 1.0 + LENGTH], [0.2, 0.2], [1.0, 0.5]), gains, alone, free), 0.1)
    assert same[1] > apart[1] + 0.01
    assert against[1] < apart[1]
    assert same[0] == against[0] == apart[0]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_a_blow_depends_on_those_of_the_two_lengths_before_it_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0.0, 4.0, 12))
    ways, strengths = rng.uniform(-3.0, 3.0, 12), rng.uniform(0.2, 1.5, 12)
    own, gains = rng.normal(0.0, 0.1, 12), rng.uniform(0.05, 0.15, 12)
    rooms = rng.choice([0.05, 0.1, np.inf], 12)
    whole = strengthen(blows(times.tolist(), ways.tolist(), strengths.tolist()), gains, own, rooms)
    late = times >= times[-1] - 2.0 * LENGTH
    part = blows(times[late].tolist(), ways[late].tolist(), strengths[late].tolist())
    np.testing.assert_array_equal(strengthen(part, gains[late], own[late], rooms[late])[-1], whole[-1])


def test_gains_tell_how_far_a_small_blow_brings_the_head_or_the_neck() -> None:
    _, policy = build_take([[0]], *actions(1), 2)
    motion = prepare_motion(policy)
    trunk, body, skeleton = build_trunk(motion), database().body, motion.skeleton
    upright = np.zeros((1, skeleton.joint_count, 4), np.float32)
    upright[..., 0] = 1.0
    for part in (HEAD, TORSO):
        bent = upright.copy()
        for joint, give in zip(trunk.chain, trunk.gives[:, part], strict=True):
            bent[0, joint, :2] = np.cos(0.05 * give), np.sin(0.05 * give)
        points = []
        for rotations in (upright, bent):
            posed = forward_kinematics(skeleton, np.zeros((1, 3), np.float32), rotations, threads=1)
            points.append(body_points(body, *posed, np.ones(1))[0 if part == HEAD else 1][0])
        assert np.linalg.norm(points[1] - points[0]) == pytest.approx(0.1 * trunk.gains[part], rel=0.05)


def heads(at: np.ndarray) -> TrunksAt:
    """Bodies with heads there, (n, 3) [m], of a radius of 10 cm."""
    none = np.full_like(at, np.nan)
    return TrunksAt(at, none, none, none[:, None], np.ones(len(at)), np.full((len(at), 2), 0.1))


def test_the_room_of_a_head_ends_where_it_meets_another_one() -> None:
    rng = np.random.default_rng(4)
    own, others = rng.uniform(-0.5, 0.5, (2, 500, 3))
    angles = rng.uniform(0.0, 2.0 * np.pi, 500)
    ways = np.stack([np.sin(angles), np.cos(angles)], axis=1)
    rooms = heads(own).room(heads(others), ways)
    between = (others - own)[:, ::2]
    steps = np.linspace(0.0, 1.5, 1501)
    near = np.linalg.norm(between[:, None] - steps[:, None] * ways[:, None], axis=-1) < 0.2
    ahead = np.sum(between * ways, axis=1) > 0.0
    met = near.any(axis=1) & ahead
    np.testing.assert_array_equal(np.isfinite(rooms)[~met], False)
    far = met & (np.linalg.norm(between, axis=1) > 0.2)
    assert far.sum() > 50
    np.testing.assert_allclose(rooms[far], steps[near.argmax(axis=1)][far], atol=1e-3 + 1e-6)
    inside = met & (np.linalg.norm(between, axis=1) < 0.2)
    assert inside.sum() > 5
    assert (rooms[inside] <= 0.0).all()
    absent = heads(np.full((1, 3), np.nan)).room(heads(np.zeros((1, 3))), np.array([[1.0, 0.0]]))
    assert np.isinf(absent)


def hit(gap: float, speed: float, blocked: bool = False, typical: float = 6.2) -> tuple[np.ndarray, np.ndarray, int]:
    """Joints of a victim, and what they are without the blow, over frames; and the frame of the blow.

    Typical strikes of the policy are as fast as ``typical`` [m/s].
    """
    take, policy, frame = duel(gap)
    speeds = np.full(len(policy.database.strike_speeds), typical, np.float32)
    policy = SimpleNamespace(**{**vars(policy), "database": replace(policy.database, strike_speeds=speeds)})
    events = replace(take.events, speed=np.full(len(take.events.frame), speed, np.float32))
    if blocked:
        outcome = np.full(len(events.frame), BLOCKED, np.uint8)
        events = replace(events, outcome=outcome, landed=np.zeros(len(events.frame), bool))
    shown = replace(take, events=events)
    frames = shown.output_frames(60)
    with_it, without = (
        np.asarray(sampler(one, policy).sample(0, frames, 60)[0].joints()[0], dtype=float)[:, 1]
        for one in (shown, replace(shown, reactions=False))
    )
    return with_it, without, frame


def test_reactions_grow_with_the_speed_of_a_blow_and_begin_with_it() -> None:
    neck = database().body.roles["neck"]
    far = []
    for speed in (4.0, 6.0, 8.0):
        shown, without, frame = hit(0.0, speed)
        apart = np.linalg.norm((shown - without)[:, neck], axis=1)
        # Strikers that touch what has moved reach further themselves, less than a centimetre here.
        assert apart[: frame - 1].max() < 0.01
        far.append(apart[frame:].max())
    assert far[0] < far[1] < far[2]
    assert far[2] > 1.5 * far[0]


def test_blows_of_a_policy_that_strikes_faster_push_as_far_at_a_higher_speed() -> None:
    slow, without, _ = hit(0.0, 6.0, typical=5.0)
    fast, _, _ = hit(0.0, 9.0, typical=7.5)
    same, _, _ = hit(0.0, 6.0, typical=7.5)
    np.testing.assert_allclose(fast, slow, atol=1e-6)
    assert np.abs(same - without).max() < 0.8 * np.abs(slow - without).max()


def test_feet_stay_where_a_blow_pushes_the_pelvis() -> None:
    roles = database().body.roles
    shown, without, frame = hit(0.0, 8.0)
    moved = shown - without
    assert np.linalg.norm(moved[frame:, roles["pelvis"]], axis=1).max() > 0.02
    assert np.linalg.norm(moved[:, [roles["left_foot"], roles["right_foot"]]], axis=-1).max() < 0.02


def test_a_blow_that_an_arm_stops_moves_that_arm_and_the_trunk_less() -> None:
    roles = database().body.roles
    landed, without, frame = hit(0.0, 8.0)
    blocked, without_it, _ = hit(0.0, 8.0, blocked=True)
    trunk = [np.linalg.norm((one - none)[frame:, roles["neck"]], axis=1).max()
             for one, none in ((landed, without), (blocked, without_it))]  # fmt: skip
    assert trunk[1] < 0.5 * trunk[0]
    hands = [np.linalg.norm((blocked - without_it)[frame:, roles[f"{side}_hand"]], axis=1).max()
             for side in ("left", "right")]  # fmt: skip
    assert max(hands) > 0.03
