"""What users write becomes what the renderer takes, or a clear message."""

import numpy as np
import pytest
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
from crowdsim.render.options import RenderOptions

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
    assert options == RenderOptions((320, 180), 24, None, "auto", True, False, 6, False, 2)
    assert scenario_options(RenderOutput(camera={"kind": "follow", "avatar": 4})).camera == "follow:4"
    key = {"seconds": 1.0, "position": (1, 2, 3), "look_at": (0, 1, 0)}
    keyed = scenario_options(RenderOutput(camera={"kind": "keys", "keys": [key]})).camera
    assert keyed.positions.tolist() == [[1, 2, 3]]
    assert keyed.targets.tolist() == [[0, 1, 0]]
    assert keyed.seconds.tolist() == [1.0]
