"""The motion of one skeleton on another: proportions, planted feet, fists and gaze are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conventions import CONVENTIONS
from exporters import UPS, Export, export_motion

from crowdsim.bvh.io import to_clip
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.analysis import analyse_clip
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import MeasuredClip, measure_body
from crowdsim.motion.mirroring import mirrored
from crowdsim.motion.retargeting import retarget, to_one_skeleton
from crowdsim.motion.tracks import Tracks, clip_tracks, speeds
from crowdsim.performer.session import perform

HOW = {how.name: how for how in CONVENTIONS}


@pytest.fixture(scope="module")
def boxer() -> MeasuredClip:
    clip = perform(8.0, 2)[0].clip
    return MeasuredClip(clip, measure_body(clip))


def exported(boxer: MeasuredClip, name: str, export: Export) -> MeasuredClip:
    clip = to_clip(export_motion(boxer.clip, dict(boxer.body.roles), HOW[name], export))
    return MeasuredClip(replace(clip, name=name), measure_body(clip))


def tracks(measured: MeasuredClip) -> Tracks:
    return clip_tracks(measured.clip, measured.body)


def stretched(boxer: MeasuredClip, role: str, factor: float) -> MeasuredClip:
    """The same motion on a skeleton whose bones to a role are longer, as another session calibrates them."""
    offsets = boxer.clip.skeleton.offsets.copy()
    for side in ("left", "right"):
        offsets[boxer.body.roles[f"{side}_{role}"]] *= factor
    clip = replace(boxer.clip, skeleton=replace(boxer.clip.skeleton, offsets=offsets))
    return MeasuredClip(clip, measure_body(clip))


def test_motion_on_its_own_skeleton_stays_as_it_is(boxer):
    result = retarget(boxer, boxer)
    positions, rotations = (clip_kinematics(one.clip) for one in (boxer, result.measured))
    np.testing.assert_allclose(rotations[0], positions[0], atol=3e-4)
    np.testing.assert_allclose(np.abs(np.sum(rotations[1] * positions[1], axis=-1)), 1.0, atol=1e-6)
    assert result.scale == pytest.approx(1.0)
    assert result.describe() == "as large, soles within 0.0 cm, fists within 0.0 cm"


@pytest.mark.parametrize("rest", ["T", "I"])
@pytest.mark.parametrize("name", ["cmu", "mixamo", "xsens", "unreal", "connectors", "twist", "flat", "japanese"])
def test_an_export_under_other_names_comes_back_as_the_motion_that_it_was(boxer, name, rest):
    source = exported(boxer, name, Export(scale=1.0, rest=rest))
    result = retarget(source, boxer)
    assert result.measured.clip.skeleton is boxer.clip.skeleton
    theirs, ours = tracks(source), tracks(result.measured)
    for points, limit in (("fists", 0.01), ("balls", 0.001), ("heels", 0.001), ("shoulders", 0.001), ("heads", 0.02)):
        gap = np.linalg.norm(getattr(ours, points) - getattr(theirs, points), axis=-1)
        assert gap.max() < limit, points


@pytest.mark.parametrize("name", ["mixamo", "rigify", "xsens"])
def test_a_smaller_body_keeps_proportions_with_rest_poses_that_are_none(boxer, name):
    source = exported(boxer, name, Export(scale=1.0, rest="bones", size=0.9))
    result = retarget(source, boxer)
    assert result.scale == pytest.approx(1.0 / 0.9, rel=0.01)
    theirs, ours = tracks(source), tracks(result.measured)
    for points, limit in (("fists", 0.05), ("balls", 0.025), ("pelvises", 0.02), ("shoulders", 0.05)):
        gap = np.linalg.norm(getattr(ours, points) - result.scale * getattr(theirs, points), axis=-1)
        assert np.median(gap) < limit, points


def test_longer_thighs_bend_more_and_soles_stay_planted(boxer):
    longer = stretched(boxer, "knee", 1.08)
    result = retarget(boxer, longer)
    assert result.scale == pytest.approx(1.0 + 0.08 * 0.425 / 0.835, abs=1e-3)
    assert 100.0 * result.bones["thigh"] == pytest.approx(100.0 * (1.08 - result.scale) * 0.425, abs=0.05)
    assert "thigh +" in result.describe()
    assert result.soles < 0.001
    ours = analyse_clip(result.measured.clip, longer.body)
    theirs = analyse_clip(boxer.clip, boxer.body)
    assert abs(ours.contacts.mean() - theirs.contacts.mean()) < 0.02
    slides = [
        np.median(speeds(one.tracks.balls[:, side], 60.0)[one.contacts[:, side]])
        for one in (ours, theirs)
        for side in (0, 1)
    ]
    assert max(slides[:2]) < 1.2 * max(slides[2:]) + 0.005
    assert np.array_equal(ours.strikes.limbs, theirs.strikes.limbs)
    np.testing.assert_allclose(ours.strikes.frames, theirs.strikes.frames, atol=1)


def test_a_small_difference_of_calibration_changes_millimetres(boxer):
    longer = stretched(boxer, "hand", 1.03)
    result = retarget(longer, boxer)
    assert result.scale == pytest.approx(1.0)
    assert result.bones["forearm"] == pytest.approx(-0.03 * 0.262, abs=1e-4)
    assert result.describe().startswith("as large, bones forearm -0.8 cm")
    gap = np.linalg.norm(tracks(result.measured).fists - tracks(longer).fists, axis=-1)
    assert np.median(gap) < 0.012


def test_the_gaze_stays(boxer):
    source = exported(boxer, "mixamo", Export(scale=1.0, size=1.1, rest="I"))
    head = boxer.body.roles["head"]
    looks = [
        quaternion.rotate(clip_kinematics(one.clip)[1][:, joint], [0.0, 0.0, 1.0])
        for one, joint in ((retarget(source, boxer).measured, head), (boxer, head))
    ]
    np.testing.assert_allclose(looks[0], looks[1], atol=1e-4)


def test_motion_can_be_mirrored_and_lies_as_still_as_before(boxer):
    result = retarget(exported(boxer, "xsens", Export(scale=1.0, size=1.07, up=UPS["y"])), boxer).measured
    turns = [
        np.linalg.norm(np.diff(quaternion.continuous(one.clip.rotations), axis=0), axis=-1).max()
        for one in (result, boxer)
    ]
    assert turns[0] < 1.2 * turns[1]
    image = mirrored(result.clip, result.body)
    gap = clip_tracks(image, result.body).fists[:, ::-1] * [-1.0, 1.0, 1.0] - tracks(result).fists
    assert np.abs(gap).max() < 1e-5


def test_bodies_that_are_no_two_people_are_refused_with_joints_and_lengths(boxer):
    odd = stretched(boxer, "foot", 2.0)
    with pytest.raises(MotionError) as error:
        retarget(replace(odd, clip=replace(odd.clip, name="odd")), boxer)
    assert str(error.value) == (
        "'odd' is unlike 'performer_00': shank (LeftLeg to LeftFoot) of 82.0 cm at a height of 2.24 m, "
        "expected about 52.4 cm"
    )


def test_clips_are_brought_to_the_skeleton_with_the_longest_motion(boxer):
    long = exported(boxer, "mixamo", Export(scale=1.0))
    short = replace(boxer, clip=boxer.clip.sliced(0, 200))
    again = replace(boxer, clip=boxer.clip.sliced(0, 100))
    clips, changes = to_one_skeleton([short, long, again])
    assert [one.clip.skeleton.names for one in clips] == [long.clip.skeleton.names] * 3
    assert clips[1] is long
    assert list(changes) == [boxer.clip.name]
    same, none = to_one_skeleton([short, again])
    assert none == {}
    assert same[0] is short
    assert to_one_skeleton([]) == ([], {})


def test_prefixes_are_no_difference_and_others_are_all_named(boxer):
    skeleton = boxer.clip.skeleton
    sam = replace(skeleton, names=tuple(f"Sam_{name}" for name in skeleton.names))
    alex = replace(skeleton, names=tuple(f"Alex:{name}" for name in skeleton.names))
    assert sam.difference(alex) == skeleton.difference(sam) == ""
    renamed = replace(skeleton, names=tuple(name.replace("UpLeg", "Thigh") for name in skeleton.names))
    assert skeleton.difference(renamed) == (
        "joint 14 is 'LeftThigh', expected 'LeftUpLeg', joint 18 is 'RightThigh', expected 'RightUpLeg'"
    )
    longer = stretched(boxer, "hand", 1.1).clip.skeleton
    assert skeleton.difference(longer) == (
        "offsets of joints differ: 'LeftHand' by 2.6 cm (28.8 cm long, expected 26.2 cm), "
        "'RightHand' by 2.6 cm (28.8 cm long, expected 26.2 cm)"
    )
    assert skeleton.difference(stretched(boxer, "hand", 1.01).clip.skeleton) == ""
