"""Faults of capture are found, named and repaired, and none is seen in the clean twin of a faulty file."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conventions import CONVENTIONS
from exporters import Export, export_motion

from crowdsim.bvh.io import Bvh, from_clip, write_bvh
from crowdsim.capture.faults import FAULTS
from crowdsim.capture.loading import load_capture, usable_clips
from crowdsim.capture.report import describe_capture
from crowdsim.errors import MotionError
from crowdsim.motion import quaternion
from crowdsim.motion.measuring import measure_body
from crowdsim.motion.roles import find_roles
from crowdsim.performer.session import perform

ROOT = Path(__file__).parents[2]
KINDS = [fault.name for fault in FAULTS]


@pytest.fixture(scope="module")
def made():
    """The module that makes faults."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        return importlib.import_module("_capture_faults")


@pytest.fixture(scope="module")
def judge(made):
    """The benchmark that counts them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        return importlib.import_module("capture")


@pytest.fixture(scope="module")
def boxer():
    """A clip in which the boxer travels, without its calibration pose."""
    return perform(20.0, 1)[0].clip.sliced(60, 720)


def written(folder: Path, bvh: Bvh, **how):
    path = folder / "clip.bvh"
    write_bvh(path, bvh)
    if not np.isclose(bvh.frame_time * bvh.fps, 1.0):
        pytest.fail("frame time and rate of the test's file differ")
    return load_capture(path, **how)


def made_with(made, clip, fault: str) -> Bvh:
    return made.FAULTS[fault][1](from_clip(clip))


NAMES = (
    "frame time in milliseconds", "frame time in microseconds", "frames per second for a frame time",
    "frame time a thousand times too short", "root in m, bones in cm", "root in mm, bones in cm",
    "root in inches, bones in m", "root in inches, bones in cm", "root in cm, bones in inches",
    "root with z up, bones with y up", "root as displacements of each frame",
    "root steps", "root at the origin for 6 frames", "6 rows of zeros", "root held for 5 frames", "root drifts",
    "left-handed", "tilted by 10 degrees", "tilted by 12 degrees", "tilted by 25 degrees", "angles in radians",
    "angles of all joints but the root in radians", "angles of the root alone in radians", "angles in turns",
    "angles converted twice", "angles in the opposite sense",
    "rotations named in reverse order", "rotations named in the order XYZ",
    "rotations of the root alone named in the order XYZ",
    "root's positions and rotations exchanged", "positions are displacements, all zero",
    "positions are displacements of a share of a bone", "positions are offsets in another unit",
    "positions are places in the world", "a frozen second at the start", "10 rows of zeros at the end",
    "every row twice", "frozen for half a second", "a blend of 0.5 s from a T-pose",
    "a T-pose for a second in the middle", "names of left and right exchanged in the arms",
    "names of left and right exchanged in the legs", "rotations are those in the world",
    "positions are places against the root", "an arm was lost for a second", "single frames of an elbow are wrong",
    "root a quarter of a second late", "left and right confused for 5 frames",
    "poses of another time for half a second", "root elsewhere in the first frame",
    "root elsewhere in the last frame", "root elsewhere in the first 3 frames",
)  # fmt: skip


@pytest.mark.parametrize("fault", NAMES)
def test_a_fault_is_named_and_repaired_so_that_the_motion_is_that_of_the_clean_clip(
    made, judge, boxer, tmp_path, fault
):
    true = written(tmp_path, from_clip(boxer))
    capture = written(tmp_path, made_with(made, boxer, fault))
    assert [outcome.diagnosis.fault for outcome in capture.diagnoses] == [made.FAULTS[fault][0]]
    assert capture.diagnoses[0].done in ("repaired", "left_out")
    assert capture.diagnoses[0].words in capture.findings
    assert capture.faults == ()
    assert judge.is_restored(true, capture)


@pytest.mark.parametrize(
    "fault",
    ["an arm was not captured", "a leg was not captured", "root without rotations",
     "root without rotations but its heading", "root keeps its height", "root rises", "root sways up and down",
     "root goes twice as far", "tilts slowly by 15 degrees", "tilts slowly by 25 degrees"],
)  # fmt: skip
def test_a_fault_without_a_sure_repair_is_named_and_not_trained_on(made, boxer, tmp_path, fault):
    capture = written(tmp_path, made_with(made, boxer, fault))
    kind = made.FAULTS[fault][0]
    assert kind in [outcome.diagnosis.fault for outcome in capture.diagnoses if outcome.refused]
    with pytest.raises(MotionError, match=f"{kind}: "):
        usable_clips(capture)
    usable_clips(written(tmp_path, made_with(made, boxer, fault), faults=dict.fromkeys(KINDS, "keep")))


def test_the_path_of_a_root_that_sways_is_put_on_one_floor_where_asked_for(made, boxer, tmp_path):
    bvh = made_with(made, boxer, "root sways up and down")
    capture = written(tmp_path, bvh, faults={"floor": "repair"})
    lowest = capture.analysis.clip.root_positions[:, 1]
    true = written(tmp_path, from_clip(boxer)).analysis.clip.root_positions[:, 1]
    assert np.corrcoef(lowest, true)[0, 1] > 0.7
    assert capture.faults == ()


def test_a_body_without_any_rotation_is_no_capture_unless_it_keeps_still(boxer, tmp_path):
    still = np.repeat(boxer.rotations[:1], boxer.frame_count, axis=0)
    capture = written(tmp_path, from_clip(replace(boxer, rotations=still)))
    assert [outcome.diagnosis.fault for outcome in capture.diagnoses if outcome.refused][:1] == ["limbs"]
    roots = np.repeat(boxer.root_positions[:1], boxer.frame_count, axis=0)
    roots[:, 0] += 0.003 * np.sin(np.arange(boxer.frame_count) / 20.0)
    assert written(tmp_path, from_clip(replace(boxer, rotations=still, root_positions=roots))).diagnoses == ()


def test_every_clean_version_of_a_clean_clip_is_without_findings(made, boxer, tmp_path):
    versions = dict(made.clean_twins(boxer, measure_body(boxer)))
    assert len(versions) == 9
    for name, bvh in versions.items():
        assert written(tmp_path, bvh).findings == (), name


@pytest.mark.parametrize("how", CONVENTIONS, ids=lambda how: how.name)
def test_no_convention_of_an_exporter_is_a_fault(boxer, tmp_path, how):
    bvh = export_motion(boxer.sliced(0, 240), find_roles(boxer.skeleton), how, Export())
    assert written(tmp_path, bvh).findings == ()


def test_a_repair_that_restores_what_was_there_leaves_a_clean_clip_to_the_last_digit(boxer, tmp_path):
    capture = written(tmp_path, from_clip(boxer))
    again = written(tmp_path, from_clip(boxer), faults=dict.fromkeys((fault.name for fault in FAULTS), "repair"))
    assert capture.diagnoses == again.diagnoses == ()
    np.testing.assert_array_equal(capture.clip.root_positions, again.clip.root_positions)
    np.testing.assert_array_equal(capture.clip.rotations, again.clip.rotations)


def test_someone_who_keeps_still_in_a_t_pose_has_no_angles_in_radians(boxer, tmp_path):
    frames = np.arange(300)
    still = boxer.sliced(0, 300)
    rotations = np.zeros_like(still.rotations)
    sway = np.deg2rad(1.5) * np.sin(frames / 40.0)
    rotations[..., 0] = 1.0
    spine = find_roles(boxer.skeleton)["spine"]
    rotations[:, spine, 0], rotations[:, spine, 1] = np.cos(sway / 2.0), np.sin(sway / 2.0)
    roots = np.repeat(still.root_positions[:1], 300, axis=0) + 0.002 * np.sin(frames / 30.0)[:, None]
    capture = written(tmp_path, from_clip(replace(still, rotations=rotations, root_positions=roots)))
    assert capture.findings == ()


@pytest.mark.parametrize("rate", [24.0, 25.0, 40.0])
def test_motion_that_was_brought_to_a_higher_rate_by_repeating_rows_has_its_own(boxer, tmp_path, rate):
    source = from_clip(boxer)
    count = int(boxer.seconds * rate)
    kept = source.motion[np.round(np.arange(count) * boxer.fps / rate).astype(int)]
    frames = np.floor(np.arange(int(boxer.seconds * 60.0)) * rate / 60.0).astype(int)
    capture = written(
        tmp_path, replace(source, motion=kept[np.minimum(frames, count - 1)], declared_frames=len(frames))
    )
    assert [outcome.diagnosis.fault for outcome in capture.diagnoses] == ["repeats"]
    assert capture.clip.fps == rate
    assert capture.clip.frame_count == pytest.approx(count, abs=1)


def test_rows_that_are_alike_since_a_body_keeps_still_show_no_other_rate(boxer, tmp_path):
    rotations = boxer.rotations.copy()
    frames = np.round(40.0 * np.cumsum(0.4 + 0.4 * np.sin(np.arange(boxer.frame_count) / 60.0)) / 40.0).astype(int)
    frames = np.minimum(frames, boxer.frame_count - 1)
    slowed = replace(boxer, rotations=rotations[frames], root_positions=boxer.root_positions[frames])
    assert written(tmp_path, from_clip(slowed)).clip.fps == boxer.fps


def test_a_body_in_place_is_not_trained_on_unless_asked_for(made, boxer, tmp_path):
    capture = written(tmp_path, made_with(made, boxer, "root does not travel"))
    assert [(outcome.diagnosis.fault, outcome.done) for outcome in capture.diagnoses] == [("in_place", "refused")]
    with pytest.raises(MotionError, match="in_place: the body moves in place"):
        usable_clips(capture)
    with pytest.raises(MotionError):
        usable_clips(capture, strict=False)
    kept = load_capture(tmp_path / "clip.bvh", faults={"in_place": "keep"})
    assert usable_clips(kept)[0].clip is kept.clip
    assert kept.findings[0].endswith("kept as it is, as asked")
    repaired = load_capture(tmp_path / "clip.bvh", faults={"in_place": "repair"})
    assert usable_clips(repaired)
    travelled = [np.ptp(capture.clip.root_positions[:, [0, 2]], axis=0).max() for capture in (kept, repaired)]
    assert travelled[0] < 0.01
    assert travelled[1] > 0.5


def test_a_fault_that_could_be_repaired_is_refused_or_kept_where_asked_for(made, boxer, tmp_path):
    bvh = made_with(made, boxer, "left-handed")
    refused = written(tmp_path, bvh, faults={"handedness": "refuse"})
    assert refused.faults == refused.findings
    assert refused.faults[0].startswith("handedness: coordinates are left-handed: toes and knees point backward")
    kept = written(tmp_path, bvh, faults={"handedness": "keep"})
    assert kept.faults == ()
    assert kept.diagnoses[0].done == "kept"
    repaired = written(tmp_path, bvh)
    names = repaired.clip.skeleton.names
    left = names.index("LeftFoot")
    assert np.sign(kept.clip.skeleton.rest_positions()[left, 0]) != np.sign(
        repaired.clip.skeleton.rest_positions()[left, 0]
    )


def test_unknown_kinds_of_faults_are_refused(boxer, tmp_path):
    bvh = from_clip(boxer)
    with pytest.raises(MotionError, match=r"fault 'handednes' is unknown \(did you mean 'handedness'\?\)"):
        written(tmp_path, bvh, faults={"handednes": "keep"})
    with pytest.raises(MotionError, match="fault 'tilt': 'mend' is unknown, expected repair, keep, refuse"):
        written(tmp_path, bvh, faults={"tilt": "mend"})
    with pytest.raises(MotionError, match="fault 'tilt': 30"):
        written(tmp_path, bvh, faults={"tilt": 30.0})
    with pytest.raises(MotionError, match="or 1 to 2000 frames a second"):
        written(tmp_path, bvh, faults={"time_base": 0.1})


def test_frames_are_named_left_out_and_part_the_clip(made, boxer, tmp_path):
    capture = written(tmp_path, made_with(made, boxer, "root at the origin for 6 frames"))
    middle = boxer.frame_count // 2
    assert f"in frames {middle} to {middle + 5} " in capture.findings[0]
    assert capture.spans == ((0, middle), (middle + 6, boxer.frame_count))
    clips = usable_clips(capture)
    assert [clip.clip.frame_count for clip in clips] == [middle, boxer.frame_count - middle - 6]
    assert describe_capture(capture)["lost_frames"] == 6
    # Poses between those around them bridge what is lost, so that pictures and analysis do not jump.
    steps = np.linalg.norm(np.diff(capture.clip.root_positions, axis=0), axis=1)
    assert steps.max() < 0.1


def test_a_jump_to_another_pose_parts_the_clip(boxer, tmp_path):
    frames = np.r_[0:300, 500:660]
    jumping = replace(boxer, root_positions=boxer.root_positions[frames], rotations=boxer.rotations[frames])
    jumping.root_positions[300:, 0] += 2.0
    capture = written(tmp_path, from_clip(jumping))
    assert "jumps to another pose" in capture.findings[0]
    assert capture.spans == ((0, 300), (300, 460))


def test_a_pose_that_jumps_parts_the_clip_where_the_root_goes_on_and_jumps_all_over_are_refused(boxer, tmp_path):
    frames = np.r_[0:300, 500:660]
    roots = boxer.root_positions[frames]
    roots[300:] -= boxer.root_positions[500] - boxer.root_positions[300]
    joined = replace(boxer, root_positions=roots, rotations=boxer.rotations[frames])
    capture = written(tmp_path, from_clip(joined))
    (finding,) = capture.findings
    assert finding == ("pose_jumps: the pose jumps before frame 300 (95 % sure); the clip is divided there")
    assert [clip.clip.frame_count for clip in usable_clips(capture)] == [300, 160]
    shuffled = replace(
        boxer,
        rotations=boxer.rotations.reshape(33, 20, *boxer.rotations.shape[1:])[::-1].reshape(boxer.rotations.shape),
    )
    with pytest.raises(MotionError, match=r"pose_jumps: the pose jumps \d+ times"):
        usable_clips(written(tmp_path, from_clip(shuffled)))


@pytest.mark.parametrize("end", [0, -1])
def test_a_pose_that_is_a_little_different_in_the_first_or_the_last_frame_is_left_out(boxer, tmp_path, end):
    roles, rotations = find_roles(boxer.skeleton), boxer.rotations.copy()
    turned = [roles[role] for role in ("left_hip", "right_hip", "left_knee", "right_knee", "spine", "neck")]
    turn = quaternion.from_rotation_vector(np.deg2rad([14.0, 0.0, 0.0]))
    rotations[end, turned] = quaternion.multiply(rotations[end, turned], turn)
    capture = written(tmp_path, from_clip(replace(boxer, rotations=rotations)))
    count = boxer.frame_count
    (finding,) = capture.findings
    assert finding.startswith(f"pose_jumps: the pose jumps before frame {1 if end == 0 else count - 1} ")
    assert capture.spans == (((1, count),) if end == 0 else ((0, count - 1),))
    assert capture.faults == ()


def test_a_root_that_is_elsewhere_at_an_end_is_left_out_there_and_the_rest_keeps_its_place(made, boxer, tmp_path):
    for fault, span in (("first", (1, boxer.frame_count)), ("last", (0, boxer.frame_count - 1))):
        capture = written(tmp_path, made_with(made, boxer, f"root elsewhere in the {fault} frame"))
        assert capture.spans == (span,)
        assert np.abs(capture.clip.root_positions - boxer.root_positions)[slice(*span)].max() < 0.002


@pytest.mark.parametrize("frame_time", [1e8, 8333.0, 1e-8])
def test_no_frame_time_makes_more_frames_than_a_file_has(boxer, tmp_path, frame_time):
    capture = written(tmp_path, replace(from_clip(boxer), fps=1.0 / frame_time, frame_time=frame_time))
    assert [outcome.diagnosis.fault for outcome in capture.diagnoses] == ["time_base"]
    assert 1.0 <= capture.clip.fps <= 2000.0
    assert capture.analysis.clip.frame_count < 100_000


def test_the_rate_of_a_file_may_be_given(boxer, tmp_path):
    bvh = replace(from_clip(boxer), fps=0.5, frame_time=2.0)
    capture = written(tmp_path, bvh)
    assert capture.diagnoses[0].refused
    given = load_capture(tmp_path / "clip.bvh", faults={"time_base": 60})
    assert given.clip.fps == 60.0
    assert given.findings[-1] == "time_base: it is read at 60 frames a second, as asked"
    assert usable_clips(given)
    assert describe_capture(given)["seconds"] == pytest.approx(boxer.seconds)


def test_what_is_found_is_plain_data_with_how_sure_it_is(made, boxer, tmp_path):
    capture = written(tmp_path, made_with(made, boxer, "root in m, bones in cm"))
    (fault,) = describe_capture(capture)["faults"]
    assert list(fault) == ["fault", "what", "confidence", "done", "remedy"]
    assert fault["fault"] == "root_path"
    assert 0.9 <= fault["confidence"] < 1.0
    assert (fault["done"], fault["remedy"]) == ("repaired", "they are multiplied by 100")


def test_a_blend_to_a_calibration_pose_at_the_end_is_left_out_and_arms_that_sink_from_it_are_not(made, boxer, tmp_path):
    blended = made.FAULTS["a blend of 0.5 s from a T-pose"][1](from_clip(boxer))
    back = replace(blended, motion=np.ascontiguousarray(blended.motion[::-1]))
    capture = written(tmp_path, back)
    (finding,) = capture.findings
    assert finding.endswith("frames at the end are a blend to a calibration pose (95 % sure); they are left out")
    assert 24 <= int(finding.split()[1]) <= 33
    # An actor who takes the pose lets the arms sink, and nothing else goes with them.
    roles, rotations = find_roles(boxer.skeleton), boxer.rotations.copy()
    arms = [joint for role, joint in roles.items() if role.endswith(("shoulder", "elbow", "hand"))]
    shares = np.clip(np.arange(boxer.frame_count) / 40.0, 0.0, 1.0)[:, None, None]
    turns = quaternion.to_rotation_vector(rotations[:, arms])
    rotations[:, arms] = quaternion.from_rotation_vector(shares * turns)
    assert not any(
        "blend" in finding for finding in written(tmp_path, from_clip(replace(boxer, rotations=rotations))).findings
    )


@pytest.mark.mocap
@pytest.mark.parametrize(
    "fault",
    ["frame rate twice as high", "root drifts", "a blend of 0.5 s from a T-pose", "tilts slowly by 15 degrees"],
)
def test_walks_of_real_capture_with_faults_that_others_hide_are_found(made, mocap, tmp_path, fault):
    found = []
    for name in ("cmu_02_01", "cmu_08_10", "cmu_10_04", "cmu_12_01", "cmu_12_02"):
        (path,) = mocap.rglob(f"{name}.bvh")
        clean = from_clip(load_capture(path).motion)
        assert written(tmp_path, clean).findings == ()
        capture = written(tmp_path, made.FAULTS[fault][1](clean))
        found.append(capture.diagnoses[0].diagnosis.fault)
    assert found == [made.FAULTS[fault][0]] * 5


@pytest.mark.mocap
@pytest.mark.parametrize("name", ["cmu_07_06", "cmu_07_09", "cmu_07_11", "cmu_08_01", "cmu_08_05", "cmu_08_11"])
def test_long_strides_with_a_clock_that_is_twice_too_fast_are_refused_with_about_their_rate(mocap, tmp_path, name):
    (path,) = mocap.rglob(f"{name}.bvh")
    clean = from_clip(load_capture(path).motion)
    for factor in (0.6, 1.0, 1.5):
        timed = replace(clean, fps=factor * clean.fps, frame_time=clean.frame_time / factor)
        assert written(tmp_path, timed).findings == ()
    (finding,) = written(tmp_path, replace(clean, fps=2.0 * clean.fps, frame_time=clean.frame_time / 2.0)).faults
    assert int(finding.partition("of a walk do at about ")[2].split()[0]) == pytest.approx(120, rel=0.2)


@pytest.mark.mocap
def test_real_capture_is_free_of_false_alarms(mocap):
    found = {path.name: load_capture(path).diagnoses for path in sorted(mocap.rglob("*.bvh"))}
    assert {name: [one.diagnosis.fault for one in faults] for name, faults in found.items() if faults} == {
        "cmu_13_18_boxing.bvh": ["elbows"]
    }
