"""Elbows, hands and knees give way to other bodies."""

import naive_deflection as naive
import numpy as np
import pytest
from take.synthetic_take import actions, build_take, database, sampler

from crowdsim.poses import kept, poser
from crowdsim.poses.capsule_weights import ride_along
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules
from crowdsim.poses.kernels.capsules import Capsules
from crowdsim.poses.kernels.deflection import MovingLimbs, deflect_limbs
from crowdsim.poses.kernels.foot_plants import free_feet
from crowdsim.poses.kernels.records import FootPlants, Moments
from crowdsim.poses.layers import deflection as module
from crowdsim.take.penetration import measure_penetration


def bodies(seed: int, times: int = 2, count: int = 4) -> tuple[Capsules, MovingLimbs]:
    """Trunks with one arm and one leg each, close together, one of them absent for a time."""
    rng = np.random.default_rng(seed)
    pelvis = rng.uniform(0.0, 0.7, (times, count, 3)) * [1.0, 0.1, 1.0] + [0.0, 0.9, 0.0]
    pelvis[1, 2] = np.nan
    chest = pelvis + np.array([0.0, 0.5, 0.0])
    joints = np.full((times, count, 4, 3, 3), np.nan)
    for limb, (root, size) in enumerate(((chest, 0.28), (chest, 0.28), (pelvis, 0.42), (pelvis, 0.42))):
        joints[:, :, limb, 0] = root
        for part in (1, 2):
            way = rng.normal(size=(times, count, 3))
            way *= size / np.linalg.norm(way, axis=-1, keepdims=True)
            joints[:, :, limb, part] = joints[:, :, limb, part - 1] + way
    joints = joints.astype(np.float32)
    ends = [(pelvis, chest)]
    ends += [(joints[:, :, limb, part], joints[:, :, limb, part + 1]) for limb in (0, 2) for part in (0, 1)]
    feet = joints[:, :, 2:4, 2].transpose(2, 0, 1, 3)
    ends += [(foot, foot + [0.2, 0.0, 0.02] * rng.choice([-1.0, 1.0], (times, count, 1))) for foot in feet]
    starts, stops = (np.stack([pair[k] for pair in ends], axis=2).astype(np.float32) for k in range(2))
    radii = np.repeat(rng.uniform(0.04, 0.12, (count, 7, 1)), 2, axis=2)
    bounds = 0.5 * np.linalg.norm(np.nan_to_num(stops - starts), axis=-1).max(axis=0) + radii[..., 0] + 1e-3
    weights = np.zeros((count, 7, 2, 2))
    weights[:, 1] = weights[:, 3] = [[0.0, 0.0], [1.0, 0.0]]
    weights[:, 2] = weights[:, 4] = [[1.0, 0.0], [0.0, 1.0]]
    weights[:, 5:, :, 1] = 1.0
    limbs = np.tile([-1, 0, 0, 2, 2, 2, 3], (count, 1))
    landing = rng.uniform(0.0, 1.0, (times, count, 4))
    freedom = np.concatenate([np.ones((times, count, 2)), rng.choice([0.3, 0.8, 1.0], (times, count, 2))], axis=2)
    down = rng.random((times, count)) < 0.3
    struck = landing * (landing > 0.7) * [1.0, 1.0, 0.0, 0.0]
    moving = MovingLimbs(joints, limbs, weights, landing, struck, freedom, down)
    return Capsules(starts, stops, radii, bounds, np.full(count, 7)), moving


def deflect(capsules: Capsules, limbs: MovingLimbs, asked: np.ndarray) -> np.ndarray:
    order = np.argsort(capsules.starts[:, :, 0, 0], axis=1, kind="stable")
    moves = np.full((len(order), len(asked), 4, 2, 3), np.nan, np.float32)
    deflect_limbs(0, len(order) * len(asked), capsules, limbs, order, np.argsort(order, axis=1), asked, moves)
    return moves


@pytest.mark.parametrize("seed", range(4))
def test_moves_match_naive(seed: int) -> None:
    capsules, limbs = bodies(seed)
    found = deflect(capsules, limbs, np.arange(4))
    assert np.abs(found).max() > 0.02
    for time in range(2):
        order = [n for n in np.argsort(capsules.starts[time, :, 0, 0]) if np.isfinite(capsules.starts[time, n, 0, 0])]
        for n in range(4):
            expected = naive.moves_of(capsules, limbs, time, n, order) if n in order else np.zeros((4, 2, 3))
            np.testing.assert_allclose(found[time, n], expected, atol=5e-3)


def test_bodies_that_are_down_do_not_give_way_and_others_do_the_whole() -> None:
    capsules, limbs = bodies(3, times=12)
    whole = deflect(capsules, limbs._replace(down=np.zeros_like(limbs.down)), np.arange(4))
    found = deflect(capsules, limbs, np.arange(4))
    assert limbs.down.any()
    assert not found[limbs.down].any()
    alone = limbs.down.sum(axis=1) == 0
    np.testing.assert_array_equal(found[alone], whole[alone])
    far = [np.linalg.norm(moves[:, :, 2:, 1], axis=-1)[~limbs.down].mean() for moves in (found, whole)]
    assert far[0] > 1.05 * far[1]


@pytest.mark.parametrize("freedom", [0.3, 1.0])
@pytest.mark.parametrize("across", [-0.09, 0.02, 0.11])
def test_a_foot_on_an_arm_that_lies_goes_to_where_all_of_it_is_beside(across: float, freedom: float) -> None:
    capsules, limbs = bodies(0)
    capsules.starts[:], capsules.ends[:], limbs.down[:] = 50.0, 50.0, [False, True, False, False]
    capsules.starts[0, :2, 0] = capsules.ends[0, :2, 0] = [[0.0, 1.0, 0.0], [0.3, 0.1, 0.3]]
    limbs.freedom[0, 0, 2], limbs.landing[:], capsules.radii[:] = freedom, 0.0, 0.05
    # A foot, whose middle is some way across the arm, and that is lower than the arm.
    capsules.starts[0, 0, 5], capsules.ends[0, 0, 5] = [across - 0.1, 0.03, 0.01], [across + 0.1, 0.03, 0.03]
    capsules.starts[0, 1, 1], capsules.ends[0, 1, 1] = [0.0, 0.05, -0.2], [0.0, 0.05, 0.2]
    capsules.bounds[:] = 0.3
    limbs.joints[0, 0, 2] = [[across, 0.9, 0.0], [across, 0.5, 0.1], [across, 0.1, 0.0]]
    foot = deflect(capsules, limbs, np.array([0]))[0, 0, 2, 1]
    # By the radii of arm and foot and half the foot, less what feet may be in bodies; long ways are not gone in full.
    wanted = 0.05 + 0.05 + 0.1 - naive.FOOT_IN - abs(across)
    assert foot[0] == pytest.approx(np.sign(across) * naive.MOST * np.tanh(wanted / naive.MOST), abs=0.012)
    assert foot[1] == 0.0
    assert abs(foot[2]) < 0.02


def test_an_arm_stays_under_what_lands_on_its_upper_arm() -> None:
    capsules, limbs = bodies(0)
    limbs.struck[:], limbs.down[:] = 0.0, False
    free = deflect(capsules, limbs, np.arange(4))
    limbs.struck[:, :, 0] = 1.0
    held = deflect(capsules, limbs, np.arange(4))
    assert np.abs(free[:, :, 0]).max() > 0.02
    assert not held[:, :, 0].any()
    np.testing.assert_array_equal(held[:, :, 1:], free[:, :, 1:])


def test_moves_of_some_avatars_are_those_among_all() -> None:
    capsules, limbs = bodies(9, count=7)
    some = np.array([1, 4, 6])
    assert np.array_equal(deflect(capsules, limbs, some), deflect(capsules, limbs, np.arange(7))[:, some])


def clinch() -> tuple[object, object]:
    """Two boxers who stand in one another's arms."""
    first, lengths = actions(60)
    return build_take(
        [list(range(30)), list(range(30, 60))], first, lengths, 30, start=[(0.0, 0.0, 0.0), (0.3, 0.3, 2.5)]
    )


def test_limbs_of_boxers_who_clinch_leave_the_other_over_feet_that_hardly_move(monkeypatch: pytest.MonkeyPatch) -> None:
    take, policy = clinch()
    shown = sampler(take, policy)
    after, positions = measure_penetration(shown), shown.sample(0, 110, 60)[0].joints()[0]
    monkeypatch.setattr(module.Deflection, "apply", lambda *_: None)
    through = sampler(take, policy)
    before, captured = measure_penetration(through), through.sample(0, 110, 60)[0].joints()[0]
    assert before.penetration_share_with_arms > 0.3
    assert after.penetration_share_with_arms < 0.6 * before.penetration_share_with_arms
    roles = database().body.roles
    still = [roles[name] for name in ("pelvis", "chest", "head", "left_shoulder")]
    np.testing.assert_allclose(positions[:, :, still], captured[:, :, still], atol=1e-4)
    window = shown.window(0, np.arange(2), np.arange(110) / 60.0)
    freedom = window.free_feet(Moments(np.arange(2), np.arange(110)[:, None] / 60.0))
    for side, foot in enumerate(("left_foot", "right_foot")):
        moved = np.linalg.norm((positions - captured)[:, :, roles[foot]].astype(float), axis=-1)
        planted = freedom[:, :, side] == 0.0
        assert planted.any()
        assert moved[planted].max() < 0.061
        assert np.abs(np.diff(moved, axis=0))[planted[1:] & planted[:-1]].max() * 60.0 < 0.7
    for hand in ("left_hand", "right_hand"):
        moved = (positions - captured)[:, :, roles[hand]].astype(float)
        assert np.linalg.norm(np.diff(moved, 2, axis=0), axis=-1).max() * 3600.0 < 200.0


def test_a_range_of_frames_and_a_crowd_too_large_to_keep_are_posed_as_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    take, policy = clinch()
    whole = sampler(take, policy).sample(0, 110, 60)[0]
    part = sampler(take, policy).sample(50, 61, 60)[0]
    assert np.array_equal(part.rotations, whole.rotations[50:61])
    monkeypatch.setattr(kept, "_NUMBERS", 0)
    monkeypatch.setattr(kept, "_FRAMES", 4)
    monkeypatch.setattr(module, "POSES_AT_ONCE", 1)
    monkeypatch.setattr(module, "_FRAMES_AT_ONCE", 3)
    monkeypatch.setattr(poser, "POSES_AT_ONCE", 1)
    one = sampler(take, policy).sample(50, 61, 60, np.array([1]))[0]
    assert np.array_equal(one.rotations[:, 0], whole.rotations[50:61, 1])


def test_capsules_ride_along_with_their_bones() -> None:
    """Capsules of limbs lie where their weights of middle and end joints say, on the line of the bone."""
    take, policy = clinch()
    motion = sampler(take, policy).motions[0]
    poses = sampler(take, policy).sample(0, 1, 60, np.array([0]))[0]
    positions, rotations = poses.joints()
    body = PosedBodies(motion.body, np.array([0]), poses.scales, poses.girths, poses.stretches, positions, rotations)
    capsules = place_capsules([body], 1, 1)
    limbs, weights = ride_along(motion)
    joints = np.concatenate([motion.arms.joints, motion.legs.joints])
    arms = np.isin(motion.body.capsule_joints[capsule_order(motion.body)], motion.arms.joints[:, :2])
    assert arms.sum() >= 4
    for row in np.flatnonzero(arms):
        upper, middle, end = positions[0, 0, joints[limbs[row]]]
        for share, point in zip(weights[row], (capsules.starts[0, 0, row], capsules.ends[0, 0, row]), strict=True):
            expected = (1.0 - share.sum()) * upper + share[0] * middle + share[1] * end
            np.testing.assert_allclose(point, expected, atol=1e-4)
    assert (limbs >= 0).sum() < len(limbs)
    assert set(limbs) == {-1, 0, 1, 2, 3}


def test_feet_are_free_in_the_air_alone() -> None:
    """Freedom is 0 while a foot is planted, 1 far from foot plants, and eases in between."""
    spans = np.array([[[[0.0, 0.5], [1.0, 1.5]], [[0.2, 0.4], [0.0, 0.0]]]])
    plants, times = FootPlants(spans, np.array([[2, 1]])), np.arange(0.0, 2.0, 0.01)
    freedom = np.full((len(times), 1, 2), np.nan)
    free_feet(0, 1, Moments(np.zeros(1, np.int64), times[:, None]), plants, freedom)
    for foot, count in enumerate((2, 1)):
        gaps = [np.maximum(begin - times, times - end) for begin, end in spans[0, foot, :count]]
        apart = np.clip(np.min(gaps, axis=0) / 0.08, 0.0, 1.0)
        np.testing.assert_allclose(freedom[:, 0, foot], apart**3 * (10 - 15 * apart + 6 * apart**2), atol=1e-9)
