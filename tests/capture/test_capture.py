"""The report on a capture: unit, axis, roles, findings; and what may be trained on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from animals import ANIMALS, export_animal
from conventions import CONVENTIONS
from exporters import UPS, Export, export_motion

from crowdsim.bvh.io import format_bvh, to_clip, write_bvh
from crowdsim.capture.loading import load_capture, usable_clips
from crowdsim.capture.report import describe_capture
from crowdsim.errors import BvhError, MotionError
from crowdsim.motion.roles import find_roles
from crowdsim.performer.session import perform

BY_NAME = {how.name: how for how in CONVENTIONS}


@pytest.fixture(scope="module")
def boxer():
    clip = perform(6.0, 2)[0].clip
    return clip, find_roles(clip.skeleton)


def _write(folder: Path, bvh) -> Path:
    path = folder / "clip.bvh"
    write_bvh(path, bvh)
    return path


VARIETY = [
    ("mixamo", "y", Export(scale=0.01, heading=1.0)),
    ("cmu", "y", Export(scale=0.0254 / 0.45, heading=-1.6)),
    ("biped", "z", Export(scale=0.0254, up=UPS["z"], order="mixed")),
    ("blender_meta", "z", Export(scale=1.0, up=UPS["z"], turn_rest=False)),
    ("makehuman", "y", Export(scale=0.1)),
    ("unreal", "z", Export(scale=0.01, up=UPS["z"], six=True, rest="A")),
    ("smpl", "-y", Export(scale=1.0, up=UPS["-y"])),
    ("vrm", "y", Export(scale=1.0, heading=3.1)),
    ("flat_fingers", "-z", Export(scale=0.001, up=UPS["-z"])),
    ("japanese", "x", Export(scale=1.0, up=UPS["x"])),
    ("captury", "y", Export(rest="bones", scale=0.001)),
    ("azure", "-y", Export(rest="I", up=UPS["-y"], scale=0.001)),
]


@pytest.mark.parametrize(("name", "axis", "export"), VARIETY, ids=[row[0] for row in VARIETY])
def test_unit_axis_height_and_what_happens_do_not_depend_on_the_exporter(boxer, tmp_path, name, axis, export):
    plain = load_capture(_write(tmp_path, boxer[0]))
    result = describe_capture(plain)
    path = _write(tmp_path, export_motion(*boxer, BY_NAME[name], export))
    capture = load_capture(path)
    found = describe_capture(capture)
    assert found["unit_scale"] == pytest.approx(export.scale)
    assert found["up_axis"] == axis
    assert found["height_m"] == pytest.approx(1.75, abs=0.03)
    assert found["strikes"] == result["strikes"] > 0
    assert abs(found["contacts"] - result["contacts"]) <= 2
    assert found["findings"] == []
    assert capture.clip.root_positions[:, 1].min() > -2.0


@pytest.mark.parametrize("size", [0.63, 1.3])
def test_children_and_tall_people_are_measured(boxer, tmp_path, size):
    capture = load_capture(_write(tmp_path, export_motion(*boxer, BY_NAME["lafan"], Export(size=size))))
    assert capture.unit_scale == 0.01
    assert capture.body.height == pytest.approx(1.75 * size, rel=0.02)


def test_a_giant_has_no_known_scale_and_keeps_file_units(boxer, tmp_path):
    capture = load_capture(_write(tmp_path, export_motion(*boxer, BY_NAME["lafan"], Export(size=3.0))))
    assert capture.unit_scale is None
    assert capture.body is None
    assert capture.roles
    assert capture.findings[0].startswith("unknown scale: the body's height would be 526 m in m")
    assert capture.analysis is None
    given = load_capture(capture.clip.source, unit="cm")
    assert given.body.height == pytest.approx(5.25, rel=0.02)


def test_unit_and_axis_may_be_given(boxer, tmp_path):
    path = _write(tmp_path, export_motion(*boxer, BY_NAME["lafan"], Export()))
    capture = load_capture(path, unit="inch", up_axis="z")
    assert (capture.unit_scale, capture.up_axis) == (0.0254, "z")
    with pytest.raises(MotionError, match="unit 'yard' is unknown"):
        load_capture(path, unit="yard")
    with pytest.raises(MotionError, match="up axis 'q' is unknown"):
        load_capture(path, up_axis="q")


@pytest.mark.parametrize("frames", [0, 1])
def test_no_motion_is_a_fault(boxer, tmp_path, frames):
    bvh = export_motion(*boxer, BY_NAME["lafan"], Export(frames=slice(0, frames)))
    capture = load_capture(_write(tmp_path, bvh))
    what = "a single frame, expected motion" if frames else "no frames, expected motion"
    assert capture.findings == (what,) == capture.faults
    assert capture.up_axis == "y"
    with pytest.raises(MotionError, match=rf"clip\.bvh:1:1: {what}"):
        usable_clips(capture, strict=False)


@pytest.mark.parametrize("name", ANIMALS)
def test_animals_are_reported_as_no_human_body(tmp_path, name):
    capture = load_capture(_write(tmp_path, export_animal(ANIMALS[name])))
    assert capture.roles == {}
    assert capture.unit_scale is None
    assert [finding.split(":")[0].split(" in ")[0] for finding in capture.faults] == [
        "no human body found",
        "unknown scale",
    ]
    assert capture.analysis is None


@pytest.mark.parametrize("along_x", [False, True])
@pytest.mark.parametrize("axis", ["y", "z"])
@pytest.mark.parametrize("name", ["dog", "horse", "bird", "spider"])
def test_the_legs_of_animals_determine_the_up_axis(tmp_path, name, axis, along_x):
    capture = load_capture(_write(tmp_path, export_animal(ANIMALS[name], up=UPS[axis], along_x=along_x)))
    assert capture.up_axis == axis


def test_a_wrong_row_count_is_reported_with_both_numbers_and_refused_for_training_unless_allowed(boxer, tmp_path):
    path = _write(tmp_path, boxer[0])
    path.write_bytes(path.read_bytes().replace(b"Frames: 360", b"Frames: 400"))
    capture = load_capture(path)
    assert capture.findings == capture.faults
    assert capture.findings == ("line 133, column 9: 360 rows of motion, Frames: says 400",)
    with pytest.raises(MotionError) as error:
        usable_clips(capture)
    assert str(error.value) == f"{path}:133:9: 360 rows of motion, Frames: says 400"
    assert usable_clips(capture, strict=False)[0].clip is capture.clip


@pytest.mark.parametrize("value", [b"nan", b"inf"])
def test_channels_that_are_not_finite_are_reported_with_their_position(boxer, tmp_path, value):
    text = format_bvh(export_motion(*boxer, BY_NAME["lafan"], Export())).splitlines()
    row = text[-3].split()
    row[7] = value
    text[-3] = b" ".join(row)
    path = tmp_path / "clip.bvh"
    path.write_bytes(b"\n".join(text))
    capture = load_capture(path)
    assert len(capture.faults) == 1
    assert "frame 357, joint 'LeftUpLeg', channel" in capture.faults[0]
    assert capture.analysis is None
    assert capture.unit_scale == 0.01
    with pytest.raises(MotionError):
        usable_clips(capture, strict=False)


def test_flips_are_reported_with_joint_and_frames(boxer, tmp_path):
    bvh = export_motion(*boxer, BY_NAME["lafan"], Export())
    column = int(bvh.first_channels()[bvh.names.index("LeftForeArm")])
    motion = bvh.motion.copy()
    motion[200:, column] += 150.0
    capture = load_capture(_write(tmp_path, replace(bvh, motion=motion)))
    angle = abs(motion[200, column] - motion[199, column])
    assert 140.0 < angle < 160.0
    assert capture.faults == (f"joint 'LeftForeArm' flips by {angle:.0f} degrees between frames 199 and 200",)


def test_many_flips_are_counted(boxer, tmp_path):
    bvh = export_motion(*boxer, BY_NAME["lafan"], Export())
    motion = bvh.motion.copy()
    motion[100:200:2, int(bvh.first_channels()[3])] += 170.0
    capture = load_capture(_write(tmp_path, replace(bvh, motion=motion)))
    assert capture.faults[-1].endswith("more flips of joints")
    assert len(capture.faults) == 21


def test_joints_that_stretch_are_reported_and_may_be_trained_on(boxer, tmp_path):
    bvh = export_motion(*boxer, BY_NAME["lafan"], Export(six=True))
    motion = bvh.motion.copy()
    motion[:, int(bvh.first_channels()[bvh.names.index("LeftHand")])] += np.linspace(0.0, 20.0, len(motion))
    capture = load_capture(_write(tmp_path, replace(bvh, motion=motion)))
    assert capture.faults == ()
    assert capture.findings == ("1 joints move against their parents, 'LeftHand' by 0.200 m",)
    assert usable_clips(capture)[0].clip is capture.clip


@pytest.mark.parametrize("name", ["unreal", "rigify", "vrm", "bandai", "accad"])
def test_roots_that_carry_the_body_and_helpers_of_a_rig_do_not_count_as_stretching(boxer, tmp_path, name):
    capture = load_capture(_write(tmp_path, export_motion(*boxer, BY_NAME[name], Export())))
    assert capture.clip.translations is not None
    assert capture.findings == ()


@pytest.mark.parametrize("axis", UPS)
@pytest.mark.parametrize("six", [False, True])
def test_the_clip_is_the_one_that_reading_with_unit_and_axis_gives(boxer, tmp_path, axis, six):
    path = _write(tmp_path, export_motion(*boxer, BY_NAME["mixamo"], Export(up=UPS[axis], six=six)))
    capture = load_capture(path)
    clip = to_clip(capture.bvh, 0.01, axis)
    np.testing.assert_allclose(capture.clip.root_positions, clip.root_positions, atol=1e-12)
    np.testing.assert_allclose(capture.clip.rotations, clip.rotations, atol=1e-12)
    np.testing.assert_allclose(capture.clip.skeleton.offsets, clip.skeleton.offsets, atol=1e-9)
    np.testing.assert_allclose(capture.clip.skeleton.end_offsets, clip.skeleton.end_offsets, atol=1e-12)


def test_what_is_no_bvh_is_refused(tmp_path):
    path = tmp_path / "clip.bvh"
    path.write_text("Once upon a time\n")
    with pytest.raises(BvhError, match=r"clip\.bvh:1"):
        load_capture(path)
    with pytest.raises(BvhError):
        load_capture(tmp_path / "missing.bvh")


def test_findings_of_the_file_name_the_line(boxer, tmp_path):
    path = _write(tmp_path, boxer[0])
    lines = path.read_bytes().splitlines()
    lines[-2] = b"1.0 2.0 3.0"
    path.write_bytes(b"\n".join(lines))
    capture = load_capture(path)
    assert capture.findings[0].startswith(f"line {len(lines) - 1}, column 1: row of 3 numbers, expected 69")
    assert capture.findings[1].endswith("359 rows of motion, Frames: says 360")
    assert capture.faults == capture.findings[:1]


@pytest.mark.parametrize("declared", [359, 361])
def test_a_file_with_one_row_more_or_fewer_than_it_says_is_used_with_a_finding(boxer, tmp_path, declared):
    path = _write(tmp_path, boxer[0])
    path.write_bytes(path.read_bytes().replace(b"Frames: 360", b"Frames: %d" % declared))
    capture = load_capture(path)
    assert capture.findings == (f"line 133, column 9: 360 rows of motion, Frames: says {declared}",)
    assert capture.faults == ()
    assert usable_clips(capture)[0].clip is capture.clip


def test_a_last_row_that_is_cut_off_is_left_out_with_a_finding(boxer, tmp_path):
    path = _write(tmp_path, boxer[0])
    path.write_bytes(path.read_bytes()[:-200])
    capture = load_capture(path)
    assert "one a channel; left out" in capture.findings[0]
    assert capture.faults == ()
    assert usable_clips(capture)[0].clip.frame_count == 359
