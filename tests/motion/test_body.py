"""A body is measured alike whatever its rest pose, frames and helpers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conventions import CONVENTIONS
from exporters import Export, export_motion

from crowdsim.bvh.io import to_clip
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.body import PARTS, ROLES, build_body, standing_height
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import measure_body, rests_like_a_body, sample_poses
from crowdsim.motion.roles import find_roles
from crowdsim.motion.skeleton import Skeleton
from crowdsim.motion.tracks import build_tracks
from crowdsim.performer.session import perform
from crowdsim.performer.skeleton import build_skeleton

BY_NAME = {how.name: how for how in CONVENTIONS}


@pytest.fixture(scope="module")
def boxer():
    clip = perform(5.0, 2)[0].clip
    return clip, find_roles(clip.skeleton)


def test_the_embedded_boxer_is_as_tall_as_it_is():
    body = build_body(build_skeleton())
    assert body.height == pytest.approx(1.75, abs=0.02)
    assert set(body.roles) == set(ROLES)
    assert body.head_radius == pytest.approx(0.105, rel=0.02)
    np.testing.assert_allclose(body.fist_offsets, [[0.079, 0.0, 0.0], [-0.079, 0.0, 0.0]], atol=0.005)
    np.testing.assert_allclose(body.sole_offsets[:, 1], [[0.0, -0.085, 0.13]] * 2, atol=0.005)
    assert (body.sole_offsets[:, 0, 2] < 0.0).all()


@pytest.mark.parametrize("rest", ["T", "A", "I", "bones"])
@pytest.mark.parametrize("how", [how for how in CONVENTIONS if how.name != "capitals"], ids=lambda how: how.name)
def test_points_of_the_body_move_alike_in_every_convention(boxer, how, rest):
    clip = to_clip(export_motion(*boxer, how, Export(rest=rest)), 0.01)
    body = measure_body(clip)
    assert body.height == pytest.approx(1.75, abs=0.03)
    plain = to_clip(export_motion(*boxer, BY_NAME["lafan"], Export()), 0.01)
    ours = build_tracks(measure_body(plain), *clip_kinematics(plain))
    theirs = build_tracks(body, *clip_kinematics(clip))
    limits = {"ground": 0.025, "fists": 0.06, "shoulders": 0.02, "heads": 0.09, "necks": 0.12, "pelvises": 0.03}
    for name, limit in {**limits, "balls": 0.09, "heels": 0.09}.items():
        gap = np.abs(getattr(ours, name) - getattr(theirs, name))
        assert np.median(gap) < limit, name
        assert gap.max() < 3.0 * limit, name


def test_sizes_scale_with_the_body():
    skeleton = build_skeleton()
    ours, theirs = build_body(skeleton), build_body(skeleton.scaled(0.5))
    assert theirs.height == pytest.approx(0.5 * ours.height)
    for name in ("fist_offsets", "head_offset", "sole_offsets", "capsule_starts", "capsule_ends", "capsule_radii"):
        np.testing.assert_allclose(getattr(theirs, name), 0.5 * getattr(ours, name), atol=1e-12)
    assert theirs.torso_radius == pytest.approx(0.5 * ours.torso_radius)


def test_height_needs_no_true_rest_pose(boxer):
    clip = to_clip(export_motion(*boxer, BY_NAME["cmu"], Export(rest="bones")), 0.01)
    roles = find_roles(clip.skeleton)
    assert not rests_like_a_body(clip.skeleton, roles)
    pose = sample_poses(clip)[0][0]
    assert standing_height(clip.skeleton, roles, pose) == pytest.approx(1.75, abs=0.02)


def test_capsules_are_sound():
    skeleton = build_skeleton()
    body = build_body(skeleton)
    count = len(body.capsule_joints)
    assert count > 15
    assert body.capsule_starts.shape == body.capsule_ends.shape == (count, 3)
    assert body.capsule_radii.shape == (count, 2)
    assert (body.capsule_radii > 0.0).all()
    assert body.capsule_parts.max() < len(PARTS)
    assert set(body.capsule_parts) == {PARTS.index(part) for part in PARTS}
    rest = skeleton.rest_positions()[body.capsule_joints]
    points = np.concatenate([rest + body.capsule_starts, rest + body.capsule_ends])
    assert points[:, 1].min() > -0.01
    assert points[:, 1].max() < 1.75
    # What is on the left is on the right.
    mirror = points * [-1.0, 1.0, 1.0]
    gaps = np.linalg.norm(points[:, None] - mirror[None], axis=-1).min(axis=1)
    assert gaps.max() < 1e-9


def test_a_given_pose_gives_the_same_body_as_the_rest_pose():
    skeleton = build_skeleton()
    plain = build_body(skeleton)
    turn = quaternion.about_y(1.0)
    places = quaternion.rotate(turn, skeleton.rest_positions())
    turns = np.repeat(turn[None], skeleton.joint_count, axis=0)
    posed = build_body(skeleton, pose=(places, turns))
    np.testing.assert_allclose(posed.fist_offsets, plain.fist_offsets, atol=1e-9)
    np.testing.assert_allclose(posed.sole_offsets, plain.sole_offsets, atol=1e-9)
    np.testing.assert_allclose(posed.capsule_ends, plain.capsule_ends, atol=1e-9)


def test_what_is_no_body_is_refused_with_its_joints():
    skeleton = Skeleton(tuple("abcdefghijkl"), np.arange(-1, 11, dtype=np.int32), np.ones((12, 3)))
    with pytest.raises(MotionError) as error:
        build_body(skeleton)
    assert str(error.value) == (
        "no human body found in the 12 joints a, b, c, d, e, f, g, h ...; "
        "expected a head, two hands and two feet on a trunk"
    )


def test_frames_that_are_not_finite_are_no_poses(boxer):
    clip = boxer[0]
    rotations = clip.rotations.copy()
    rotations[::2, 3, 1] = np.nan
    positions, _ = sample_poses(replace(clip, rotations=rotations))
    assert len(positions) == 64
    assert np.isfinite(positions).all()
