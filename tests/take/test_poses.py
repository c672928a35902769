"""Poses of takes: what captured motion, transitions, feet and strikes do to them, and what they depend on."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_take import NO_EVENTS, actions, build_take, database, sampler, touch_gap

from crowdsim.errors import TakeError
from crowdsim.motion import ground, quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.motion.limbs import flexion
from crowdsim.poses.contacts import body_points
from crowdsim.poses.kernels.reactions import LENGTH, ROUNDS
from crowdsim.poses.kernels.records import Moments
from crowdsim.poses.kernels.steps import STEP
from crowdsim.poses.sampler import Poses, PoseSampler
from crowdsim.take.take import Events, Take

LEGS = ("hip", "knee", "foot", "toe")


def random_take(seed: int, avatars: int = 4, frames: int = 75, **more: Any) -> tuple[Take, Any]:
    """Avatars with several transitions a second, with strikes that land on one another."""
    rng = np.random.default_rng(seed)
    first, lengths = actions(200, seed=seed)
    chosen = [rng.permutation(200).tolist() for _ in range(avatars)]
    speeds = more.pop("speeds", rng.uniform(0.8, 1.2, avatars).tolist())
    scales = rng.uniform(0.9, 1.1, avatars).tolist()
    start = [(0.6 * n, 0.0, 0.5 * np.pi * (-1) ** n) for n in range(avatars)]
    strikes = 12
    times = np.sort(rng.uniform(3, frames - 3, strikes))
    attackers = rng.integers(0, avatars, strikes)
    events = Events(
        times.astype(np.float32), attackers.astype(np.int32), ((attackers + 1) % avatars).astype(np.int32),
        rng.integers(0, 2, strikes).astype(np.uint8), rng.normal(size=(strikes, 3)).astype(np.float32),
        rng.uniform(3, 9, strikes).astype(np.float32), rng.random(strikes) < 0.8,
    )  # fmt: skip
    shifts = rng.normal(0.0, 0.02, (200, 3))
    return build_take(chosen, first, lengths, frames, speeds, scales, events, start=start, shifts=shifts, **more)


def same(one: Poses, other: Poses, times: slice = slice(None), columns: Any = slice(None)) -> bool:
    return bool(
        np.array_equal(one.root_positions, other.root_positions[times][:, columns], equal_nan=True)
        and np.array_equal(one.rotations, other.rotations[times][:, columns], equal_nan=True)
    )


def hard(take: Take, policy: Any, fps: float = 60.0) -> np.ndarray:
    """Joint places of captured motion as it is, put where the take has its avatars."""
    poses = sampler(take, policy)
    window = poses.window(0, np.arange(take.avatar_count), np.array([0.0, take.seconds]))
    times = (np.arange(take.output_frames(fps)) / fps)[:, None]
    places = window.playback(Moments(np.arange(take.avatar_count), times))
    motion = window.motion.frames
    turns = np.array(motion.rotations[places.frames], float)
    turns[..., 0, :] = quaternion.multiply(quaternion.about_y(places.ground[..., 2]), turns[..., 0, :])
    flat = turns.reshape(-1, turns.shape[-2], 4).astype(np.float32)
    found, _ = forward_kinematics(database().skeleton, np.zeros((len(flat), 3), np.float32), flat, threads=1)
    found = found.reshape(*turns.shape[:-1], 3) * np.asarray(take.cast.scales)[:, None, None]
    from crowdsim.motion import ground

    roots = ground.to_world(places.ground, motion.roots[places.frames] * np.asarray(take.cast.scales)[:, None])
    return np.asarray(found + roots[..., None, :])


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 250), st.integers(1, 40), st.sets(st.integers(0, 3), min_size=1))
def test_a_range_of_some_avatars_has_the_bytes_of_the_whole(seed: int, start: int, length: int, who: set[int]) -> None:
    take, policy = random_take(seed % 5)
    whole = sampler(take, policy).sample(0, take.output_frames(60), 60)[0]
    stop = min(start + length, take.output_frames(60))
    avatars = np.array(sorted(who))
    part = sampler(take, policy, threads=2).sample(start, stop, 60, avatars)[0]
    assert same(part, whole, slice(start, stop), avatars)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 4), st.integers(28, 44), st.booleans(), st.booleans())
def test_a_pose_depends_on_a_second_of_the_take_and_no_more(seed: int, frame: int, past: bool, long: bool) -> None:
    first, lengths = actions(200, longest=30 if long else 10, seed=seed)
    rng = np.random.default_rng(seed)
    (take, policy), (other, _) = (
        build_take([rng.permutation(200).tolist() for _ in range(16)], first, lengths, 75) for _ in range(2)
    )
    rows = np.arange(take.frame_count)
    far = rows < frame - 19 if past else rows > frame + 19
    # Where one motion follows the other an action begins, as in any take.
    phase = take.action_frame[frame - 19] if past else other.action_frame[frame + 20]
    begins = phase < 1.0
    changed = {
        name: np.where(far[:, None] & begins, getattr(other, name), getattr(take, name))
        for name in ("action", "action_frame", "x", "z", "heading")
    }
    one = sampler(take, policy).sample(4 * frame, 4 * frame + 1, 60)[0]
    assert same(sampler(replace(take, **changed), policy).sample(4 * frame, 4 * frame + 1, 60)[0], one)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 4), st.integers(70, 85))
def test_a_pose_depends_on_strikes_of_the_seconds_before_it_and_soon_after_it_and_no_others(
    seed: int, frame: int
) -> None:
    take, policy = random_take(seed, frames=120)
    # Blows reckon with those of the two lengths of a reaction before them.
    since = frame - take.events.frame
    near = (since <= 15 * (ROUNDS + 1) * LENGTH + 15) & (since >= -15)
    events = Events(*(getattr(take.events, name)[near] for name in Events.__dataclass_fields__))
    one = sampler(take, policy).sample(4 * frame, 4 * frame + 1, 60)[0]
    assert same(sampler(replace(take, events=events), policy).sample(4 * frame, 4 * frame + 1, 60)[0], one)


def test_captured_motion_without_transitions_is_unchanged() -> None:
    clip = int(database().clip_starts[0])
    first, lengths = np.array([clip + 1, clip + 11, clip + 31, clip + 61]), np.array([10, 20, 30, 40])
    take, policy = build_take([[0, 1, 2, 3]], first, lengths, 90)
    poses = sampler(take, policy).sample(0, take.output_frames(60), 60)[0]
    places, _ = poses.joints()
    gap = np.linalg.norm(places - hard(take, policy), axis=-1)
    legs = [joint for role, joint in database().body.roles.items() if role.endswith(LEGS)]
    rest = np.setdiff1d(np.arange(gap.shape[-1]), legs)
    assert np.percentile(gap[..., rest], 90) < 0.002
    assert gap.max() < 0.03


def test_a_transition_between_equal_frames_changes_nothing() -> None:
    clip = int(database().clip_starts[0])
    whole, policy = build_take([[0, 1]], np.array([clip + 1, clip + 31]), np.array([30, 30]), 45)
    with_transition, other = build_take([[0, 1]], np.array([clip + 1, clip + 31]), np.array([30, 29]), 45)
    one, two = (sampler(t, p).sample(0, 150, 60)[0] for t, p in ((whole, policy), (with_transition, other)))
    assert same(one, two)


def test_position_and_velocity_are_continuous_at_transitions() -> None:
    take, policy = random_take(3, speeds=[1.0] * 4)
    take = replace(take, events=Events(*(getattr(take.events, n)[:0] for n in Events.__dataclass_fields__)))
    fast = 1920.0
    ours = sampler(take, policy).sample(3000, 5000, fast)[0].joints()[0]
    plain = hard(take, policy, 60.0)
    # A transition without a blend jumps by decimetres from one frame to the next, whatever the frame rate.
    assert np.linalg.norm(np.diff(plain, axis=0), axis=-1).max() > 0.3
    steps = np.linalg.norm(np.diff(ours, axis=0), axis=-1)
    # Transitions at random lead from a stride into the guard, too, where feet have far to go.
    assert steps.max() * fast < 40.0
    changes = np.linalg.norm(np.diff(ours, 2, axis=0), axis=-1) * fast
    # Captured motion is straight between playback frames, so its velocity has corners, but no large ones.
    assert np.percentile(changes, 99.9) < 8.0


def test_feet_rotate_continuously_through_transitions_however_far_they_turn() -> None:
    take, policy = random_take(3, speeds=[1.0] * 4)
    take = replace(take, events=Events(*(getattr(take.events, n)[:0] for n in Events.__dataclass_fields__)))
    poses = sampler(take, policy)
    fast, feet = 1920.0, [database().body.roles[f"{side}_foot"] for side in ("left", "right")]
    gaps = poses.window(0, np.arange(4), np.array([0.0, take.seconds])).steps.gaps
    assert np.linalg.norm(gaps[..., 3:6], axis=-1).max() > 1.0
    for start in range(1000, 8000, 1000):
        rotations = poses.sample(start, start + 1001, fast)[0].joints()[1][:, :, feet]
        cosine = np.abs(np.sum(rotations[1:].astype(float) * rotations[:-1], axis=-1))
        # What captured feet do at 30 rad/s; a jump at a transition would be there at any frame rate.
        assert 2.0 * np.arccos(np.minimum(cosine, 1.0)).max() < 30.0 / fast


def test_planted_feet_stay_where_they_are_through_cuts() -> None:
    first, lengths = actions(200, seed=4, longest=30)
    rng = np.random.default_rng(4)
    take, policy = build_take([rng.permutation(200).tolist() for _ in range(6)], first, lengths, 90)
    ours = sampler(take, policy).sample(0, take.output_frames(60), 60)[0].joints()[0]
    ours, plain = _slide(ours, take, policy), _slide(hard(take, policy), take, policy)
    assert np.percentile(plain, 99.9) > 3.0
    # Where a transition leaves no time for anything else feet are dragged, which few are.
    assert np.percentile(ours, 90) < 0.001
    assert np.percentile(ours, 95) < 0.02
    assert ours.max() < 0.5


def test_a_planted_foot_moves_no_more_than_captured_through_a_transition() -> None:
    motion = database()
    stride = motion.stride
    planted = np.asarray(motion.contacts).all(axis=1)[::stride]
    still = [f for f in range(20, len(planted) - 20) if planted[f - 9 : f + 10].all()]
    clip = np.searchsorted(motion.clip_starts, still, side="right")
    inside = [
        f for f, c in zip(still, clip, strict=True)
        if f - 20 >= motion.clip_starts[c - 1] and f + 21 < motion.clip_starts[c]
    ]  # fmt: skip
    found = 0
    for leave, enter in zip(inside[::5], inside[3::7], strict=False):
        take, policy = build_take([[0, 1]], np.array([leave - 19, enter + 1]), np.array([20, 20]), 40)
        poses = sampler(take, policy)
        window = poses.window(0, np.arange(1), np.array([0.0, take.seconds]))
        transitions = window.transitions
        if not len(transitions.times):
            continue
        steps = window.steps
        toes = [motion.body.roles["left_toe"], motion.body.roles["right_toe"]]
        middle = round(float(transitions.times[0]) * 60)
        ours = poses.sample(middle - 12, middle + 13, 60)[0].joints()[0][:, 0, toes]
        moved = np.linalg.norm(ours - ours[:1], axis=-1).max(axis=0)
        for foot in range(2):
            if steps.kinds[0, foot] == STEP and np.linalg.norm(steps.gaps[0, foot, :3]) < 0.1:
                found += 1
                assert moved[foot] < 0.004
    assert found >= 3


def test_a_foot_in_the_air_at_a_transition_is_planted_before_and_after_it() -> None:
    motion = database()
    stride, starts = motion.stride, np.asarray(motion.clip_starts)
    contacts, control = np.asarray(motion.contacts), np.arange(20, int(starts[-1]) - 21)
    control = control[np.searchsorted(starts, control - 20, "right") == np.searchsorted(starts, control + 21, "right")]
    found = 0
    for foot in range(2):
        rows = control[:, None] * stride + np.arange(-30, 31)
        stands = contacts[rows, foot]
        left = control[stands[:, :28].all(axis=1) & ~stands[:, 30:36].any(axis=1)]
        lands = control[stands[:, 33:].all(axis=1) & ~stands[:, 26:31].any(axis=1)]
        for leave, enter in zip(left[:12], lands[-12:], strict=False):
            take, policy = build_take([[0, 1]], np.array([leave - 19, enter + 1]), np.array([20, 20]), 40)
            poses = sampler(take, policy)
            window = poses.window(0, np.arange(1), np.array([0.0, take.seconds]))
            transitions = window.transitions
            steps = window.steps
            if np.linalg.norm(steps.gaps[0, foot, :3]) > 0.3 or steps.kinds[0, foot] != STEP:
                continue
            times = np.arange(round((transitions.times[0] - 0.35) * 60), round((transitions.times[0] + 0.35) * 60))
            toe = motion.body.roles[("left_toe", "right_toe")[foot]]
            places = poses.sample(times[0], times[-1] + 1, 60)[0].joints()[0][:, 0, toe]
            frames = window.playback(Moments(np.arange(1), (times / 60)[:, None])).frames[:, 0]
            hops = (times / 60 > steps.moves[0, foot, 0] - 0.02) & (times / 60 < steps.moves[0, foot, 1] + 0.02)
            still = contacts[frames, foot] & ~hops
            speeds = np.linalg.norm(np.diff(places[:, [0, 2]], axis=0), axis=-1) * 60
            assert speeds[still[1:] & still[:-1]].max() < 0.35
            found += 1
    assert found >= 5


def test_a_heel_raised_at_a_transition_lowers_before_the_foot_steps() -> None:
    motion = database()
    stride, starts, roles = motion.stride, np.asarray(motion.clip_starts), motion.body.roles
    contacts, control = np.asarray(motion.contacts), np.arange(20, int(starts[-1]) - 31)
    control = control[np.searchsorted(starts, control - 20, "right") == np.searchsorted(starts, control + 31, "right")]
    _, turns = forward_kinematics(motion.skeleton, motion.root_positions, motion.rotations)
    found = 0
    for foot, side in enumerate(("left", "right")):
        ahead = quaternion.rotate(turns[:, roles[f"{side}_foot"]].astype(float), [0.0, 0.0, 1.0])
        down = np.rad2deg(np.arcsin(-ahead[:, 1]))
        rows = control[:, None] * stride + np.arange(-10, 50)
        stands, tilts = contacts[rows, foot], down[rows]
        up = control[stands[:, :12].all(axis=1) & (tilts[:, 10] > 42)]
        flat = control[stands.all(axis=1) & (tilts < 14).all(axis=1)]
        for leave, enter in zip(up[:8], flat[:8], strict=False):
            take, policy = build_take([[0, 1]], np.array([leave - 19, enter + 1]), np.array([20, 30]), 48)
            end = round((20 / take.control_rate + 0.5) * 60)
            turned = sampler(take, policy).sample(end, end + 1, 60)[0].joints()[1][0, 0, roles[f"{side}_foot"]]
            tilt = np.rad2deg(np.arcsin(-quaternion.rotate(turned.astype(float), [0.0, 0.0, 1.0])[1]))
            assert abs(tilt - down[enter * stride + 30]) < 8.0
            found += 1
    assert found


def _slide(places: np.ndarray, take: Take, policy: Any) -> np.ndarray:
    roles = database().body.roles
    window = sampler(take, policy).window(0, np.arange(take.avatar_count), np.array([0.0, take.seconds]))
    frames = window.playback(Moments(np.arange(take.avatar_count), (np.arange(len(places)) / 60.0)[:, None])).frames
    planted = np.array(database().contacts[frames])
    transitions = window.transitions
    steps = window.steps
    for k, foot in zip(*np.nonzero(steps.kinds == STEP), strict=True):
        low, high = (steps.moves[k, foot, :2] * 60).astype(int)
        planted[max(low, 0) : high + 2, transitions.owners[k], foot] = False
    feet = places[:, :, [roles["left_toe"], roles["right_toe"]]][..., [0, 2]]
    speeds = np.linalg.norm(np.diff(feet, axis=0), axis=-1) * 60
    return np.asarray(speeds[planted[1:] & planted[:-1]])


def test_no_sole_goes_under_the_floor_and_no_knee_bends_backwards() -> None:
    take, policy = random_take(7, avatars=6)
    body = database().body
    poses = sampler(take, policy).sample(0, take.output_frames(60), 60)[0]
    places, turns = poses.joints()
    for foot, side in enumerate(("left", "right")):
        hip, knee, ankle = (body.roles[f"{side}_{name}"] for name in ("hip", "knee", "foot"))
        for sole in body.sole_offsets[foot]:
            points = places[:, :, ankle] + quaternion.rotate(turns[:, :, ankle], sole) * poses.scales[:, None]
            assert points[..., 1].min() > -1e-3
        bend = np.rad2deg(flexion(places[:, :, hip], places[:, :, knee], places[:, :, ankle]))
        assert bend.max() < 160.0
        # The knee lies in front of the line from hip to ankle.
        middle = 0.5 * (places[:, :, hip] + places[:, :, ankle])
        ahead = quaternion.rotate(turns[:, :, hip], [0.0, 0.0, 1.0])
        out = np.sum((places[:, :, knee] - middle) * ahead, axis=-1)
        assert out[bend > 15.0].min() > 0.0


def duel(gap: float, landed: bool = True) -> tuple[Take, Any, int]:
    """One who strikes a standing other whose head is ``gap`` [m] further than the fist comes; the strike's frame."""
    motion = database()
    stride = motion.stride
    # A straight one to the head, out of the middle of the clip.
    frames, places = motion.strike_frames // stride, motion.strike_positions
    fit = (places[:, 1] > 1.35) & (frames > 24) & (frames < motion.frame_count - 45)
    chosen = int(np.argmax(np.where(fit, np.hypot(places[:, 0], places[:, 2]), 0.0)))
    strike = int(motion.strike_frames[chosen])
    frame = strike // stride
    first, lengths = np.array([frame - 20, frame - 20]), np.array([60, 60])
    take, policy = build_take([[0], [1]], first, lengths, 45, start=[(0, 0, 0), (0, 0, 0)])
    body = motion.body
    hand = int(motion.strike_limbs[chosen])
    when = (strike - (frame - 21) * stride) / stride
    apart = replace(take, collision_avoidance=False)
    alone = sampler(apart, policy).sample(round(when * 4), round(when * 4) + 1, 60)[0]
    head, _, _, fists = body_points(body, *(a[0] for a in alone.joints()), alone.scales)
    way = fists[0, hand] - head[0]
    way[1] = 0.0
    way *= (np.linalg.norm(way) + body.head_radius + gap) / np.linalg.norm(way)
    # The other stands as the first does, so that its head is as high; it is moved along the fist's way.
    x, z = take.x.copy(), take.z.copy()
    x[:, 1] += way[0]
    z[:, 1] += way[2]
    events = Events(
        np.array([when], np.float32), np.array([0], np.int32), np.array([1], np.int32), np.array([hand], np.uint8),
        fists[:1, hand].astype(np.float32), np.array([7.0], np.float32), np.array([landed]),
    )  # fmt: skip
    return replace(take, x=x, z=z, events=events), policy, round(when * 4)


@pytest.mark.parametrize("gap", [-0.08, 0.0, 0.08])
def test_a_strike_that_lands_touches(gap: float) -> None:
    take, policy, frame = duel(gap)
    poses = sampler(take, policy).sample(frame, frame + 1, 60)[0]
    assert abs(touch_gap(database().body, poses, int(take.events.hand[0]))) < 0.01


def test_the_wrist_keeps_its_rotation_when_a_strike_lands() -> None:
    take, policy = random_take(2)
    take = replace(take, collision_avoidance=False)
    none = replace(take, events=Events(*(getattr(take.events, n)[:0] for n in Events.__dataclass_fields__)))
    struck, calm = (sampler(one, policy).sample(0, 290, 60)[0].rotations for one in (take, none))
    roles = database().body.roles
    for side in ("left", "right"):
        hand, elbow = roles[f"{side}_hand"], roles[f"{side}_elbow"]
        np.testing.assert_array_equal(struck[:, :, hand], calm[:, :, hand])
        assert np.abs(struck[:, :, elbow] - calm[:, :, elbow]).max() > 0.05


def test_a_strike_that_misses_leaves_poses_alone() -> None:
    take, policy, _ = duel(0.08, landed=False)
    none = replace(take, events=Events(*(getattr(take.events, n)[:0] for n in Events.__dataclass_fields__)))
    frames = take.output_frames(60)
    assert same(sampler(take, policy).sample(0, frames, 60)[0], sampler(none, policy).sample(0, frames, 60)[0])


def test_a_strike_moves_only_the_arm_that_strikes_and_the_one_it_hits() -> None:
    take, policy, frame = duel(0.05)
    none = replace(take, events=Events(*(getattr(take.events, n)[:0] for n in Events.__dataclass_fields__)))
    frames = take.output_frames(60)
    struck, calm = (sampler(t, policy).sample(0, frames, 60)[0].joints()[0] for t in (take, none))
    moved = np.linalg.norm(struck - calm, axis=-1)
    assert moved[: frame - 20].max() == 0.0
    assert moved[frame + 52 :].max() == 0.0
    assert moved[frame, 0, database().body.roles["left_foot"]] == 0.0
    assert moved[frame, 1].max() == 0.0
    head = database().body.roles["head"]
    assert 0.01 < moved[frame : frame + 12, 1, head].max() < 0.2


def test_hits_are_not_shown_where_a_scenario_disables_reactions() -> None:
    take, policy, _ = duel(0.05)
    none = replace(take, events=Events(*(getattr(take.events, n)[:0] for n in Events.__dataclass_fields__)))
    frames = take.output_frames(60)
    off = sampler(replace(take, reactions=False), policy).sample(0, frames, 60)[0].joints()[0]
    calm = sampler(none, policy).sample(0, frames, 60)[0].joints()[0]
    assert np.array_equal(off[:, 1], calm[:, 1])
    assert not np.array_equal(off[:, 0], calm[:, 0])


def test_the_head_moves_in_the_direction_of_the_strike() -> None:
    take, policy, frame = duel(0.0)
    none = replace(take, events=Events(*(getattr(take.events, n)[:0] for n in Events.__dataclass_fields__)))
    roles = database().body.roles
    struck, calm = (sampler(t, policy).sample(frame, frame + 8, 60)[0].joints()[0] for t in (take, none))
    thrown = (struck - calm)[-1, 1, roles["head"]]
    hand = ("left_hand", "right_hand")[int(take.events.hand[0])]
    before = sampler(none, policy).sample(frame - 4, frame + 1, 60)[0].joints()[0]
    way = before[-1, 0, roles[hand]] - before[0, 0, roles[hand]]
    assert thrown @ way > 0.0


def test_absent_avatars_have_no_pose() -> None:
    take, policy = random_take(1)
    action = take.action.copy()
    action[:30, 2] = -1
    x = take.x.copy()
    x[:30, 2] = np.nan
    poses = sampler(replace(take, action=action, x=x), policy).sample(0, 200, 60)[0]
    for values in (poses.rotations, poses.root_positions):
        assert np.isnan(values[:120, 2]).all()
        assert np.isfinite(values[120:]).all()
        assert np.isfinite(values[:, [0, 1, 3]]).all()
    assert sampler(replace(take, action=action, x=x), policy).present(2, 0, 200, 60).sum() == 80


def test_pushes_pass_evenly_over_a_control_frame() -> None:
    first, lengths = actions(50, 4)
    chosen = [list(range(50))]
    calm, policy = build_take(chosen, first, lengths, 60)
    pushed, _ = build_take(chosen, first, lengths, 60, pushes=0.02)
    one, two = (sampler(t, policy).sample(0, 230, 60)[0].root_positions[:, 0] for t in (calm, pushed))
    assert np.abs(np.diff(two - one, axis=0)).max() < 0.02


def test_sizes_of_bodies_scale_their_poses() -> None:
    first, lengths = actions(30, 8)
    small, policy = build_take([list(range(30))], first, lengths, 60, scales=[0.5], start=[(0, 0, 0)])
    large, _ = build_take([list(range(30))], first, lengths, 60, scales=[1.0], start=[(0, 0, 0)])
    one, two = (sampler(t, policy).sample(0, 230, 60)[0].joints()[0] for t in (small, large))
    assert np.abs(2.0 * one - two).max() < 2e-3


def test_policies_of_another_run_are_refused() -> None:
    take, policy = random_take(1)
    with pytest.raises(TakeError, match="not the one that the take was recorded with"):
        PoseSampler(replace(take, fingerprints=("abc",)), [policy])
    with pytest.raises(TakeError, match="0 policies given, the take has 1: boxer"):
        PoseSampler(take, [])


def test_motion_goes_on_beyond_the_last_control_frame() -> None:
    # The first avatar's action ends after 11 of 11.16 control frames; that of the second goes on.
    first, lengths = np.array([40, 90, 200]), np.array([11, 12, 30])
    long, policy = build_take([[0, 1, 2], [2]], first, lengths, 24, speeds=[0.95, 0.9])
    recorded = ("action", "action_frame", "x", "z", "heading", "opponent", "targets")
    short = replace(long, **{name: getattr(long, name)[:12] for name in recorded})
    assert short.seconds == 12 / 15
    assert [short.output_frames(fps) for fps in (15, 24, 60)] == [12, 20, 48]
    (poses,), (known,) = (sampler(take, policy).sample(0, 48, 60) for take in (short, long))
    np.testing.assert_allclose(poses.rotations[:, 1], known.rotations[:, 1], atol=1e-5)
    np.testing.assert_allclose(poses.root_positions[:, 1], known.root_positions[:, 1], atol=1e-5)
    motion = sampler(short, policy).motions[0].frames
    frame = (first[0] - 1 + 0.95 * 11.75) * motion.stride
    low, part = int(frame), frame % 1
    assert low >= (first[0] - 1 + lengths[0]) * motion.stride
    local = ground.to_local(poses.ground[47, 0], poses.root_positions[47, 0].astype(float))
    np.testing.assert_allclose(local, (1 - part) * motion.roots[low] + part * motion.roots[low + 1], atol=1e-4)


def test_planted_feet_stay_beyond_the_last_control_frame() -> None:
    recorded, moved = ("action", "action_frame", "x", "z", "heading", "opponent", "targets"), []
    for seed in range(6):
        long, policy = random_take(seed)
        for frames in (40, 52):
            take = replace(long, **{name: getattr(long, name)[:frames] for name in recorded}, events=NO_EVENTS)
            poser, times = sampler(take, policy), np.arange(4 * frames - 4, 4 * frames) / 60
            window = poser.window(0, np.arange(4), times)
            playback = window.playback(Moments(np.arange(4), times[:, None]))
            planted = window.motion.frames.contacts[playback.frames].all(axis=0)
            (poses,) = poser.sample(4 * frames - 4, 4 * frames, 60)
            feet = [policy.database.body.roles[f"{side}_toe"] for side in ("left", "right")]
            steps = np.linalg.norm(np.diff(poses.joints()[0][:, :, feet], axis=0), axis=-1)
            moved.append(steps[:, planted])
    found = np.concatenate(moved, axis=1)
    assert found.shape[1] > 40
    assert np.median(found, axis=1).max() < 1e-4


def test_avatars_that_are_named_twice_or_in_any_order_are_posed_once_in_their_order() -> None:
    take, policy = build_take([[0, 0, 0], [1, 1, 1], [0, 0, 0]], np.array([21, 81]), np.array([60, 60]), 45)
    expected = sampler(take, policy).sample(0, 4, 60, [0, 2])[0]
    found = sampler(take, policy).sample(0, 4, 60, [2, 0, 2])[0]
    assert found.joints()[0].tobytes() == expected.joints()[0].tobytes()
