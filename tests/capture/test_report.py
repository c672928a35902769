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

from crowdsim.bvh.io import write_bvh
from crowdsim.capture.loading import load_capture
from crowdsim.capture.plots import path_figure, plot_capture, pose_figure, skeleton_figure, time_figure
from crowdsim.capture.report import describe_capture
from crowdsim.motion.contacts import runs
from crowdsim.motion.roles import find_roles
from crowdsim.motion.strikes import REASONS, Rejection
from crowdsim.performer.session import perform

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
    result = describe_capture(capture)
    assert list(result)[:3] == ["joints", "end_sites", "channels"]
    assert set(KEYS) <= set(result)
    assert result["joints"] == len(BY_NAME["mixamo"].nodes)
    assert result["channels"] == 3 + 3 * result["joints"]
    assert (result["frames"], result["fps"], result["seconds"]) == (240, 30.0, 8.0)
    assert result["unit_scale"] == pytest.approx(0.0254)
    assert result["roles"]["left_hand"] == "mixamorig:LeftHand"
    json.dumps(result, allow_nan=False)


def test_strikes_are_reported_by_their_time_in_the_file(boxer, tmp_path):
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
    ours, theirs = (describe_capture(capture) for capture in (plain, late))
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
    analysis = capture.analysis
    result = describe_capture(capture)
    assert result["contacts"] == len(runs(analysis.contacts[:, 0])) + len(runs(analysis.contacts[:, 1]))
    np.testing.assert_allclose(result["contact_share"], analysis.contacts.mean(axis=0), atol=1e-4)


def test_what_is_unknown_is_null(tmp_path):
    capture = _capture(tmp_path, export_animal(ANIMALS["snake"], frames=1))
    result = describe_capture(capture)
    for key in ("unit_scale", "up_axis", "height_m", "contacts", "strikes", "floor_m"):
        assert result[key] is None, key
    assert result["roles"] == {}
    assert len(result["findings"]) == 4
    json.dumps(result, allow_nan=False)


def test_swings_that_are_no_strikes_are_listed_with_time_hand_speed_and_reason(boxer, tmp_path):
    capture = _capture(tmp_path, boxer[0])
    analysis = capture.analysis
    listed = describe_capture(capture)["rejected_list"]
    assert len(listed) == len(analysis.strikes.rejected.peaks) > 3
    first, peak = listed[0], int(analysis.strikes.rejected.peaks[0])
    assert list(first) == ["seconds", "hand", "limb", "speed", "reason"]
    assert first["seconds"] == pytest.approx(capture.start + peak / 60.0, abs=1e-3)
    assert {swing["reason"] for swing in listed} <= {reason.name.lower() for reason in Rejection}


def _axes_of(capture):
    analysis = capture.analysis
    figures = skeleton_figure(capture), path_figure(analysis), time_figure(analysis, 0.0), pose_figure(analysis, 0.0)
    return [figure.axes for figure in figures]


def test_every_axis_of_a_plot_has_a_unit_and_positions_have_equal_scales(boxer, tmp_path):
    capture = _capture(tmp_path, boxer[0])
    skeleton, path, (strips, speeds), poses = _axes_of(capture)
    for axes in (*skeleton, *path, *poses):
        assert axes.get_aspect() == 1.0
        assert axes.get_ylabel().endswith("[m]")
        assert "-x" not in axes.get_xlabel()
        assert not axes.xaxis_inverted()
    assert [axes.get_xlabel() for axes in (*skeleton, *path)] == ["to its left [m]", "ahead [m]", "z [m]"]
    assert path[0].get_ylabel() == "x [m]"
    assert all(axes.get_xlabel().startswith("time in the file [s]") for axes in (speeds, *poses))
    assert speeds.get_ylabel() == "speed relative to the pelvis [m/s]"
    assert strips.get_ylabel() == ""


def test_the_path_from_above_is_no_mirror_image(boxer, tmp_path):
    analysis = _capture(tmp_path, boxer[0]).analysis
    line = path_figure(analysis).axes[0].lines[0]
    # From above, y towards the eye, x is a quarter turn anticlockwise from z.
    np.testing.assert_allclose(line.get_xdata(), analysis.tracks.ground[:, 1])
    np.testing.assert_allclose(line.get_ydata(), analysis.tracks.ground[:, 0])


def test_rejected_swings_are_marked_on_the_speed_of_the_fist_with_their_reason(boxer, tmp_path):
    capture = _capture(tmp_path, boxer[0])
    analysis = capture.analysis
    rejected = analysis.strikes.rejected
    speeds = time_figure(analysis, capture.start).axes[1]
    marks = np.concatenate([marked.get_offsets() for marked in speeds.collections])
    marks = marks[np.lexsort(marks.T)]
    wanted = np.stack([capture.start + rejected.peaks / 60.0, rejected.speeds], axis=1)
    np.testing.assert_allclose(marks, wanted[np.lexsort(wanted.T)], rtol=1e-6)
    labels = [line.get_label() for line in speeds.lines]
    for reason in Rejection:
        count = int((rejected.reasons == reason).sum())
        assert (f"no strike, {REASONS[reason]} ({count})" in labels) == (count > 0)


def _draw(capture, folder):
    paths = plot_capture(capture, folder)
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
