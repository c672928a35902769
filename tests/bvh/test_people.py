"""Each tree of a BVH file can be read by itself, under a name of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from people import placed, together

from crowdsim.bvh.io import read_bvh, write_bvh
from crowdsim.bvh.people import read_people, split_person
from crowdsim.capture.loading import load_capture, load_people
from crowdsim.errors import BvhError
from crowdsim.motion import quaternion
from crowdsim.performer.session import perform


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    clip = perform(4.0, 3)[0].clip
    path = tmp_path_factory.mktemp("pair") / "pair.bvh"
    write_bvh(path, together([clip, placed(clip, 0.0, 1.2, np.pi)], ["Red_", "Blue_"]))
    return clip, path


def test_each_person_has_its_own_joints_columns_and_name(pair):
    _, path = pair
    people = read_people(path)
    assert [one.path for one in people] == [f"{path}#1", f"{path}#2"]
    assert [one.names[0] for one in people] == ["Red_Hips", "Blue_Hips"]
    whole = read_bvh(path)
    np.testing.assert_array_equal(np.concatenate([one.motion for one in people], axis=1), whole.motion)
    assert people[1].parents.tolist() == people[0].parents.tolist()
    assert people[1].end_parents.tolist() == people[0].end_parents.tolist()
    assert read_people(f"{path}#2")[0].names == people[1].names


def test_people_are_clips_with_numbers_and_the_second_stands_where_it_was(pair):
    clip, path = pair
    first, second = load_people(path)
    assert [first.clip.name, second.clip.name] == ["pair#1", "pair#2"]
    assert first.roles == second.roles
    np.testing.assert_allclose(second.clip.root_positions[:, 2], 1.2 - clip.root_positions[:, 2], atol=1e-5)
    assert load_capture(f"{path}#2").clip.name == "pair#2"
    assert load_capture(path).clip.name == "pair#1"


def test_a_file_of_one_person_is_itself(tmp_path, pair):
    path = tmp_path / "one.bvh"
    write_bvh(path, together([pair[0]], [""]))
    assert [one.path for one in read_people(path)] == [str(path)]
    assert load_capture(path).clip.name == "one"


def test_trees_that_are_no_people_are_left_out_where_others_are(tmp_path, pair):
    clip, _ = pair
    whole = together([clip, clip], ["", "Prop_"])
    path = tmp_path / "prop.bvh"
    write_bvh(path, whole)
    text = path.read_text()
    start = text.index("ROOT Prop_Hips")
    prop = "ROOT Sword\n{\n OFFSET 0 0 0\n CHANNELS 3 Xposition Yposition Zposition\n"
    prop += " End Site\n {\n  OFFSET 0 90 0\n }\n}\n"
    columns = clip.skeleton.joint_count * 3 + 3
    head, motion = text[:start] + prop, text[text.index("MOTION") :].splitlines()
    rows = [" ".join(row.split()[: columns + 3]) for row in motion[3:]]
    path.write_text(head + "\n".join([*motion[:3], *rows]) + "\n")
    assert [one.clip.name for one in load_people(path)] == ["prop#1"]
    assert load_people(f"{path}#2")[0].faults[0].startswith("no human body found")


def test_bodies_that_hang_on_one_root_are_taken_off_it(tmp_path, pair):
    clip, path = pair
    whole = read_bvh(path)
    turn = 30.0
    channels = (("Xposition", "Yposition", "Zposition", "Zrotation", "Xrotation", "Yrotation"), *whole.channels)
    scene = replace(
        whole,
        names=("Scene", *whole.names),
        parents=np.array([-1, *np.where(whole.parents < 0, 0, whole.parents + 1)], np.int32),
        offsets=np.concatenate([np.zeros((1, 3)), whole.offsets]),
        channels=channels,
        end_parents=whole.end_parents + 1,
        motion=np.concatenate([np.tile([50.0, 0, 0, 0, 0, turn], (whole.frame_count, 1)), whole.motion], axis=1),
    )
    other = tmp_path / "scene.bvh"
    write_bvh(other, scene)
    first, second = load_people(other)
    assert [first.clip.name, second.clip.name] == ["scene#1", "scene#2"]
    assert "2 bodies hang on ROOT 'Scene'" in first.findings[-1]
    assert first.roles == load_capture(path).roles
    assert first.body.height == pytest.approx(load_capture(path).body.height, abs=1e-3)
    turned = quaternion.rotate(quaternion.about_y(np.deg2rad(turn)), clip.root_positions) + np.array([0.5, 0.0, 0.0])
    np.testing.assert_allclose(first.clip.root_positions, turned, atol=1e-4)
    assert load_capture(f"{other}#2").body.height == pytest.approx(second.body.height)
    # Rigs hold copies of a body in the same place: these are not further people.
    half = scene.channels[1 : 1 + clip.skeleton.joint_count]
    columns = 6 + sum(map(len, half))
    motion = scene.motion.copy()
    motion[:, columns:] = motion[:, 6:columns]
    write_bvh(other, replace(scene, motion=motion))
    assert [one.clip.name for one in load_people(other)] == ["scene"]


def test_names_with_numbers_mean_people_unless_a_file_has_that_name(tmp_path, pair):
    _, path = pair
    assert split_person(f"{path}#12") == (path, 12)
    assert split_person(path) == (path, None)
    assert split_person("a#0")[1] is None
    odd = tmp_path / "take #2"
    odd.write_text("HIERARCHY")
    assert split_person(odd) == (odd, None)
    with pytest.raises(BvhError, match=r"pair.bvh: no person 3; the file has 2"):
        read_people(f"{path}#3")
