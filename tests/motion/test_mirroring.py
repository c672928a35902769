"""A mirror image is what a mirror shows: the same paths at -x, left for right."""

from __future__ import annotations

import numpy as np
import pytest
from conventions import CONVENTIONS
from exporters import UPS, Export, export_motion

from crowdsim.bvh.io import to_clip
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.contacts import find_contacts
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import measure_body
from crowdsim.motion.mirroring import mirror_partners, mirrored
from crowdsim.motion.roles import find_roles
from crowdsim.motion.strikes import find_strikes
from crowdsim.motion.tracks import build_tracks
from crowdsim.performer.session import perform

BY_NAME = {how.name: how for how in CONVENTIONS}


@pytest.fixture(scope="module")
def boxer():
    clip = perform(6.0, 4)[0].clip
    return clip, find_roles(clip.skeleton)


def _clip(boxer, how, export):
    return to_clip(export_motion(*boxer, BY_NAME[how], export), export.scale)


@pytest.mark.parametrize("heading", [0.0, np.pi, 0.5 * np.pi, 2.0])
@pytest.mark.parametrize("how", ["mixamo", "flat_fingers", "daz_genesis", "unreal"])
@pytest.mark.parametrize("rest", ["T", "A"])
def test_mirrored_joints_are_at_the_mirror_images_of_their_counterparts(boxer, how, heading, rest):
    clip = _clip(boxer, how, Export(heading=heading, rest=rest, six=how == "unreal"))
    body = measure_body(clip)
    image = mirrored(clip, body)
    partner = mirror_partners(clip.skeleton, body)
    positions, _ = clip_kinematics(clip)
    seen, _ = clip_kinematics(image)
    ours = [joint for role, joint in body.roles.items()]
    np.testing.assert_allclose(seen[:, ours], positions[:, partner[ours]] * [-1.0, 1.0, 1.0], atol=1e-5)


def test_the_mirror_image_of_a_mirror_image_is_the_clip(boxer):
    clip = _clip(boxer, "lafan", Export())
    body = measure_body(clip)
    twice = mirrored(mirrored(clip, body), body)
    np.testing.assert_allclose(twice.root_positions, clip.root_positions, atol=1e-12)
    dots = np.abs(np.sum(twice.rotations * clip.rotations, axis=-1))
    np.testing.assert_allclose(dots, 1.0, atol=1e-12)


def test_mirrored_headings_change_sign_and_hands_and_feet_are_exchanged(boxer):
    clip = boxer[0]
    body = measure_body(clip)
    tracks, images = (build_tracks(body, *clip_kinematics(c)) for c in (clip, mirrored(clip, body)))
    for own, image in ((tracks.ground, images.ground), (tracks.stances, images.stances)):
        np.testing.assert_allclose(image[:, 0], -own[:, 0], atol=1e-9)
        np.testing.assert_allclose(np.angle(np.exp(1j * (image[:, 2] + own[:, 2]))), 0.0, atol=1e-9)
    contacts, shown = (find_contacts(t, body.height, clip.fps) for t in (tracks, images))
    assert np.array_equal(contacts, shown[:, ::-1])
    strikes, mirror = (find_strikes(t, body.height, clip.fps) for t in (tracks, images))
    assert len(strikes.frames) > 1
    assert np.array_equal(np.sort(strikes.frames), np.sort(mirror.frames))
    assert sorted(zip(strikes.frames, 1 - strikes.limbs, strict=True)) == sorted(
        zip(mirror.frames, mirror.limbs, strict=True)
    )


def test_partners_are_mutual_and_the_trunk_is_its_own(boxer):
    clip = _clip(boxer, "flat_fingers", Export())
    body = measure_body(clip)
    partner = mirror_partners(clip.skeleton, body)
    assert np.array_equal(partner[partner], np.arange(clip.skeleton.joint_count))
    for role in ("pelvis", "spine", "chest", "neck", "head"):
        assert partner[body.roles[role]] == body.roles[role]
    assert partner[body.roles["left_hand"]] == body.roles["right_hand"]


def test_a_rest_pose_that_lies_is_mirrored_as_well(boxer):
    clip = to_clip(export_motion(*boxer, BY_NAME["lafan"], Export(up=UPS["z"], turn_rest=False)), 0.01, "z")
    body = measure_body(clip)
    image = mirrored(clip, body)
    assert image.skeleton is clip.skeleton
    positions, seen = clip_kinematics(clip)[0], clip_kinematics(image)[0]
    hands = [body.roles["left_hand"], body.roles["right_hand"]]
    np.testing.assert_allclose(seen[:, hands[0]], positions[:, hands[1]] * [-1.0, 1.0, 1.0], atol=1e-5)


def test_a_skeleton_without_a_true_rest_pose_is_refused(boxer):
    clip = _clip(boxer, "lafan", Export(rest="bones"))
    with pytest.raises(MotionError, match="cannot be mirrored: the rest pose of its skeleton is no pose of a body"):
        mirrored(clip, measure_body(clip))


def test_rotations_stay_of_unit_length(boxer):
    clip = boxer[0]
    image = mirrored(clip, measure_body(clip))
    np.testing.assert_allclose(np.linalg.norm(image.rotations, axis=-1), 1.0, atol=1e-12)
    assert quaternion.normalise(image.rotations).shape == clip.rotations.shape
