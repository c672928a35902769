"""The figures of a capture are plain data, and its pictures are drawn for whatever was read."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from animals import ANIMALS, export_animal
from conventions import CONVENTIONS
from exporters import UPS, Export, export_motion
from PIL import Image

from crowdsim.motion.bvh import write_bvh
from crowdsim.motion.capture import load_capture
from crowdsim.motion.contacts import runs
from crowdsim.motion.performer import perform
from crowdsim.motion.plots import plot_capture
from crowdsim.motion.report import describe_capture, study_capture
from crowdsim.motion.roles import find_roles

BY_NAME = {how.name: how for how in CONVENTIONS}
KEYS = "joints frames fps seconds unit_scale up_axis height_m roles contacts strikes findings".split()


@pytest.fixture(scope="module")
def boxer():
    clip = perform(8.0, 2)[0].clip
    return clip, find_roles(clip.skeleton)


def _capture(folder, bvh):
    path = folder / "clip.bvh"
    write_bvh(path, bvh)
    return load_capture(path)


def test_figures_are_those_of_the_file(boxer, tmp_path):
    capture = _capture(tmp_path, export_motion(*boxer, BY_NAME["mixamo"], Export(scale=0.0254, every=2)))
    told = describe_capture(capture, study_capture(capture))
    assert list(told)[:3] == ["joints", "end_sites", "channels"]
    assert set(KEYS) <= set(told)
    assert told["joints"] == len(BY_NAME["mixamo"].nodes)
    assert told["channels"] == 3 + 3 * told["joints"]
    assert (told["frames"], told["fps"], told["seconds"]) == (240, 30.0, 8.0)
    assert told["unit_scale"] == pytest.approx(0.0254)
    assert told["roles"]["left_hand"] == "mixamorig:LeftHand"
    json.dumps(told, allow_nan=False)


def test_strikes_are_told_by_their_time_in_the_file(boxer, tmp_path):
    clip = boxer[0]
    # Three seconds of T-pose come first.
    held = np.zeros((180, clip.skeleton.joint_count, 4))
    held[..., 0] = 1.0
    roots = np.repeat(clip.root_positions[:1], 180, axis=0)
    longer = replace(
        clip,
        rotations=np.concatenate([held, clip.rotations]),
        root_positions=np.concatenate([roots, clip.root_positions]),
    )
    plain, late = (_capture(tmp_path, motion) for motion in (clip, longer))
    ours, theirs = (describe_capture(capture, study_capture(capture)) for capture in (plain, late))
    assert theirs["frames"] == ours["frames"] + 180
    assert theirs["lead_in_frames"] >= 180
    assert ours["strikes"] == len(ours["strike_list"]) > 3
    known = [strike["frame"] + 180 for strike in ours["strike_list"] if strike["frame"] > 40]
    assert set(known) <= {strike["frame"] for strike in theirs["strike_list"]}
    for strike in theirs["strike_list"]:
        assert strike["hand"] in ("left", "right")
        assert strike["seconds"] == pytest.approx(strike["frame"] / 60.0, abs=1e-3)


def test_contacts_are_counted_over_both_feet(boxer, tmp_path):
    capture = _capture(tmp_path, boxer[0])
    study = study_capture(capture)
    told = describe_capture(capture, study)
    assert told["contacts"] == len(runs(study.contacts[:, 0])) + len(runs(study.contacts[:, 1]))
    np.testing.assert_allclose(told["contact_share"], study.contacts.mean(axis=0), atol=1e-4)


def test_what_is_unknown_is_null(tmp_path):
    capture = _capture(tmp_path, export_animal(ANIMALS["snake"], frames=1))
    told = describe_capture(capture, study_capture(capture))
    for key in ("unit_scale", "up_axis", "height_m", "contacts", "strikes", "floor_m"):
        assert told[key] is None, key
    assert told["roles"] == {}
    assert len(told["findings"]) == 4
    json.dumps(told, allow_nan=False)


def _draw(capture, folder):
    paths = plot_capture(capture, study_capture(capture), folder)
    for path in paths:
        with Image.open(path) as picture:
            assert np.asarray(picture.convert("L")).std() > 5.0, path.name
    return [path.name for path in paths]


def test_four_pictures_are_drawn_of_a_body_that_moves(boxer, tmp_path):
    capture = _capture(tmp_path, export_motion(*boxer, BY_NAME["unreal"], Export(rest="bones", up=UPS["z"])))
    names = _draw(capture, tmp_path / "deep" / "plots")
    assert names == [f"clip_{part}.png" for part in ("skeleton", "path", "time", "figures")]
    assert sorted(path.name for path in (tmp_path / "deep" / "plots").iterdir()) == sorted(names)


@pytest.mark.parametrize("name", ["dog", "snake"])
@pytest.mark.parametrize("frames", [0, 1, 30])
def test_the_skeleton_is_drawn_of_anything(tmp_path, name, frames):
    assert _draw(_capture(tmp_path, export_animal(ANIMALS[name], frames)), tmp_path) == ["clip_skeleton.png"]


def test_the_skeleton_is_drawn_of_a_single_frame(boxer, tmp_path):
    bvh = export_motion(*boxer, BY_NAME["flat"], Export(rest="bones", frames=slice(40, 41)))
    assert _draw(_capture(tmp_path, bvh), tmp_path) == ["clip_skeleton.png"]


def test_a_short_clip_without_contacts_or_strikes_is_drawn(boxer, tmp_path):
    clip = boxer[0].sliced(0, 2)
    raised = replace(clip, root_positions=clip.root_positions + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.2]]))
    assert len(_draw(_capture(tmp_path, raised), tmp_path)) == 4
