"""Any BVH file shows as a figure."""

import numpy as np
import pytest
from people import placed, together

from crowdsim.bvh.io import write_bvh
from crowdsim.errors import BvhError
from crowdsim.performer.session import perform
from crowdsim.render.bvh_figure import bvh_source, clip_source, show_rate
from crowdsim.render.look import Look
from crowdsim.render.stage import build_stage

SNAKE = """HIERARCHY
ROOT head
{
    OFFSET 0 0 0
    CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
    JOINT middle
    {
        OFFSET 0 0 -8
        CHANNELS 3 Zrotation Xrotation Yrotation
        JOINT tail
        {
            OFFSET 0 0 -8
            CHANNELS 3 Zrotation Xrotation Yrotation
            End Site
            {
                OFFSET 0 0 -6
            }
        }
    }
}
MOTION
Frames: 3
Frame Time: 0.05
0 5 0 0 0 0 0 0 20 0 0 -20
0 5 2 0 0 0 0 0 10 0 0 -10
0 5 4 0 0 0 0 0 0 0 0 0
"""


@pytest.fixture
def snake(tmp_path):
    path = tmp_path / "snake.bvh"
    path.write_text(SNAKE)
    return path


def test_an_animal_of_unknown_scale_is_brought_to_a_size_and_put_on_the_floor(snake):
    source, findings = bvh_source(snake)
    assert source.frame_count == 3
    assert source.name == "snake"
    assert any("no human body" in finding for finding in findings)
    extent = source.positions.max(axis=(0, 1)) - source.positions.min(axis=(0, 1))
    assert 0.5 < extent.max() < 3.0
    assert source.positions[..., 1].min() == pytest.approx(0.0, abs=0.2)
    assert len(source.figures[0].capsule_joints) == 3


@pytest.mark.parametrize("camera", ["front+side", "auto", "top", "orbit", "follow:0"])
def test_a_figure_fills_a_good_part_of_the_picture(snake, camera):
    source, _ = bvh_source(snake)
    stage = build_stage(source, (160, 96), camera, look=Look(caption=False))
    picture = stage.picture(1).astype(int)
    # The figure is red; sky and floor are grey or blue.
    red = picture[..., 0] - picture[..., 2] > 25
    assert 0.004 < red.mean() < 0.5
    assert not red[:2].any()
    assert not red[:, :1].any()


def test_a_body_is_on_the_floor_and_faces_the_front_camera():
    performance = perform(2.0, 3)[0]
    source = clip_source(performance.clip)
    assert source.frame_count == performance.clip.frame_count
    assert source.avatar_heights[0] > 1.0


def test_rates_above_sixty_are_halved_until_they_are_not():
    assert [show_rate(fps) for fps in (24.0, 60.0, 90.0, 120.0, 240.0)] == [24.0, 60.0, 45.0, 60.0, 60.0]
    assert show_rate(120.0, 25.0) == 25.0


def test_a_given_rate_resamples(snake):
    assert bvh_source(snake, 40.0)[0].frame_count == 5


def test_a_file_without_frames_is_refused(tmp_path):
    path = tmp_path / "still.bvh"
    path.write_text(SNAKE[: SNAKE.index("Frames")] + "Frames: 0\nFrame Time: 0.05\n")
    with pytest.raises(BvhError, match="no frames, expected motion to draw"):
        bvh_source(path)


def test_a_value_that_is_no_number_is_named_by_its_frame():
    clip = perform(2.0, 3)[0].clip
    roots = clip.root_positions.copy()
    roots[7] = np.nan
    from dataclasses import replace

    with pytest.raises(BvhError, match="frame 7 holds a value that is no number"):
        clip_source(replace(clip, root_positions=roots))


def test_people_of_one_file_are_drawn_together(tmp_path):
    clip = perform(2.0, 3)[0].clip
    path = tmp_path / "pair.bvh"
    write_bvh(path, together([clip, placed(clip, 0.0, 1.5, np.pi)], ["A:", "B:"]))
    source, findings = bvh_source(path)
    assert source.avatar_names == ("pair#1", "pair#2")
    assert len(findings) == 1
    assert source.frame_count == clip.frame_count
    assert [len(positions) for positions, _ in source.poses(3)] == [1, 1]
    assert source.ground(np.array([0, 5])).shape == (2, 2, 3)
    picture = build_stage(source, (160, 96), "side", look=Look(caption=False)).picture(10).astype(int)
    assert (picture[..., 0] - picture[..., 2] > 40).sum() > 40
    assert (picture[..., 2] - picture[..., 0] > 60).sum() > 40
    alone, _ = bvh_source(f"{path}#2")
    assert alone.name == "pair#2"
    np.testing.assert_array_equal(alone.poses(3)[0][0], source.poses(3)[1][0])


@pytest.mark.mocap
def test_real_capture_shows_upright_and_within_the_picture(mocap):
    path = next(mocap.rglob("cmu_13_18_boxing.bvh"))
    source, _ = bvh_source(path)
    stage = build_stage(source, (160, 96), look=Look(caption=False))
    for frame in (0, 300, 1200):
        picture = stage.picture(frame).astype(int)
        figure = (picture[..., 0] - picture[..., 2]) > 30
        assert 0.01 < figure.mean() < 0.4
        assert not figure[:1].any()
