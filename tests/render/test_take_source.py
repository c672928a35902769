"""A recorded run becomes pictures; each frame the same, whichever was asked for before."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from crowdsim.crowd.kernels.layout import BLOCKED, LANDED
from crowdsim.errors import TakeError
from crowdsim.graph.motion_graph import build_graph
from crowdsim.motion import ground
from crowdsim.motion.database import build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.performer.session import perform
from crowdsim.policy.rewards import target_body
from crowdsim.poses.sampler import PoseSampler, unseen_layers
from crowdsim.render.look import Look
from crowdsim.render.source import Shown
from crowdsim.render.stage import build_stage
from crowdsim.render.take_source import TakeSource
from crowdsim.render.view import FIELD, look_at
from crowdsim.take.take import Cast, Events, Take

FRAMES, AVATARS = 30, 4


@pytest.fixture(scope="module")
def policy():
    database = build_database(measure_clips([performed.clip for performed in perform(40.0, 1)]))
    graph = build_graph(database)
    actions = SimpleNamespace(shifts=np.zeros((graph.action_count, 3)))
    body = target_body(database)
    return SimpleNamespace(database=database, graph=graph, actions=actions, body=body, fingerprint="abc", behaviours=())


def wander(policy, frames=FRAMES, avatars=AVATARS) -> Take:
    """A take of avatars who do one random action after the other; the last one comes late."""
    graph, place = policy.graph, policy.database.ground
    stride = policy.database.stride
    rng = np.random.default_rng(4)
    action = np.zeros((frames, avatars), np.int32)
    phase = np.zeros((frames, avatars), np.float32)
    stands = np.zeros((frames, avatars, 3))
    for avatar in range(avatars):
        now = np.array([2.0 * avatar, 0.5 * avatar, float(avatar)])
        state, time, current = int(rng.integers(len(graph.state_frames))), 0, -1
        for frame in range(frames):
            if current < 0 or time == graph.action_lengths[current]:
                if current >= 0:
                    state = int(graph.action_next[current])
                current = int(rng.integers(graph.action_offsets[state], graph.action_offsets[state + 1]))
                start = stride * (int(graph.action_first[current]) - 1)
                base, time = ground.compose(now, ground.inverse(place[start])), 0
            now = ground.compose(base, place[start + stride * time])
            action[frame, avatar], phase[frame, avatar], stands[frame, avatar] = current, time, now
            time += 1
    action[:10, -1] = -1
    x, z, heading = np.moveaxis(stands, -1, 0).astype(np.float32)
    cast = Cast(
        names=np.array([f"boxer_{i}" for i in range(avatars)]),
        types=np.zeros(avatars, np.int16),
        teams=(np.arange(avatars) % 2).astype(np.int16),
        policies=np.zeros(avatars, np.int16),
        scales=np.ones(avatars, np.float32),
        speeds=np.ones(avatars, np.float32),
        type_names=("boxer",),
        team_names=("red", "blue"),
        policy_names=("boxer",),
        colours=np.full((1, 3), np.nan),
    )
    events = Events(
        frame=np.array([12.5, 6.0], np.float32),
        attacker=np.array([0, 1], np.int32),
        victim=np.array([1, 0], np.int32),
        hand=np.zeros(2, np.uint8),
        point=np.array([[1.0, 1.5, 0.2], [0.0, 1.4, 0.0]], np.float32),
        speed=np.array([7.0, 5.0], np.float32),
        landed=np.array([True, False]),
        outcome=np.array([LANDED, BLOCKED], np.uint8),
    )
    targets = np.zeros((frames, 1, 3), np.float32)
    targets[:, 0, 0] = np.arange(frames)
    return Take(
        action, phase, x, z, heading, np.full((frames, avatars), -1, np.int32), cast, targets, ("ball",), events,
        15.0, "wander", 4, ("abc",), "done",
    )  # fmt: skip


def test_frames_do_not_depend_on_those_read_before(policy):
    take = wander(policy)
    one, other = TakeSource(take, [policy], 30.0), TakeSource(take, [policy], 30.0)
    other._block = 5
    assert one.frame_count == 60
    for frame in (59, 3, 40, 4):
        (positions, turns), (again, turned) = one.poses(frame)[0], other.poses(frame)[0]
        np.testing.assert_array_equal(positions, again)
        np.testing.assert_array_equal(turns, turned)


def test_avatars_are_at_the_positions_of_the_take_and_absent_before_they_enter(policy):
    take = wander(policy)
    source = TakeSource(take, [policy], 15.0)
    assert source.ground(np.array([4, 20])).shape == (2, AVATARS, 3)
    assert np.isnan(source.ground(np.array([4]))[0, -1]).all()
    found = source.ground(np.arange(12, 20))
    np.testing.assert_allclose(found[..., 0], take.x[12:20], atol=1e-6)
    np.testing.assert_allclose(found[..., 1], take.z[12:20], atol=1e-6)
    positions, _ = source.poses(4)[0]
    assert np.isnan(positions[-1]).all()
    assert np.isfinite(positions[:-1]).all()
    assert positions[:-1, :, 1].max() > 1.2
    # Pelvises stand over the ground transforms.
    pelvis = source.figures[0].roles["pelvis"]
    assert np.abs(positions[:-1, pelvis][:, [0, 2]] - source.ground(np.array([4]))[0, :-1, :2]).max() < 0.25


def test_strikes_are_seen_for_a_moment_and_targets_move(policy):
    source = TakeSource(wander(policy), [policy], 30.0)
    assert [len(source.recent_strikes(frame)[0]) for frame in (11, 12, 24, 25, 30, 36, 40)] == [0, 1, 1, 1, 1, 1, 0]
    points, ages, speeds, outcomes = source.recent_strikes(28)
    assert points.tolist() == [[1.0, 1.5, pytest.approx(0.2)]]
    assert ages.tolist() == [pytest.approx(0.1)]
    assert speeds.tolist() == [7.0]
    assert outcomes.tolist() == [LANDED]
    assert source.recent_strikes(20)[3].tolist() == [BLOCKED]
    assert source.markers(7)[0, 0] == pytest.approx(3.5)


def test_a_take_becomes_pictures(policy):
    stage = build_stage(TakeSource(wander(policy), [policy], 30.0), (160, 96))
    pictures = [stage.picture(frame).astype(int) for frame in (0, 40)]
    assert np.abs(pictures[0] - pictures[1]).mean() > 0.5
    assert stage.title(40) == "wander   4 avatars   1.33 s   squares 1 m"


def test_a_foreign_policy_is_refused(policy):
    other = SimpleNamespace(**{**vars(policy), "fingerprint": "xyz"})
    with pytest.raises(TakeError, match="is not the one that the take was recorded with"):
        TakeSource(wander(policy), [other], 30.0)


def test_cameras_leave_room_for_longer_legs_and_pictures_depend_on_them(policy):
    take = wander(policy)
    legs = np.array([1.0, 0.9, 1.1, 1.0], np.float32)
    cast = replace(take.cast, legs=legs, scales=np.array([1.0, 1.0, 1.2, 1.2], np.float32))
    plain, source = (TakeSource(one, [policy], 30.0) for one in (take, replace(take, cast=cast)))
    tall, short = plain.avatar_heights[0], source.avatar_heights[1]
    assert 0.06 < tall - short < 0.1
    np.testing.assert_allclose(source.avatar_heights / tall, [1.0, short / tall, 1.2 * (2 - short / tall), 1.2])
    assert source.fingerprint != plain.fingerprint
    assert source.avatar_stretches[:, 1].tolist() == legs.tolist()


def test_what_is_far_or_out_of_sight_is_posed_with_less(policy) -> None:
    """Layers that are not seen are left out by what each picture shows, whatever was drawn before it."""
    take = wander(policy, avatars=3)
    scales = np.array([[np.inf, 2.0, 0.0], [0.5, 2.0, np.inf]])
    plain, sampler = TakeSource(take, [policy], 30.0), PoseSampler(take, [policy])
    source = TakeSource(take, [policy], 30.0)
    seen = [source.poses(frame, Shown(22, lambda frame: scales[frame % 2]))[0] for frame in (20, 21)]
    for frame, (positions, _) in zip((20, 21), seen, strict=True):
        shown = dict(enumerate(scales[frame % 2]))
        for avatar, scale in shown.items():
            if scale == 0.0:
                assert np.isnan(positions[avatar]).all()
                continue
            [(_, without)] = unseen_layers(np.array([scale]))
            expected = sampler.sample(frame, frame + 1, 30.0, np.array([avatar]), without)[0].joints()[0][0, 0]
            np.testing.assert_array_equal(positions[avatar], expected)
    np.testing.assert_array_equal(seen[0][0][0], plain.poses(20)[0][0][0])


def test_pictures_of_a_range_are_those_of_the_whole_from_far_and_near(policy) -> None:
    take = wander(policy, avatars=3)
    for size in ((320, 180), (32, 18)):
        whole = build_stage(TakeSource(take, [policy], 30.0), size, look=Look(caption=False))
        alone = build_stage(TakeSource(take, [policy], 30.0), size, look=Look(caption=False))
        pictures = [whole.picture(frame, stop=24) for frame in range(18, 24)]
        assert np.array_equal(alone.picture(22), pictures[4])


def test_avatars_show_at_as_many_pixels_a_metre_as_the_picture_has_there() -> None:
    """The nearer, the more; none behind the eye, and none far beside the view."""
    view = look_at(np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 10.0]))
    ground = np.array([[0.0, 20.0, 0.0], [0.0, 5.0, 0.0], [0.0, -9.0, 0.0], [80.0, 20.0, 0.0]])
    far, near, behind, beside = view.scales(ground, (320, 180))
    focal = 90.0 / np.tan(0.5 * FIELD)
    assert focal / 20.0 < far < focal / 18.9
    assert near == pytest.approx(focal / 4.0)
    assert behind == beside == 0.0
