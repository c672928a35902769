"""Rendering to files: the same pixels however the work is shared, and what is finished stays."""

import hashlib

import numpy as np
import pytest
from PIL import Image
from render_sources import Walkers, random_walk
from test_video import decode, describe

from crowdsim.errors import CrowdsimError, OutputError, RunError, TakeError
from crowdsim.render import segments
from crowdsim.render.batch import render
from crowdsim.render.contact_sheet import sheet_frames
from crowdsim.render.look import Look
from crowdsim.render.options import RenderOptions
from crowdsim.render.stage import build_stage

PLAIN = Look(caption=False)
SIZE = (96, 64)


@pytest.fixture
def walkers():
    return Walkers(random_walk(20, 3, 1, 1.0))


def pixels(folder):
    """Digest of the pixels of every picture, by name."""
    return {
        path.name: hashlib.sha256(np.asarray(Image.open(path)).tobytes()).hexdigest()
        for path in sorted(folder.glob("frames/*.png"))
    }


def test_threads_jobs_and_ranges_give_the_same_pixels(tmp_path, walkers, monkeypatch):
    monkeypatch.setattr(segments, "SEGMENT", 7)
    settings = {"size": SIZE, "mp4": False, "png": True}
    render(walkers, tmp_path / "one", RenderOptions(threads=1, **settings))
    whole = pixels(tmp_path / "one")
    assert len(whole) == 20
    assert len(set(whole.values())) == 20
    render(walkers, tmp_path / "three", RenderOptions(threads=3, **settings))
    assert pixels(tmp_path / "three") == whole
    render(walkers, tmp_path / "jobs", RenderOptions(threads=2, jobs=2, **settings))
    assert pixels(tmp_path / "jobs") == whole
    render(walkers, tmp_path / "range", RenderOptions(frames=(5, 9), **settings))
    assert pixels(tmp_path / "range") == {name: whole[name] for name in sorted(whole)[5:9]}


def test_a_video_of_segments_shows_every_frame_once(tmp_path, walkers, monkeypatch):
    monkeypatch.setattr(segments, "SEGMENT", 8)
    done = render(walkers, tmp_path, RenderOptions(size=SIZE, threads=2, frames=(3, 20)))
    assert (done.drawn, done.kept) == (17, 0)
    assert done.files == (tmp_path / "video.mp4",)
    assert [path.name for path in tmp_path.iterdir()] == ["video.mp4"]
    assert describe(tmp_path / "video.mp4")[1] == 17
    stage = build_stage(walkers, SIZE)
    shown = np.array([stage.picture(frame) for frame in range(3, 20)], int)
    for index, picture in enumerate(decode(tmp_path / "video.mp4", SIZE)):
        errors = np.abs(shown - picture).mean(axis=(1, 2, 3))
        assert np.argmin(errors) == index
        assert errors[index] < 5.0


def test_finished_segments_are_kept_after_an_interruption(tmp_path, walkers, monkeypatch):
    monkeypatch.setattr(segments, "SEGMENT", 5)

    def interrupt(stage, done, total):
        if done == 12:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(walkers, tmp_path, RenderOptions(size=SIZE, threads=1), progress=interrupt)
    assert not (tmp_path / "video.mp4").exists()
    walkers.drawn.clear()
    done = render(walkers, tmp_path, RenderOptions(size=SIZE, threads=1))
    assert (done.drawn, done.kept) == (10, 10)
    assert sorted(set(walkers.drawn)) == list(range(10, 20))
    assert [path.name for path in tmp_path.iterdir()] == ["video.mp4"]


def test_finished_pictures_are_kept_unless_something_changed(tmp_path, walkers):
    settings = {"size": SIZE, "mp4": False, "png": True, "threads": 1}
    render(walkers, tmp_path, RenderOptions(frames=(0, 8), **settings))
    walkers.drawn.clear()
    render(walkers, tmp_path, RenderOptions(**settings))
    assert sorted(set(walkers.drawn)) == list(range(8, 20))
    walkers.drawn.clear()
    assert render(walkers, tmp_path, RenderOptions(**settings)).kept == 20
    assert walkers.drawn == []
    render(walkers, tmp_path, RenderOptions(camera="top", **settings))
    assert sorted(set(walkers.drawn)) == list(range(20))


def test_progress_counts_frames(tmp_path, walkers):
    seen = []
    render(
        walkers,
        tmp_path,
        RenderOptions(size=SIZE, threads=2, contact_sheet=2),
        progress=lambda *step: seen.append(step),
    )
    assert [step for step in seen if step[0] == "frames"] == [("frames", i, 20) for i in range(1, 21)]
    assert seen[-1] == ("contact sheet", 2, 2)


def test_a_contact_sheet_shows_moments_spread_over_the_range(tmp_path, walkers):
    assert sheet_frames(0, 100, 4) == [12, 37, 62, 87]
    assert sheet_frames(10, 12, 5) == [10, 11]
    walkers.drawn.clear()
    done = render(walkers, tmp_path, RenderOptions(size=SIZE, mp4=False, contact_sheet=6, look=PLAIN, threads=1))
    assert done.files == (tmp_path / "contact_sheet.png",)
    assert walkers.drawn == sheet_frames(0, 20, 6)
    sheet = np.asarray(Image.open(done.files[0]))
    assert sheet.shape[0] >= 2 * SIZE[1]
    assert sheet.shape[1] >= 2 * SIZE[0]


def test_a_caption_can_be_omitted(walkers):
    with_it = build_stage(walkers, (320, 180)).picture(4).astype(int)
    without = build_stage(walkers, (320, 180), look=PLAIN).picture(4).astype(int)
    rows = np.flatnonzero((with_it != without).any(axis=(1, 2)))
    assert rows.min() > 0.85 * 180
    assert np.abs(with_it - without).max() > 40


def test_strikes_that_land_flash_for_a_moment(walkers):
    x, z, _ = walkers.paths[10, 0]
    walkers.strikes = np.array([[10 / 30, x, 1.4, z]])
    lit = build_stage(walkers, SIZE, look=PLAIN)
    plain = build_stage(Walkers(walkers.paths), SIZE, look=PLAIN)
    glow = [(lit.picture(f).astype(int) - plain.picture(f)).sum() for f in (9, 10, 13, 19)]
    assert glow[0] == 0
    assert glow[1] > glow[2] > 0
    assert glow[3] == 0


def test_several_cameras_are_drawn_side_by_side(walkers):
    both = build_stage(walkers, SIZE, "side+top", look=PLAIN).picture(3)
    halves = [build_stage(walkers, (48, 64), camera, look=PLAIN).picture(3) for camera in ("side", "top")]
    beside = [*range(47), *range(49, 96)]
    np.testing.assert_array_equal(both[:, beside], np.concatenate(halves, axis=1)[:, beside])
    assert len(np.unique(both[:, 47:49])) == 1


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"frames": (5, 25)}, TakeError, "walkers: frames 5:25 are not there, expected a range within 0:20"),
        ({"frames": (7, 7)}, TakeError, "walkers: frames 7:7 are not there, expected a range within 0:20"),
        ({"size": (97, 64)}, CrowdsimError, "size 97x64: a video needs an even width and height"),
        ({"threads": 0}, CrowdsimError, "threads is 0, expected 1 or more"),
        ({"jobs": 0}, CrowdsimError, "jobs is 0, expected 1 or more"),
        ({"camera": "follow:3"}, CrowdsimError, "camera 'follow:3': no avatar 3"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_anything_is_made(tmp_path, walkers, arguments, error, message):
    with pytest.raises(error) as caught:
        render(walkers, tmp_path / "out", RenderOptions(**{"size": SIZE, **arguments}))
    assert str(caught.value).startswith(message)
    assert not (tmp_path / "out").exists()


def test_a_failure_leaves_no_half_written_video(tmp_path, walkers, monkeypatch):
    def full(path, picture, mark=""):
        raise OutputError(f"{path}: cannot write picture: No space left on device, the disk is full")

    monkeypatch.setattr(segments, "write_png", full)
    with pytest.raises(RunError, match="the disk is full"):
        render(walkers, tmp_path, RenderOptions(size=SIZE, png=True, threads=2))
    assert not (tmp_path / "video.mp4").exists()
    assert not list(tmp_path.rglob("*.part"))
