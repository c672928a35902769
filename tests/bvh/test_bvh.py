"""Reading BVH text, odd and broken."""

import math
import re

import numpy as np
import pytest
from bvh_text import PLAIN, bvh, same
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from naive_bvh import read, rotation_order

from crowdsim.bvh.io import parse_bvh, read_bvh, to_clip
from crowdsim.bvh.kernels import parse_numbers
from crowdsim.errors import BvhError


def fails(text, message):
    with pytest.raises(BvhError) as caught:
        parse_bvh(text.encode() if isinstance(text, str) else text, "walk.bvh")
    assert str(caught.value) == message


def read_or_message(data):
    try:
        return parse_bvh(data, "walk.bvh"), ""
    except BvhError as error:
        return None, str(error)


def test_a_plain_file_is_read_unchanged():
    walk = bvh(PLAIN)
    names, parents, offsets, channels, motion = read(PLAIN)
    assert walk.names == tuple(names) == ("Hips", "Chest", "Leg")
    assert walk.parents.tolist() == parents == [-1, 0, 0]
    assert walk.parents.dtype == np.int32
    np.testing.assert_array_equal(walk.offsets, offsets)
    assert [list(own) for own in walk.channels] == channels
    assert walk.end_parents.tolist() == [1, 1, 2]
    np.testing.assert_array_equal(walk.end_offsets, [[0, 5, 0], [1, 5, 0], [0, -9, 0.5]])
    np.testing.assert_array_equal(walk.motion, motion)
    assert (walk.declared_frames, walk.frame_count, walk.frame_time, walk.fps) == (2, 2, 0.00833333, 120.0)
    assert (walk.joint_count, walk.channel_count) == (3, 15)
    assert rotation_order(walk.channels[0]) == "ZXY"
    assert walk.findings == ()


@pytest.mark.parametrize(
    "other",
    [
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace("\n", "\r"),
        PLAIN.replace(" ", "\t"),
        PLAIN.replace("\n", "\n\n \t\n"),
        PLAIN.replace("\n", "  \x0b\x0c\n"),
        "\n\n " + PLAIN.rstrip(),
        PLAIN.replace("Hips\n{", "Hips {").replace("Leg\n  {", "Leg{").replace("Site\n", "Site "),
        " ".join(PLAIN.split()),
        PLAIN.replace("60 7 8", "60\n7 8").replace("-1\n1.5", "-1 1.5"),
        PLAIN.upper().replace("HIPS", "Hips").replace("CHEST", "Chest").replace("LEG", "Leg").replace("SITE", "Site"),
        PLAIN.lower().replace("hips", "Hips").replace("chest", "Chest").replace("leg", "Leg").replace("site", "Site"),
        PLAIN.replace("ROOT Hips", "ROOT\nHips").replace("End Site", "End\n\tSite"),
        PLAIN.replace("Frames: 2", "Frames:2").replace("Frame Time: ", "Frame  Time :"),
        PLAIN.replace("Frames: 2", "Frames 2").replace("Frame Time: ", "FrameTime:\n"),
        PLAIN.replace("Frames: 2\nFrame Time: 0.00833333", "Frame Time: 0.00833333\nFrames: 2"),
        PLAIN.replace("    OFFSET 0 10 0\n    CHANNELS 3 Yrotation Xrotation Zrotation\n", "").replace(
            "1 5 0\n    }\n", "1 5 0\n    }\n  CHANNELS 3 Yrotation Xrotation Zrotation OFFSET 0 10 0\n"
        ),
    ],
)
def test_white_space_line_ends_and_the_case_of_keywords_do_not_matter(other):
    same(parse_bvh(other.encode()), bvh(PLAIN))


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-8", "latin-1"])
def test_text_is_read_in_the_encodings_that_exporters_use(encoding):
    walk = parse_bvh(PLAIN.replace("Hips", "Hüfte").encode(encoding))
    assert walk.names == ("Hüfte", "Chest", "Leg")
    same(parse_bvh(PLAIN.encode(encoding)), bvh(PLAIN))


@pytest.mark.parametrize(
    "name",
    [
        "mixamorig:Hips",
        "Character1 : Left  Leg",
        "End",
        "end",
        "Bip01 End Site",
        "JOINT",
        "MOTION",
        "Frames: 3",
        "OFFSET 0 0 0",
        "spine.001",
        "#1",
        '"quoted"',
        "тазы",
        "1e5",
        "-",
    ],
)
def test_a_name_is_the_rest_of_its_line(name):
    for old in ("ROOT Hips", "JOINT Chest", "JOINT Leg"):
        keyword = old.split()[0]
        for brace in ("\n{", " {", "\t \r\n  {"):
            text = PLAIN.replace("  {", "{").replace(f"{old}\n{{", f"{keyword}  {name}{brace}")
            walk = parse_bvh(text.encode())
            assert name in walk.names
            np.testing.assert_array_equal(walk.motion, bvh(PLAIN).motion)


def test_a_brace_inside_a_word_belongs_to_the_name_when_another_opens_the_block_below():
    assert bvh(PLAIN, **{"JOINT Leg": "JOINT leg{1}"}).names[2] == "leg{1}"
    assert bvh(PLAIN, **{"JOINT Leg\n  {\n": "JOINT Leg{"}).names[2] == "Leg"


def test_joints_without_a_name_get_one_and_a_finding():
    walk = bvh(PLAIN, **{"JOINT Leg": "JOINT"})
    assert walk.names == ("Hips", "Chest", "joint2")
    assert walk.findings == ("walk.bvh:20:3: joint without a name, called 'joint2'",)


def test_decimal_commas_are_decimal_points():
    walk = bvh(
        PLAIN, **{"OFFSET 0 -9 0.5": "OFFSET 0 -9 0,5", "1.5 91 -2e1 .5 -5.": "1,5 91 -2e1 ,5 -5,", "0.008": "0,008"}
    )
    same(walk, bvh(PLAIN))
    assert bvh(PLAIN, **{"1.5 91": "0,12345678901234567890 91"}).motion[1, 0] == 0.12345678901234567890


def test_end_sites_keep_their_labels_and_order():
    walk = bvh(
        PLAIN, **{"End Site\n    {\n      OFFSET 1": "End Nub x\n    {\n      OFFSET 1", "0.5": "0.5\nCHANNELS 0"}
    )
    assert walk.end_names == ("Site", "Nub x", "Site")


def test_joints_may_have_no_channels_one_or_two():
    text = PLAIN.replace("CHANNELS 3 Yrotation Xrotation Zrotation", "CHANNELS 2 Zrotation Xrotation")
    text = text.replace("    CHANNELS 6 Xrotation Yrotation Zrotation Zposition Xposition Yposition\n", "")
    text = text[: text.index("0.00833333")] + "0.01\n1 2 3 4 5 6 7 8"
    walk = bvh(text)
    assert [len(own) for own in walk.channels] == [6, 2, 0]
    assert walk.motion.tolist() == [[1, 2, 3, 4, 5, 6, 7, 8]]
    assert bvh(text, **{"CHANNELS 2 Zrotation Xrotation": "CHANNELS 0", " 7 8": ""}).channels[1] == ()
    assert walk.findings == ("walk.bvh:29:9: 1 rows of motion, Frames: says 2",)


def test_joints_with_the_same_name_are_kept_and_found():
    walk = bvh(PLAIN, Leg="Chest")
    assert walk.names == ("Hips", "Chest", "Chest")
    assert walk.findings == ("walk.bvh:19:3: 2 joints are called 'Chest'",)


@pytest.mark.parametrize("name", ["row of teeth", "nothing moves", "is nan"])
def test_what_joints_are_called_never_makes_a_finding_a_fault(name):
    walk = bvh(PLAIN.replace("JOINT Leg", f"JOINT {name}").replace("JOINT Chest", f"JOINT {name}"))
    assert walk.findings == (f"walk.bvh:19:3: 2 joints are called '{name}'",)
    assert walk.faults == ()
    assert bvh(PLAIN.replace("Frames: 2", "Frames: 4")).faults == ("walk.bvh:30:9: 2 rows of motion, Frames: says 4",)


def test_scale_channels_are_read_found_and_not_used():
    text = PLAIN.replace("CHANNELS 3 Yrotation", "CHANNELS 4 Xscale Yrotation").replace(" 40 ", " 1 40 ")
    walk = bvh(text.replace("4e-3", "1 4e-3"))
    assert walk.findings == ("walk.bvh:6:3: joint 'Chest' has scale channels, which are not used",)
    np.testing.assert_array_equal(to_clip(walk).rotations, to_clip(bvh(PLAIN)).rotations)


def test_all_roots_are_read_and_a_clip_takes_the_first():
    second = PLAIN[PLAIN.index("ROOT") : PLAIN.index("MOTION")]
    for name in ("Hips", "Chest", "Leg"):
        second = second.replace(name, f"Other{name}")
    rows = PLAIN.splitlines()[-2:]
    text = PLAIN[: PLAIN.index("MOTION")] + second + "MOTION\nFrames: 2\nFrame Time: 0.00833333\n"
    walk = bvh(text + "\n".join(f"{row} {row}" for row in rows))
    assert walk.names[::3] == ("Hips", "OtherHips")
    assert walk.parents.tolist() == [-1, 0, 0, -1, 3, 3]
    assert walk.findings == ("walk.bvh:29:1: 2 ROOTs ('Hips', 'OtherHips'): several people, #1 to #2",)
    first, alone = to_clip(walk), to_clip(bvh(PLAIN))
    assert first.skeleton.names == alone.skeleton.names
    np.testing.assert_array_equal(first.skeleton.end_offsets, alone.skeleton.end_offsets)
    np.testing.assert_array_equal(first.rotations, alone.rotations)


@pytest.mark.parametrize(
    ("declared", "rows", "finding"),
    [
        (5, 2, "walk.bvh:30:9: 2 rows of motion, Frames: says 5"),
        (1, 2, "walk.bvh:30:9: 2 rows of motion, Frames: says 1"),
        (0, 2, "walk.bvh:30:9: 2 rows of motion, Frames: says 0"),
        (10**15, 2, "walk.bvh:30:9: 2 rows of motion, Frames: says 1000000000000000"),
        (3, 0, "walk.bvh:30:9: 0 rows of motion, Frames: says 3"),
    ],
)
def test_a_wrong_row_count_is_found_with_both_numbers(declared, rows, finding):
    text = PLAIN.replace("Frames: 2", f"Frames: {declared}")
    walk = bvh("\n".join(text.splitlines()[: 31 + rows]))
    assert walk.frame_count == rows
    assert walk.findings == (finding,)
    assert walk.faults == (() if abs(declared - rows) == 1 else (finding,))


def test_no_frames_are_no_error():
    walk = bvh("\n".join(PLAIN.replace("Frames: 2", "Frames: 0").splitlines()[:31]))
    assert walk.motion.shape == (0, 15)
    assert walk.findings == ()
    assert to_clip(walk).frame_count == 0


@pytest.mark.parametrize(
    ("stop", "finding"),
    [
        ("MOTION", "walk.bvh:29:1: the file ends after the hierarchy, without MOTION"),
        ("Frames", "walk.bvh:30:1: the file ends before Frames:"),
        ("Frame Time", "walk.bvh:31:1: the file ends before Frame Time:"),
    ],
)
def test_a_file_that_ends_after_the_hierarchy_has_no_frames(stop, finding):
    walk = bvh(PLAIN[: PLAIN.index(stop)])
    assert walk.motion.shape == (0, 15)
    assert walk.findings[0] == finding
    assert walk.fps == 30.0


def test_a_row_of_another_length_is_left_out_and_found():
    rows = [" ".join([str(row)] * 15) for row in range(6)]
    rows[2] += " 7"
    walk = bvh(PLAIN[: PLAIN.index("0 90")].replace("Frames: 2", "Frames: 6") + "\n".join(rows))
    assert walk.motion[:, 0].tolist() == [0, 1, 3, 4, 5]
    assert walk.findings == (
        "walk.bvh:34:1: row of 16 numbers, expected 15, one a channel; left out",
        "walk.bvh:30:9: 5 rows of motion, Frames: says 6",
    )
    rows[2], rows[5] = "1 2", "9"
    walk = bvh(PLAIN[: PLAIN.index("0 90")].replace("Frames: 2", "Frames: 6") + "\r".join(rows))
    assert walk.motion[:, 0].tolist() == [0, 1, 3, 4]
    assert (
        walk.findings[0]
        == "walk.bvh:34:1: row of 2 numbers, expected 15, one a channel; left out, and 1 more such rows"
    )


def test_numbers_that_are_parted_by_their_signs_alone_are_parted():
    file = bvh(PLAIN, **{"\n0 90 1 10 20": "\n0 90 1-10-20", "91 -2e1 .5": "91-2e-1 .5"})
    np.testing.assert_array_equal(file.motion[:, 1:5], [[90, 1, -10, -20], [91, -0.2, 0.5, -5]])
    assert file.findings == ("walk.bvh:32:6: '1-10-20': numbers without a blank between, parted at their signs",)
    assert file.faults == ()


@pytest.mark.parametrize(("row", "count"), [(lambda row: f"7 {row}", 16), (lambda row: row.rpartition(" ")[0], 14)])
def test_rows_that_all_have_another_number_of_numbers_are_refused(row, count):
    head, rows = PLAIN.replace("Frames: 2", "Frames: 4").split("0.00833333\n")
    rows = "\n".join(map(row, rows.splitlines() * 2))
    with pytest.raises(BvhError, match=f"^walk.bvh:32:1: 4 rows of {count} numbers, expected 15, one a channel$"):
        parse_bvh(f"{head}0.00833333\n{rows}\n".encode(), "walk.bvh")


def test_an_incomplete_last_row_is_left_out_where_lines_mean_nothing():
    walk = bvh(PLAIN[: PLAIN.index("0 90")] + "\n".join(str(number) for number in range(32)))
    np.testing.assert_array_equal(walk.motion, np.arange(30.0).reshape(2, 15))
    assert walk.findings == ("walk.bvh:62:1: 32 numbers are 2 more than whole rows of 15; left out",)


def test_values_that_are_not_finite_are_found_with_frame_joint_and_channel():
    walk = bvh(PLAIN, **{" 50 60 7 ": " nan 60 -inf ", "1.5 91": "1.5 1.#INF", "-5.": "1e999"})
    assert walk.findings == (
        "walk.bvh:33:5: frame 1, joint 'Hips', channel Yposition is inf",
        "walk.bvh:33:20: frame 1, joint 'Hips', channel Xrotation is inf",
        "walk.bvh:32:20: frame 0, joint 'Chest', channel Xrotation is nan",
        "walk.bvh:32:27: frame 0, joint 'Leg', channel Xrotation is -inf",
    )
    many = bvh(PLAIN[: PLAIN.index("0 90")] + "nan " * 30)
    assert many.findings[0] == "walk.bvh:32:1: frame 0, joint 'Hips', channel Xposition is nan and in 1 more frames"
    assert many.findings[-1] == "walk.bvh:32:33: 7 more channels are wrong somewhere"
    assert len(many.findings) == 9


def test_text_behind_the_last_row_is_found_and_left_out():
    for tail in ("\x1a", "\0\0\0", "END OF FILE", "}"):
        walk = bvh(PLAIN + tail)
        same(walk, bvh(PLAIN))
        token = repr(tail.split()[0])
        size = len(tail)
        assert walk.findings == (
            f"walk.bvh:34:1: {size} bytes from {token} on, after the last row, are no numbers and left out",
        )


def test_offsets_that_are_not_finite_or_missing_become_zero_and_a_finding():
    walk = bvh(PLAIN, **{"OFFSET 0 10 0": "OFFSET 0 nan 0"})
    assert walk.offsets[1].tolist() == [0, 0, 0]
    assert walk.findings == walk.faults == ("walk.bvh:8:14: OFFSET is nan, 0 taken",)
    walk = bvh(PLAIN, **{"OFFSET 0 10 0": ""})
    assert walk.findings == ("walk.bvh:6:3: joint 'Chest' has no OFFSET, 0 taken (1 such joints)",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "", "2:1: found 'ROOT', expected 'HIERARCHY'"),
        ("HIERARCHY", "{\\rtf1", "1:1: found '{', expected 'HIERARCHY'"),
        ("ROOT Hips", "JOINT Hips", "2:1: found 'JOINT', expected 'ROOT' and a name"),
        ("ROOT Hips\n{", "ROOT Hips\n", "4:3: found 'OFFSET', expected '{'"),
        ("OFFSET 1 2 3", "OFFSET 1 2", "5:3: found 'CHANNELS', expected a number, the z of an OFFSET"),
        ("OFFSET 1 2 3", "OFFSET 1,5,6 2 3", "4:10: found '1,5,6', expected a number, the x of an OFFSET"),
        ("OFFSET 1 2 3", "OFFSET 1_0 2 3", "4:10: found '1_0', expected a number, the x of an OFFSET"),
        ("OFFSET 1 2 3", "OFFSETS", "4:3: found 'OFFSETS', expected OFFSET, CHANNELS, JOINT, End Site or '}'"),
        ("CHANNELS 6 X", "CHANNELS six X", "5:12: found 'six', expected the number of channels"),
        ("CHANNELS 6 X", "CHANNELS 99999999999 X", "5:12: found '99999999999', expected the number of channels"),
        ("CHANNELS 6 X", "CHANNELS 5 X", "5:64: found 'Yrotation', expected 5 channels, as CHANNELS says"),
        ("CHANNELS 6 X", "CHANNELS 7 X", "6:3: found 'JOINT', expected channel 7 of 7, such as Xposition or Zrotation"),
        (
            "CHANNELS 3 Yrotation",
            "CHANNELS 3 Yrotatoin",
            "9:16: found 'Yrotatoin', expected channel 1 of 3, such as Xposition or Zrotation"
            " (did you mean 'Yrotation'?)",
        ),
        ("OFFSET 0 10 0", "CHANNELS 0", "9:5: found 'CHANNELS', expected one CHANNELS a joint"),
        (
            "OFFSET 0 5 0",
            "CHANNELS 3",
            "12:16: found '3', expected 'OFFSET' or '}' of an end site, which has neither channels nor children",
        ),
        ("}\nMOTION", "MOTION", "28:1: found 'MOTION', expected OFFSET, CHANNELS, JOINT, End Site or '}'"),
        ("}\nMOTION", "}}\nMOTION", "28:2: found '}', expected 'ROOT' or 'MOTION'"),
        ("MOTION", "MOTIONS", "29:1: found 'MOTIONS', expected 'ROOT' or 'MOTION'"),
        ("Frames: 2", "Frames: two", "30:9: found 'two', expected a number of frames"),
        ("Frames: 2", "Frames: 2.5", "30:9: found '2.5', expected a number of frames"),
        ("Frames: 2", "Frames: -2", "30:9: found '-2', expected a number of frames"),
        ("Frames: 2", "", "32:1: found '0', expected 'Frames:' and a number"),
        ("Frame Time: 0.00833333", "", "32:1: found '0', expected 'Frame Time:' and a number"),
        ("0.00833333", "fast", "31:13: found 'fast', expected a number of seconds"),
        ("50 60 7", "50 sixty 7", "32:23: found 'sixty', expected a number"),
        ("50 60 7", "50 6-0 7", "32:23: found '6-0', expected a number"),
        ("50 60 7", "50 0,5, 7", "32:23: found '0,5,', expected a number"),
        ("50 60 7", "50 " + "x" * 100 + " 7", f"32:23: found '{'x' * 37}...', expected a number"),
    ],
)
def test_what_is_no_bvh_is_refused_with_line_token_and_expectation(old, new, message):
    assert old in PLAIN
    fails(PLAIN.replace(old, new, 1), f"walk.bvh:{message}")


def test_text_that_ends_inside_the_hierarchy_is_refused():
    fails("", "walk.bvh:1:1: the file ends, expected 'HIERARCHY'")
    fails("HIERARCHY\nROOT Hips", "walk.bvh:2:10: the file ends, expected '{'")
    expected = "OFFSET, CHANNELS, JOINT, End Site or '}'"
    fails(PLAIN[: PLAIN.index("  JOINT Leg")], f"walk.bvh:19:1: the file ends, expected {expected}")
    fails(b"\xff\xfeH", "walk.bvh:1:1: broken UTF-16 text, expected a BVH file")


def test_numbers_without_channels_are_refused():
    text = "HIERARCHY ROOT a { OFFSET 0 0 0 }\nMOTION Frames: 1 Frame Time: 0.1\n"
    assert parse_bvh(text.encode(), "a.bvh").findings == (
        "a.bvh:1:11: no joint has channels, so nothing moves",
        "a.bvh:2:16: 0 rows of motion, Frames: says 1",
    )
    fails(text + "1 2", "walk.bvh:3:1: found '1', expected no numbers, since no joint has channels")


def test_files_that_cannot_be_opened_are_bvh_errors(tmp_path):
    with pytest.raises(BvhError, match="is a folder, expected a BVH file"):
        read_bvh(tmp_path)
    with pytest.raises(BvhError, match=r"nowhere\.bvh: cannot be read: No such file"):
        read_bvh(tmp_path / "nowhere.bvh")
    with pytest.raises(BvhError, match="is no regular file"):
        read_bvh("/dev/null")
    (tmp_path / "a.bvh").write_text(PLAIN)
    walk = read_bvh(tmp_path / "a.bvh")
    same(walk, bvh(PLAIN))
    assert walk.path == str(tmp_path / "a.bvh")
    assert to_clip(walk).name == "a"


def test_huge_counts_and_deep_trees_neither_hang_nor_exhaust_memory():
    fails(
        PLAIN.replace("CHANNELS 6 X", "CHANNELS 999 X"),
        "walk.bvh:5:12: found '999', expected at most 12 channels a joint",
    )
    assert bvh(PLAIN.replace("Frames: 2", "Frames: 999999999999")).frame_count == 2
    block = "JOINT a {OFFSET 0 1 0 CHANNELS 0\n"
    for depth in (999, 100_000):
        deep = "HIERARCHY " + block.replace("JOINT", "ROOT") + block * depth + "}" * (depth + 1)
        if depth == 999:
            assert parse_bvh((deep + " MOTION Frames: 0 Frame Time: 1").encode()).joint_count == 1000
            fails(deep[:-1], "walk.bvh:1001:1000: the file ends, expected OFFSET, CHANNELS, JOINT, End Site or '}'")
        else:
            fails(deep, "walk.bvh:1001:1: found 'JOINT', expected at most 1,000 joints")
    ends = "HIERARCHY ROOT a {" + "End Site {}\n" * 2000
    fails(ends, "walk.bvh:1001:1: found 'End', expected at most 1,000 end sites")
    wide = "HIERARCHY ROOT a { CHANNELS 1 Xrotation" + " JOINT b{}" * 999 + "} MOTION Frames: 9 Frame Time: 1\n"
    with pytest.raises(BvhError, match="more than fit in memory"):
        to_clip(parse_bvh((wide + "0 " * 70_000).encode()))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "OFFSET 0 10 0",
            "OFFSET 0 1e308 0",
            "8:14: found '1e308', expected a number from -1000000 to 1000000, the y of an",
        ),
        ("OFFSET 0 10 0", "OFFSET 0 1 0 OFFSET 0 1 0", "8:18: found 'OFFSET', expected one OFFSET a joint"),
        ("OFFSET 0 5 0", "CHANNELS 0 CHANNELS 0", "12:18: found 'CHANNELS', expected 'OFFSET' or '}' of an end site"),
        ("JOINT Leg", "JOINT " + "L" * 300, f"19:9: found '{'L' * 37}...', expected a name of at most 256 bytes"),
        ("MOTION", "MOTION" + " " * 2_000_000, "29:1: a line of more than 1,048,576 bytes, expected shorter ones"),
    ],
)
def test_what_no_exporter_writes_is_refused_where_it_is(old, new, message):
    with pytest.raises(BvhError, match="walk.bvh:" + re.escape(message)):
        bvh(PLAIN, **{old: new})


def test_numbers_out_of_reach_are_faults_with_their_line():
    walk = bvh(PLAIN, **{" 50 60 7 ": " 50 -1e308 7 "})
    limits = "expected numbers from -1000000 to 1000000"
    assert walk.faults == (f"walk.bvh:32:23: frame 0, joint 'Chest', channel Zrotation is -1e+308, {limits}",)
    row = "1 " * 15
    text = PLAIN[: PLAIN.index("0 90")].replace("Frames: 2", "Frames: 5") + f"{row}\n\n2 3\n{row}\n{row}\n\n{row}inf"
    assert bvh(text.replace(f"{row}inf", row + "\n" + "nan " * 15)).faults[1].startswith("walk.bvh:39:1: frame 4, ")


def test_a_frame_time_that_is_no_positive_time_is_found():
    walk = bvh(PLAIN, **{"0.00833333": "0"})
    assert walk.fps == 30.0
    assert walk.findings == walk.faults == ("walk.bvh:31:13: frame time is '0', 30 frames a second taken",)
    assert bvh(PLAIN, **{"0.00833333": "-0.01"}).faults == (
        "walk.bvh:31:13: frame time is '-0.01', 30 frames a second taken",
    )
    assert bvh(PLAIN, **{"0.00833333": "nan"}).findings[0].endswith("is 'nan', 30 frames a second taken")
    assert bvh(PLAIN, **{"0.00833333": "120"}).findings == (
        "walk.bvh:31:13: frame time '120' means 0.00833333 frames a second",
    )


numbers = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.floats(-1000, 1000).map(lambda x: f"{x:.6f}"),
    st.floats(-1e9, 1e9).map(lambda x: f"{x:.20f}"),
    st.floats(-1e3, 1e3).map(lambda x: f"{x:+.17e}"),
    st.decimals(allow_nan=False, allow_infinity=False).map(str),
    st.integers(-(2**70), 2**70).map(str),
    st.from_regex(r"\A[+-]?([0-9]{1,25}\.?[0-9]{0,25}|\.[0-9]{1,25})([eE][+-]?[0-9]{1,3})?\Z"),
)


@settings(max_examples=200, deadline=None)
@given(st.lists(numbers, min_size=1, max_size=40), st.sampled_from([" ", "\n", "\t", "\r\n"]))
@example(["9007199254740993", "9007199254740992.5", "0.1", "-0.0", "1e23", "8.5e22", "2.2250738585072011e-308"], " ")
@example(
    ["0" * 30 + "1" * 30, "0." + "0" * 40 + "123456789012345678901", "1" * 18 + ".5", "123456789012345678e-18"], " "
)
def test_numbers_are_read_to_the_last_bit(tokens, blank):
    head = "HIERARCHY ROOT a {OFFSET 0 0 0 CHANNELS 1 Xrotation} MOTION Frames: 1 Frame Time: 1\n"
    walk = parse_bvh((head + blank.join(tokens)).encode())
    expected = np.array([float(token) for token in tokens])
    np.testing.assert_array_equal(walk.motion[:, 0], expected)
    np.testing.assert_array_equal(np.signbit(walk.motion[:, 0]), np.signbit(expected))


def test_the_number_kernel_goes_on_where_it_stopped():
    tokens = [f"{x:.5f}" if x % 7 else "nan" for x in range(1, 300)]
    data = np.frombuffer("\n".join(tokens).encode(), np.uint8)
    out, hard, state = np.full(299, np.inf), np.zeros((10, 3), np.int64), np.zeros(5, np.int64)
    for room in (17, 150, 299, 299, 299, 299, 299):
        parse_numbers(data, len(data), 1, out[:room], hard, state)
        for number, start, stop in hard[: state[2]]:
            assert bytes(data[start:stop]) == b"nan"
            out[number] = math.nan
    np.testing.assert_array_equal(out, [float(token) for token in tokens])
    assert state[4] == 0


SEEDS = [PLAIN, " ".join(PLAIN.split()), PLAIN.replace("\n", "\r\n")]
SCRAPS = [
    *PLAIN.split(),
    "{",
    "}",
    "\n",
    "\r",
    " ",
    "\0",
    "nan",
    "1e400",
    "-",
    "Frames:",
    "\xff",
    "99999999999999999999",
]


@settings(max_examples=400, deadline=60_000, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.sampled_from(SEEDS),
    st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 30), st.one_of(st.sampled_from(SCRAPS), st.text(max_size=5))),
        max_size=6,
    ),
    st.sampled_from(["utf-8", "latin-1", "utf-16"]),
)
def test_mutated_text_is_read_or_refused_and_never_crashes(text, edits, encoding):
    for place, cut, scrap in edits:
        at = int(place * len(text))
        text = text[:at] + scrap + text[at + cut :]
    walk, message = read_or_message(text.encode(encoding, "replace"))
    if walk is None:
        assert re.match(r"walk\.bvh:\d+:\d+: (found|the file ends|broken)", message)
    else:
        clip = to_clip(walk)
        assert walk.motion.shape == (walk.frame_count, walk.channel_count)
        assert clip.rotations.shape == (walk.frame_count, clip.skeleton.joint_count, 4)
        assert (walk.parents < np.arange(walk.joint_count)).all()
        assert walk.fps > 0


@settings(max_examples=200, deadline=60_000)
@given(st.binary(max_size=300), st.booleans())
def test_random_bytes_are_read_or_refused(data, with_start):
    walk, message = read_or_message(b"HIERARCHY\nROOT a\n{" * with_start + data)
    assert (walk is None) == ("expected" in message)
