"""Every finding and every error of BVH text has a line and a column, also what concerns the file as a whole."""

import re

import pytest
from bvh_text import PLAIN, bvh

from crowdsim.bvh.io import parse_bvh
from crowdsim.bvh.reader import place_of_number
from crowdsim.capture.loading import load_capture, usable_clips
from crowdsim.errors import BvhError, MotionError

ENDS = ("\n", "\r", "\r\n", " \r\n \r\n")


def test_an_end_site_without_an_offset_is_found_where_it_begins():
    walk = bvh(PLAIN, **{"      OFFSET 1 5 0\n": ""})
    assert walk.findings == ("walk.bvh:14:5: an end site of joint 'Chest' has no OFFSET, 0 taken (1 such end sites)",)
    assert walk.faults == ()


def test_what_is_found_about_the_tree_is_found_at_its_joint():
    walk = bvh(PLAIN, **{"    OFFSET 4 -1 0\n": "", "JOINT Leg": "JOINT Hips"})
    assert walk.findings == (
        "walk.bvh:19:3: 2 joints are called 'Hips'",
        "walk.bvh:19:3: joint 'Hips' has no OFFSET, 0 taken (1 such joints)",
    )


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_columns_count_characters_whatever_ends_lines(end: str, encoding: str) -> None:
    blank = 2 if end.count("\n") == 2 else 1
    text = PLAIN.replace(" 50 60 7 ", " 50 nan 7 ").replace("\n", end)
    (found,) = parse_bvh(text.encode(encoding), "walk.bvh").findings
    assert found == f"walk.bvh:{31 * blank + 1}:23: frame 0, joint 'Chest', channel Zrotation is nan"
    text = PLAIN.replace("JOINT Leg\n  {\n", "JOINT \u00e4\u4e2d { 7\n").replace("\n", end)
    with pytest.raises(BvhError, match=re.escape(f"walk.bvh:{18 * blank + 1}:14: found '7', expected OFFSET, ")):
        parse_bvh(text.encode(encoding), "walk.bvh")


@pytest.mark.parametrize("end", ENDS)
def test_the_place_of_a_number_is_that_of_its_token(end: str) -> None:
    data = f"ab 7{end}  1 2{end}3{end}{end}\t4 5 6{end}7".encode()
    start = data.index(b"7") + 1
    tokens = [match.start() for match in re.finditer(rb"\S+", data) if match.start() >= start]
    assert [place_of_number(data, start, number) for number in range(7)] == tokens


def test_what_is_wrong_with_a_file_as_a_whole_is_reported_on_its_first_line(tmp_path):
    path = tmp_path / "walk.bvh"
    path.write_text(PLAIN)
    with pytest.raises(MotionError) as caught:
        usable_clips(load_capture(path))
    assert str(caught.value).splitlines()[:2] == [
        f"{path}:1:1: no human body found in 3 joints: Hips, Chest, Leg",
        f"{path}:1:1: unknown scale: without a human body there is nothing to measure it by",
    ]
