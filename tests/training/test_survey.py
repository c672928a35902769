"""What a folder of capture holds: files in any layout, those that are left out with their reasons, and skeletons."""

from pathlib import Path

import pytest

from crowdsim.errors import MotionError, PolicyError
from crowdsim.performer.session import write_performance
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
            "other.bvh": clip.replace(b"LeftHand", b"HandOfLeft"),
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
        "other.bvh": "another skeleton than a.bvh: joint 9 is 'HandOfLeft', expected 'LeftHand'",
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


def test_skeletons_of_which_none_is_that_of_most_files_are_refused_with_the_choices(tmp_path, clip):
    other = clip.replace(b"LeftHand", b"HandOfLeft")
    fill(tmp_path, {"a.bvh": clip, "b.bvh": clip, "c.bvh": other, "d.bvh": other})
    with pytest.raises(MotionError) as error:
        survey_capture(tmp_path)
    assert str(error.value).splitlines() == [
        f"{tmp_path}: its files have 2 skeletons, none of them that of most files; expected one",
        "  2 files, 8.0 s: a.bvh, b.bvh",
        "  2 files, 8.0 s: c.bvh, d.bvh",
        "  put the files of one skeleton into a folder of their own, and give that by --mocap DIR",
    ]
    fill(tmp_path, {"e.bvh": clip})
    assert [file.name for file in survey_capture(tmp_path).used] == ["a.bvh", "b.bvh", "e.bvh"]
