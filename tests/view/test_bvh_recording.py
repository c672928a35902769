"""BVH files are played as they are, with what was found in them."""

from pathlib import Path

import numpy as np
import pytest
from naive_view import embedded, read_joints, unpack_scene
from scenes import crowdsim, write_scene
from scenes import scene as plain

import crowdsim as library
from crowdsim.bvh.io import write_bvh
from crowdsim.errors import BvhError, TakeError
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.performer.session import perform
from crowdsim.render.bvh_figure import bvh_source
from crowdsim.view.bvh_motion import is_bvh, parse_people, record_bvh


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    found = tmp_path_factory.mktemp("capture")
    clip = perform(16.0, 2)[0].clip
    for number, frames in enumerate(((0, 360), (200, 680))):
        write_bvh(found / f"clip_{number}.bvh", clip.sliced(*frames))
    return found


def read(recording):
    scene = unpack_scene(recording.scene())
    return scene, read_joints(scene, [recording.block(number) for number in range(recording.block_count)])


def test_joints_of_a_file_are_within_a_millimetre_or_so(folder) -> None:
    recording, _ = record_bvh(folder / "clip_0.bvh")
    scene, (joints,) = read(recording)
    source, _ = bvh_source(folder / "clip_0.bvh")
    assert scene["fps"] == source.fps
    assert np.linalg.norm(joints[:, 0] - source.positions, axis=-1).max() < 1.2e-3


def test_people_of_a_folder_stand_side_by_side_for_as_long_as_each_lasts(folder) -> None:
    recording, _ = record_bvh(folder)
    scene, joints = read(recording)
    assert scene["names"] == ["clip_0", "clip_1"]
    stays = scene["tables"]["present"].reshape(-1, 3)
    assert stays[0, 2] < stays[1, 2] == scene["frames"]
    assert joints[0][..., 0].max() < joints[1][..., 0].min()
    only = record_bvh(folder, avatars=[1])[0]
    assert unpack_scene(only.scene())["names"] == ["clip_1"]


def test_cameras_frame_whoever_is_there(folder, tmp_path) -> None:
    recording, _ = record_bvh(folder)
    track = recording.cameras["side"].track
    assert np.isfinite(track).all()
    (_, joints) = read(recording)[1]

    # The picture goes with the second one, who walks on when the first one has gone.
    gone, walked = track[-1, 0] - track[0, 0], joints[-1, 0, :, 0].mean() - joints[0, 0, :, 0].mean()
    assert gone > 0.3 * walked > 0.5
    (tmp_path / "clip_0.bvh").write_bytes((folder / "clip_0.bvh").read_bytes())
    for text, message in (
        (f"file,first_frame\nclip_0.bvh,{'9' * 5000}\n", None),
        ("file\n" + "x" * 200_000, "no list"),
    ):
        (tmp_path / "avatars.csv").write_text(text)
        if message is None:
            assert record_bvh(tmp_path)[0].motion.delays == [0]
        else:
            with pytest.raises(BvhError, match=message):
                record_bvh(tmp_path)


def test_contacts_and_strikes_are_those_of_the_analysis(folder) -> None:
    recording, _ = record_bvh(folder / "clip_1.bvh")
    scene, (joints,) = read(recording)
    tables, figure = scene["tables"], scene["figures"][0]
    capture = recording.motion.captures[0]
    assert len(tables["strike_time"]) == len(capture.analysis.strikes.frames) > 0
    assert len(tables["contact"]) > 2
    hands = [figure["joints"].index(name) for name in ("LeftHand", "RightHand")]
    for time, limb, point in zip(
        tables["strike_time"], tables["strike_limb"], tables["strike_point"].reshape(-1, 3), strict=True
    ):
        # The middle of the fist is a hand's breadth beyond its joint.
        hand = joints[round(float(time) * scene["fps"]), 0, hands[limb % 2]]
        assert np.linalg.norm(point - hand) < 0.13
    feet = np.array(figure["feet"])
    for (_, foot), (start, stop) in zip(
        tables["contact"].reshape(-1, 2), tables["contact_time"].reshape(-1, 2), strict=True
    ):
        middle = joints[min(round(float(start + stop) / 2 * scene["fps"]), len(joints) - 1), 0, feet[foot]]
        assert middle[1] < 0.2


def test_exported_avatars_are_where_and_when_they_are_in_their_run(workplace, finish) -> None:
    late = {"name": "late", "team": "blue", "type": "boxer", "count": 1, "waits": True,
            "placement": {"kind": "points", "points": [[3, 0]]}}  # fmt: skip
    enters = {"kind": "add", "group": "late", "when": {"kind": "seconds", "seconds": 1}}
    write_scene(workplace / "four.yaml", groups=[*plain()["groups"], late], events=[enters])
    finish(workplace)
    assert crowdsim("export", "run", "--bvh", "--fps", "30", "-q") == 0
    recording, _ = record_bvh(workplace / "run" / "bvh")
    run, (expected,) = read(library.open_run(workplace / "run").recording(fps=30.0))
    scene, joints = read(recording)
    place = scene["names"].index("late_0")
    first = scene["tables"]["present"].reshape(-1, 3)[place, 1]
    assert first == run["tables"]["present"].reshape(-1, 3)[4, 1] == 30
    for i, name in enumerate(scene["names"]):
        avatar = run["names"].index(name)
        rows = slice(int(scene["tables"]["present"].reshape(-1, 3)[i, 1]), None)
        # Each file is put on the floor by itself.
        gaps = joints[i][rows, 0][..., [0, 2]] - expected[rows, avatar][..., [0, 2]]
        assert np.abs(gaps).max() < 5e-3


def test_joints_that_move_against_their_parents_move_in_the_player(tmp_path, folder) -> None:
    text = (folder / "clip_0.bvh").read_text(encoding="utf-8")
    head, _, motion = text.partition("MOTION\n")
    lines = motion.splitlines()
    # The spine of this file slides up and down by 4 cm.
    spine = head.index("JOINT Spine\n")
    channels = head.index("CHANNELS 3 ", spine)
    moved = head[:channels] + "CHANNELS 6 Xposition Yposition Zposition " + head[channels + len("CHANNELS 3 ") :]
    offset = [float(word) for word in head[head.index("OFFSET", spine) :].split()[1:4]]
    rows = []
    for frame, line in enumerate(lines[2:]):
        words = line.split()
        slide = [offset[0], offset[1] + 4.0 * np.sin(0.1 * frame), offset[2]]
        rows.append(" ".join([*words[:6], *(f"{value:.5f}" for value in slide), *words[6:]]))
    (tmp_path / "slides.bvh").write_text(moved + "MOTION\n" + "\n".join([*lines[:2], *rows]) + "\n", encoding="utf-8")
    recording, _ = record_bvh(tmp_path / "slides.bvh")
    scene, (joints,) = read(recording)
    assert len(scene["figures"][0]["moving"]) == len(scene["figures"][0]["joints"])
    expected, _ = clip_kinematics(recording.motion.clips[0])
    assert np.linalg.norm(joints[:, 0] - expected, axis=-1).max() < 1.2e-3


def test_frames_and_people_that_are_not_there_are_refused(folder) -> None:
    with pytest.raises(BvhError, match="there is no person 7, expected 0 to 1"):
        record_bvh(folder, avatars=[7])
    with pytest.raises(TakeError, match="frames"):
        record_bvh(folder, frames="100000:100001")
    for text in ("x", "3-1", "", "1,,2"):
        with pytest.raises(BvhError, match="expected numbers and ranges of them"):
            parse_people(text)
    assert parse_people("3,0-1") == [0, 1, 3]


def test_what_is_a_bvh_file_or_a_folder_of_them(folder, tmp_path) -> None:
    assert is_bvh(folder)
    assert is_bvh(folder / "clip_0.bvh")
    assert is_bvh(Path("missing.bvh#2"))
    assert not is_bvh(tmp_path)
    assert not is_bvh(tmp_path / "missing")


def test_the_command_writes_a_page_of_a_folder(folder, tmp_path, capsys) -> None:
    page = tmp_path / "page.html"
    assert crowdsim("view", folder, "--html", page, "--avatars", "0", "--frames", "1s:2s") == 0
    scene, _ = embedded(page.read_text(encoding="utf-8"))
    assert scene["names"] == ["clip_0"]
    assert scene["frames"] == scene["fps"]
    assert crowdsim("view", folder / "none.bvh", "--html", tmp_path / "other.html") == 2
    assert "none.bvh" in capsys.readouterr().err
