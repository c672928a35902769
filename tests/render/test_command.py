"""What users write becomes what the renderer takes, or a clear message."""

import numpy as np
import pytest
from PIL import Image
from render_sources import Walkers, random_walk
from test_bvh_figure import SNAKE

from crowdsim.errors import CrowdsimError, TakeError
from crowdsim.outputs.render import RenderOutput
from crowdsim.render.batch import render
from crowdsim.render.command import (
    parse_size,
    render_bvh,
    render_many,
    scenario_options,
)
from crowdsim.render.look import Look
from crowdsim.render.options import RenderOptions
from crowdsim.render.stage import build_stage
from crowdsim.scenario.camera_files import read_shots
from crowdsim.scenario.cameras import Shot

SMALL = RenderOptions(size=(64, 48), threads=1)


def test_sizes_are_width_and_height():
    assert parse_size("1280x720") == (1280, 720)
    assert parse_size(" 640X480") == (640, 480)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1280", "size '1280': expected WIDTHxHEIGHT in pixels, 1280x720 say"),
        ("axb", "size 'axb': expected WIDTHxHEIGHT in pixels, 1280x720 say"),
        ("-5x20", "size '-5x20': expected WIDTHxHEIGHT in pixels, 1280x720 say"),
        ("8x720", "size '8x720': 8 is out of range, expected 16 to 8192"),
        ("99999x720", "size '99999x720': 99999 is out of range, expected 16 to 8192"),
    ],
)
def test_other_sizes_are_refused(text, message):
    with pytest.raises(CrowdsimError) as caught:
        parse_size(text)
    assert str(caught.value) == message


def test_a_bvh_file_becomes_a_video(tmp_path):
    path = tmp_path / "snake.bvh"
    path.write_text(SNAKE)
    rendered, findings = render_bvh(path, tmp_path / "out", SMALL)
    assert rendered.files == (tmp_path / "out" / "video.mp4",)
    assert rendered.drawn == 3
    assert findings


def test_one_failure_in_a_batch_hurts_no_other(tmp_path):
    good, bad = tmp_path / "good.bvh", tmp_path / "bad.bvh"
    good.write_text(SNAKE)
    bad.write_text("no motion at all")
    steps = []
    outcomes = render_many(
        [bad, tmp_path / "missing.bvh", good],
        [tmp_path / name for name in ("a", "b", "c")],
        SMALL,
        progress=lambda *step: steps.append(step),
    )
    assert [outcome.error is None for outcome in outcomes] == [False, False, True]
    assert str(bad) in str(outcomes[0].error)
    assert "missing.bvh" in str(outcomes[1].error)
    assert (tmp_path / "c" / "video.mp4").exists()
    assert not (tmp_path / "a").exists()
    assert [step for step in steps if step[0] == "files"] == [("files", i, 3) for i in (1, 2, 3)]


def test_a_batch_opens_what_is_no_bvh_with_the_given_function(tmp_path):
    walkers = Walkers(random_walk(4, 2, 0))
    (tmp_path / "run").mkdir()
    outcome = render_many(
        [tmp_path / "run"], [tmp_path / "out"], SMALL, lambda path, options: (walkers, (f"{path.name} is unfinished",))
    )[0]
    assert outcome.error is None
    assert outcome.notes == ("run is unfinished",)
    assert (tmp_path / "out" / "video.mp4").exists()


def test_a_shared_output_folder_is_refused(tmp_path):
    with pytest.raises(CrowdsimError, match="expected a folder each"):
        render_many([tmp_path / "a.bvh", tmp_path / "b.bvh"], [tmp_path, tmp_path], SMALL)


def test_open_ranges_end_with_the_source(tmp_path):
    walkers = Walkers(random_walk(6, 2, 0))
    options = RenderOptions(size=(64, 48), frames=(4, None), mp4=False, png=True)
    assert [path.name for path in render(walkers, tmp_path, options).files] == ["000004.png", "000005.png"]
    with pytest.raises(TakeError, match="frames 6:6 are not there"):
        render(walkers, tmp_path, RenderOptions(frames=(6, None)))


def test_a_command_without_outputs_is_refused(tmp_path):
    with pytest.raises(CrowdsimError, match="nothing to write, expected --mp4, --png or --contact-sheet"):
        render(Walkers(np.zeros((3, 1, 3))), tmp_path, RenderOptions(mp4=False))


def test_the_render_section_of_a_scenario_is_used():
    options = scenario_options(RenderOutput(size=(320, 180), fps=24, contact_sheet=6, caption=False), 2)
    assert options == RenderOptions((320, 180), 24, None, "auto", True, False, 6, Look(caption=False), threads=2)
    output = RenderOutput(marks="none", grid=False, background="#ff9000", light="soft", camera="eye:3")
    options = scenario_options(output)
    assert options.look == Look("none", False, "#ff9000", "soft")
    assert options.camera == "eye:3"


def test_shots_are_drawn_one_after_another(tmp_path):
    walkers = Walkers(random_walk(30, 3, 0))
    shots = (Shot(**{"camera": "top", "from": 4, "to": 6}), Shot(**{"camera": "side", "from": "0.5s", "to": "0.6s"}))
    options = RenderOptions(size=(64, 48), shots=shots, mp4=False, png=True, look=Look(caption=False))
    files = render(walkers, tmp_path, options).files
    assert [path.stem for path in files] == [f"{frame:06d}" for frame in range(5)]
    for path, camera, frame in ((files[1], "top", 5), (files[4], "side", 17)):
        expected = build_stage(walkers, (64, 48), camera, Look(caption=False)).picture(frame)
        np.testing.assert_array_equal(np.asarray(Image.open(path)), expected)


def test_a_shot_beyond_the_take_is_refused(tmp_path):
    walkers = Walkers(random_walk(30, 3, 0))
    options = RenderOptions(shots=(Shot(**{"camera": "top", "from": "2s"}),), mp4=False, png=True)
    with pytest.raises(TakeError, match="there are frames 0 to 29 at 30 fps"):
        render(walkers, tmp_path, options)


def test_files_of_shots_say_what_is_wrong_with_them(tmp_path):
    path = tmp_path / "shots.yaml"
    path.write_text("cameras:\n  low: {kind: top}\nshots:\n  - {camera: lwo}\n  - {camera: low, from: 3s, to: 2s}\n")
    with pytest.raises(CrowdsimError) as caught:
        read_shots(path)
    assert "shots.yaml:4:14: shots[0].camera: camera 'lwo' is unknown" in str(caught.value)
    assert "(did you mean 'low'?)" in str(caught.value)
    assert "shots[1]: frames '3s:2s': is empty" in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"marks": "some"}, "marks 'some': expected none, landed, all"),
        ({"light": "dya"}, "light 'dya': expected day, soft, evening, night (did you mean 'day'?)"),
        ({"background": "blakc"}, "(did you mean 'black'?)"),
    ],
)
def test_unknown_looks_are_refused(keys, message):
    with pytest.raises(CrowdsimError) as caught:
        Look(**keys)
    assert message in str(caught.value)
