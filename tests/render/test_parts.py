"""Folders of a video's segments: what was killed while it made one is taken over, what others have made is not."""

import os

import pytest
from render_sources import Walkers, random_walk

from crowdsim.errors import OutputError
from crowdsim.render import segments
from crowdsim.render.batch import adopt_frames, draw_apart, render
from crowdsim.render.options import RenderOptions
from crowdsim.render.parts import is_parts, make_parts, remove_parts

MARK = "0123456789abcdef0123456789abcdef"
NAME = f".video-{MARK[:16]}"

BEGUN = {"empty": {}, "unfinished mark": {".mark.part": "0123"}, "unwritten mark": {".mark.part": ""}}
FOREIGN = {
    "notes": {"notes.txt": "mine"},
    "notes beside a mark": {".mark.part": MARK, "notes.txt": "mine"},
    "another mark": {"mark": MARK[::-1]},
    "a short mark": {"mark": MARK[:8]},
}


def fill(path, files):
    path.mkdir()
    for name, text in files.items():
        (path / name).write_text(text)
    return path


@pytest.mark.parametrize("files", BEGUN.values(), ids=BEGUN)
def test_a_folder_that_was_begun_is_taken_over(tmp_path, files):
    parts = fill(tmp_path / NAME, files)
    assert is_parts(parts)
    make_parts(parts, MARK)
    assert {path.name: path.read_text() for path in parts.iterdir()} == {"mark": MARK}
    make_parts(parts, MARK)
    other = fill(tmp_path / f".video-{MARK[1:17]}", files)
    remove_parts(other)
    assert not other.exists()


@pytest.mark.parametrize("files", FOREIGN.values(), ids=FOREIGN)
def test_a_folder_of_others_stays_as_it_is(tmp_path, files):
    parts = fill(tmp_path / NAME, files)
    assert not is_parts(parts)
    with pytest.raises(OutputError, match="is in the way of a video's segments, and no rendering has made it"):
        make_parts(parts, MARK)
    assert {path.name: path.read_text() for path in parts.iterdir()} == files


def test_links_are_not_followed(tmp_path):
    (tmp_path / "mine").write_text("mine")
    parts = fill(tmp_path / NAME, {})
    (parts / ".mark.part").symlink_to(tmp_path / "mine")
    linked = tmp_path / f".video-{MARK[1:17]}"
    linked.symlink_to(fill(tmp_path / "elsewhere", {}))
    for path in (parts, linked):
        assert not is_parts(path)
        with pytest.raises(OutputError, match="in the way"):
            make_parts(path, MARK)
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.mark.parametrize("moves", [0, 1, 2])
def test_segments_that_were_moved_in_part_are_taken_over(tmp_path, monkeypatch, moves):
    monkeypatch.setattr(segments, "SEGMENT", 4)
    walkers, options = Walkers(random_walk(8, 3, 1, 1.0)), RenderOptions(size=(96, 64), threads=1)
    apart = draw_apart(walkers, tmp_path / "apart", options)
    done, replace = [], os.replace

    def stop(source, target):
        if len(done) == moves:
            raise KeyboardInterrupt
        done.append(source)
        replace(source, target)

    (tmp_path / "out").mkdir()
    monkeypatch.setattr(os, "replace", stop)
    with pytest.raises(KeyboardInterrupt):
        adopt_frames(tmp_path / "out", [apart])
    monkeypatch.setattr(os, "replace", replace)
    assert all(is_parts(path) for path in (tmp_path / "out").iterdir())
    adopt_frames(tmp_path / "out", [apart])
    finished = render(walkers, tmp_path / "out", options)
    assert (finished.drawn, finished.kept) == (0, 8)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["video.mp4"]
