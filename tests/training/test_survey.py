"""What a folder of capture holds: files in any layout, those that are left out with their reasons, and skeletons."""

import re
from pathlib import Path

import pytest
import yaml
from conventions import CONVENTIONS
from exporters import Export, export_motion
from people import together

from crowdsim.bvh.io import write_bvh
from crowdsim.errors import MotionError, PolicyError
from crowdsim.motion.roles import find_roles
from crowdsim.performer.session import perform, write_performance
from crowdsim.training.fit_recipe import BEHAVIOURS, recipe_text
from crowdsim.training.survey import survey_capture

CHAIN = """HIERARCHY
ROOT Base
{
  OFFSET 0 0 0
  CHANNELS 3 Xrotation Yrotation Zrotation
  End Site
  {
    OFFSET 0 10 0
  }
}
MOTION
Frames: 2
Frame Time: 0.016667
0 0 0
1 1 1
"""


@pytest.fixture(scope="module")
def clip(tmp_path_factory) -> bytes:
    return write_performance(tmp_path_factory.mktemp("clip"), 4.0, 3)[0].read_bytes()


def fill(folder: Path, files: dict[str, bytes]) -> Path:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    return folder


def cut(clip: bytes, frames: int) -> bytes:
    head, _, motion = clip.partition(b"Frames: 240")
    lines = motion.splitlines()
    return head + b"Frames: %d" % frames + b"\n".join(lines[: 2 + frames]) + b"\n"


def test_files_are_found_in_any_layout_and_sorted(tmp_path, clip):
    names = ["z.bvh", "a/b/take [1].bvh", "a/c.BVH", "b.bvh"]
    fill(tmp_path, {name: clip for name in names})
    fill(tmp_path, {"notes.txt": b"", "a/._c.BVH": b"hidden", ".old/d.bvh": clip})
    survey = survey_capture(tmp_path)
    assert [file.name for file in survey.used] == ["a/b/take [1].bvh", "a/c.BVH", "b.bvh", "z.bvh"]
    assert survey.left_out == ()
    assert survey.seconds == pytest.approx(16.0, abs=0.1)
    assert sum(survey.strikes) == 4 * sum(survey.used[0].strikes) > 0


def test_files_that_cannot_be_used_are_left_out_with_their_reason(tmp_path, clip):
    fill(
        tmp_path,
        {
            "a.bvh": clip,
            "b.bvh": clip,
            "chain.bvh": CHAIN.encode(),
            "one.bvh": cut(clip, 1),
            "other.bvh": clip.replace(b"OFFSET 0 -41 0", b"OFFSET 0 -80 0"),
            "rows.bvh": clip.replace(b"Frames: 240", b"Frames: 250"),
            "short.bvh": cut(clip, 5),
            "text.bvh": b"Once upon a time\n",
        },
    )
    survey = survey_capture(tmp_path)
    assert [file.name for file in survey.used] == ["a.bvh", "b.bvh"]
    assert {file.name: file.reason for file in survey.left_out} == {
        "chain.bvh": "line 1, column 1: no human body found in 1 joints: Base (and 1 more finding)",
        "one.bvh": "line 1, column 1: a single frame, expected motion",
        "other.bvh": "another skeleton: 'other' is unlike 'a': shank (LeftLeg to LeftFoot) of 80.0 cm at a height of "
        "2.22 m, expected about 51.9 cm",
        "rows.bvh": "line 133, column 9: 240 rows of motion, Frames: says 250",
        "short.bvh": "0.08 s after the lead-in, expected 0.20 s or more",
        "text.bvh": "line 1, column 1: found 'Once', expected 'HIERARCHY'",
    }


def test_a_folder_without_a_usable_file_is_refused_with_every_reason(tmp_path, clip):
    with pytest.raises(PolicyError, match="holds no BVH file, nor does a folder in it"):
        survey_capture(tmp_path)
    with pytest.raises(PolicyError, match="no such folder"):
        survey_capture(tmp_path / "none")
    fill(tmp_path, {"one.bvh": cut(clip, 1), "text.bvh": b"Once upon a time\n"})
    with pytest.raises(MotionError) as error:
        survey_capture(tmp_path)
    assert str(error.value).splitlines() == [
        f"{tmp_path}: none of its BVH files can be trained on",
        "  one.bvh: line 1, column 1: a single frame, expected motion",
        "  text.bvh: line 1, column 1: found 'Once', expected 'HIERARCHY'",
    ]


def test_files_of_other_skeletons_are_used_with_what_is_changed(tmp_path, clip):
    sam = re.sub(rb"(ROOT|JOINT) ", rb"\1 Sam_", clip)
    longer = clip.replace(b"OFFSET 26.2 0 0", b"OFFSET 27 0 0").replace(b"OFFSET -26.2 0 0", b"OFFSET -27 0 0")
    fill(tmp_path, {"a.bvh": clip, "b.bvh": sam, "c.bvh": longer, "d.bvh": cut(longer, 200)})
    survey = survey_capture(tmp_path)
    assert [file.name for file in survey.used] == ["a.bvh", "b.bvh", "c.bvh", "d.bvh"]
    assert survey.left_out == ()
    assert [file.change for file in survey.used] == [
        "",
        "",
        *["as large, bones forearm -0.8 cm, soles within 0.0 cm, fists within 0.0 cm"] * 2,
    ]
    # The skeleton with the longest motion is that of all.
    fill(tmp_path, {"e.bvh": longer, "f.bvh": longer})
    assert [bool(file.change) for file in survey_capture(tmp_path).used] == [True, True, False, False, False, False]


def test_motion_on_a_skeleton_without_the_rest_pose_of_a_body_is_not_to_be_mirrored(tmp_path, clip):
    fill(tmp_path, {"plain/a.bvh": clip})
    plain = survey_capture(tmp_path / "plain")
    how = next(one for one in CONVENTIONS if one.name == "lafan")
    motion = perform(4.0, 3)[0].clip
    (tmp_path / "bones").mkdir()
    write_bvh(
        tmp_path / "bones" / "a.bvh", export_motion(motion, find_roles(motion.skeleton), how, Export(rest="bones"))
    )
    bones = survey_capture(tmp_path / "bones")
    for survey, mirrors in ((plain, True), (bones, False)):
        assert survey.mirrors == mirrors
        assert yaml.safe_load(recipe_text(survey, BEHAVIOURS, tmp_path))["motion"]["mirror"] == mirrors


def test_each_of_several_people_in_a_file_is_surveyed(tmp_path):
    clip = perform(4.0, 3)[0].clip
    write_bvh(tmp_path / "pair.bvh", together([clip, clip], ["Red_", "Blue_"]))
    survey = survey_capture(tmp_path)
    assert [file.name for file in survey.used] == ["pair.bvh#1", "pair.bvh#2"]
    assert survey.used[0].strikes == survey.used[1].strikes
    recipe = yaml.safe_load(recipe_text(survey, BEHAVIOURS, tmp_path))
    assert recipe["motion"]["capture"]["clips"] == ["pair.bvh#1", "pair.bvh#2"]
