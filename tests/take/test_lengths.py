"""Bodies with longer and shorter legs and arms: joints, feet, pelvises, capsules, and takes without such bodies."""

import math
from dataclasses import replace

import numpy as np
import pytest
from synthetic_take import actions, build_take, database, sampler

from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.poses.builds import build_skeleton, capsule_segments, joint_segments
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules
from crowdsim.poses.kernels.columns import ARM, LEG, TRUNK
from crowdsim.poses.motion import leg_reaches
from crowdsim.poses.sampler import Poses, PoseSampler
from crowdsim.render.figure import bone_capsules
from crowdsim.render.scene import build_cast

LEGS, ARMS = np.array([1.0, 0.9, 1.1, 1.0]), np.array([1.0, 1.1, 0.9, 1.0])
SCALES = [1.0, 0.95, 1.05, 1.1]
FRAMES = 200


def walkers(legs: np.ndarray, arms: np.ndarray, **more: object) -> PoseSampler:
    """Four boxers who change motions at random."""
    first, lengths = actions(60, longest=12)
    rng = np.random.default_rng(2)
    chosen = [rng.permutation(60).tolist() for _ in range(4)]
    take, policy = build_take(chosen, first, lengths, 60, scales=SCALES)
    cast = replace(take.cast, legs=legs.astype(np.float32), arms=arms.astype(np.float32))
    return sampler(replace(take, cast=cast), policy, **more)


@pytest.fixture(scope="module")
def plain() -> Poses:
    return walkers(np.ones(4), np.ones(4)).sample(0, FRAMES, 60)[0]


@pytest.fixture(scope="module")
def posed() -> Poses:
    return walkers(LEGS, ARMS).sample(0, FRAMES, 60)[0]


def soles(poses: Poses) -> np.ndarray:
    """Heels and balls of both feet. Shape (T, n, 2, 2, 3)."""
    body, (positions, rotations) = database().body, poses.joints()
    feet = [body.roles[f"{side}_foot"] for side in ("left", "right")]
    offsets = body.sole_offsets * poses.scales[:, None, None, None]
    return positions[:, :, feet, None] + quaternion.rotate(rotations[:, :, feet, None], offsets)


def test_bodies_of_the_usual_lengths_have_the_bytes_that_they_have_among_any_others(plain, posed) -> None:
    for alone, among in ((plain.root_positions, posed.root_positions), (plain.rotations, posed.rotations)):
        assert alone[:, [0, 3]].tobytes() == among[:, [0, 3]].tobytes()
    for alone, among in zip(plain.joints(), posed.joints(), strict=True):
        assert alone[:, [0, 3]].tobytes() == among[:, [0, 3]].tobytes()


def test_joints_of_bodies_of_the_usual_lengths_are_those_of_plain_forward_kinematics(plain) -> None:
    flat = plain.rotations.reshape(-1, *plain.rotations.shape[2:])
    positions, rotations = forward_kinematics(plain.skeleton, np.zeros((len(flat), 3), np.float32), flat)
    shape = (*plain.rotations.shape[:3], 3)
    positions = positions.reshape(shape) * plain.scales[:, None, None] + plain.root_positions[:, :, None]
    assert positions.tobytes() == plain.joints()[0].tobytes()
    assert rotations.tobytes() == plain.joints()[1].tobytes()


def test_joints_are_those_of_a_skeleton_of_these_lengths(posed) -> None:
    positions, _ = posed.joints()
    for n, (legs, arms) in enumerate(zip(LEGS, ARMS, strict=True)):
        sizes = SCALES[n] * np.array([1.0, legs, arms])
        skeleton = build_skeleton(posed.skeleton, posed.segments, sizes)
        naive = forward_kinematics(skeleton, posed.root_positions[:, n], posed.rotations[:, n])[0]
        np.testing.assert_allclose(positions[:, n], naive, atol=2e-6)


def test_only_thighs_shanks_and_arms_are_longer() -> None:
    skeleton, roles = database().skeleton, database().body.roles
    segments = joint_segments(skeleton, database().body)
    for joint in range(skeleton.joint_count):
        above = []
        at = int(skeleton.parents[joint])
        while at >= 0:
            above.append(at)
            at = int(skeleton.parents[at])
        expected = TRUNK
        for upper, end, kind in (("hip", "foot", LEG), ("shoulder", "hand", ARM)):
            for side in ("left", "right"):
                if roles[f"{side}_{upper}"] in above and roles[f"{side}_{end}"] not in above:
                    expected = kind
        if above:
            assert segments[skeleton.parents[joint]] == expected


def test_reaches_of_legs_are_those_of_a_plain_loop() -> None:
    rng = np.random.default_rng(3)
    heights = rng.uniform(0.0, 1.0, (300, 2, 3))
    found = leg_reaches(heights, 0.8)
    for row, reach in zip(heights, found, strict=True):
        downs = [0.0] + [row[leg][0] - row[leg][2] for leg in range(2)]
        greatest = 0.03 * math.log(sum(math.exp(down / 0.03) for down in downs))
        assert max(downs) <= greatest <= max(downs) + 0.034
        s = min(max((greatest / 0.8 - 0.15) / 0.35, 0.0), 1.0)
        assert reach == pytest.approx(greatest * s**3 * (10.0 - 15.0 * s + 6.0 * s * s), abs=1e-6)
    assert (found == 0.0).any()
    assert (found > 0.5).any()


def test_pelvises_are_as_much_higher_as_legs_are_longer() -> None:
    first, lengths = actions(1, longest=12)
    take, policy = build_take([[0]], first, lengths, 2, scales=[1.1])
    plain = sampler(take, policy).sample(0, 3, 60)[0]
    frame = (first[0] - 1) * database().stride
    hips, feet = ([database().body.roles[f"{side}_{role}"] for side in ("left", "right")] for role in ("hip", "foot"))
    positions = forward_kinematics(
        database().skeleton, database().root_positions[frame : frame + 1], database().rotations[frame : frame + 1]
    )[0][0]
    reach = max(positions[hip, 1] - positions[foot, 1] for hip, foot in zip(hips, feet, strict=True))
    for legs in (0.9, 0.95, 1.05, 1.1):
        longer = replace(take, cast=replace(take.cast, legs=np.array([legs], np.float32)))
        found = sampler(longer, policy).captured(0, 3, 60)[0]
        assert found.root_positions[0, 0, 1] - plain.root_positions[0, 0, 1] == pytest.approx(
            1.1 * (legs - 1.0) * reach, abs=0.004
        )


def test_planted_feet_keep_their_positions_and_no_sole_is_under_the_floor(plain, posed) -> None:
    posing = walkers(np.ones(4), np.ones(4))
    window = posing.window(0, np.arange(4), np.arange(FRAMES) / 60.0)
    spans, counts = window.foot_plants
    here, there = soles(plain), soles(posed)
    assert there[..., 1].min() > -0.0006
    assert np.abs(there - here)[:, [1, 2]].max() > 0.01
    apart: list[list[float]] = [[], [], [], []]
    for n in range(4):
        for foot in range(2):
            for begin, end in spans[n, foot, : counts[n, foot]]:
                rows = np.arange(max(math.ceil(begin * 60), 0), min(math.floor(end * 60) + 1, FRAMES))
                apart[n] += np.abs(there - here)[rows, n, foot].max(axis=(1, 2)).tolist()
    assert max(apart[0] + apart[2] + apart[3]) < 1e-4
    # A leg that is shorter may not reach where motions change.
    assert np.mean(np.array(apart[1]) < 1e-4) > 0.85
    assert max(apart[1]) < 0.05


def test_capsules_end_where_bones_do(posed) -> None:
    body, roles = database().body, database().body.roles
    positions, rotations = posed.joints()
    bodies = PosedBodies(body, np.arange(4), posed.scales, posed.girths, posed.stretches, positions, rotations)
    capsules, order = place_capsules([bodies], FRAMES, 4), capsule_order(body)
    cast = build_cast([body], np.zeros(4, int), np.zeros(4, int), posed.scales, None, posed.girths, posed.stretches)
    drawn = cast.place([(positions[7], rotations[7])]).shapes.reshape(4, -1, 8)
    for side in ("left", "right"):
        for start, end in (("knee", "foot"), ("shoulder", "elbow"), ("elbow", "hand")):
            [capsule] = np.flatnonzero(body.capsule_joints == roles[f"{side}_{start}"])
            [k] = np.flatnonzero(order == capsule)
            wanted = positions[:, :, roles[f"{side}_{end}"]]
            np.testing.assert_allclose(capsules.ends[:, :, k], wanted, atol=1e-4)
            np.testing.assert_allclose(drawn[:, capsule, 3:6], wanted[7], atol=1e-4)
            assert (capsules.bounds[:, k] > np.linalg.norm(capsules.ends - capsules.starts, axis=-1)[7, :, k] / 2).all()


def test_figures_without_a_body_have_no_longer_limbs() -> None:
    figure = bone_capsules(database().skeleton)
    assert not build_cast([figure], np.zeros(2, int), np.zeros(2, int)).segments[0].any()
    assert set(capsule_segments(database().body)) == {TRUNK, LEG, ARM}


def test_a_range_has_the_bytes_of_the_whole_whatever_the_threads(posed) -> None:
    part = walkers(LEGS, ARMS, threads=2).sample(90, 130, 60, np.array([1, 2]))[0]
    assert part.rotations.tobytes() == posed.rotations[90:130, 1:3].tobytes()
    assert part.joints()[0].tobytes() == posed.joints()[0][90:130, 1:3].tobytes()
