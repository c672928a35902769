"""Exports appear all together, go on after an interruption, and leave nothing behind."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene
from test_resuming import Stop
from test_runner import tree

from crowdsim import files
from crowdsim.export import cloud_files, pointcloud
from crowdsim.runs import stage
from crowdsim.runs.manifest import OUTPUTS, read_manifest

FIRST = ("export", "run", "--bvh", "--ply", "--fps", "30", "--every", "3", "--points", "20", "--threads", "1")
PICTURE = ("--contact-sheet", "1", "--size", "32x24", "--frames", "0:1", "--camera", "side")
SECOND = (*FIRST[:5], "60", "--every", "7", "--points", "30", "--threads", "1")


@pytest.fixture
def exported(workplace: Path, finish: Callable[..., None]) -> Path:
    """A run with exports."""
    write_scene(workplace / "four.yaml")
    finish(workplace)
    assert crowdsim(*FIRST) == 0
    return workplace / "run"


def stop_at_cloud(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    write, written = cloud_files.write_cloud, []

    def stop(path: Path, cloud) -> None:
        if len(written) == count:
            raise Stop
        written.append(path)
        write(path, cloud)

    monkeypatch.setattr(pointcloud, "write_cloud", stop)


def tree_of(folder: Path) -> dict[str, bytes]:
    """Return the exports in a folder that is no run's."""
    return {name: text for name, text in tree(folder).items() if name != OUTPUTS}


def names_of(folder: Path) -> set[str]:
    return {name for name in tree(folder) if name.split("/")[0] in ("bvh", "ply")}


def test_an_export_that_stopped_leaves_the_old_files_and_goes_on(exported: Path, monkeypatch, capsys) -> None:
    before = tree(exported)
    with monkeypatch.context() as patch:
        stop_at_cloud(patch, 5)
        with pytest.raises(Stop):
            crowdsim(*SECOND)
    after = tree(exported)
    assert {name: after[name] for name in before} == before
    assert all(name.startswith(".export.partial/") for name in set(after) - set(before))
    capsys.readouterr()
    assert crowdsim("verify", exported) == 0
    assert "a command was not finished: .export.partial\n" in capsys.readouterr().err
    kept = {path.name: path.stat().st_mtime_ns for path in exported.glob(".export.partial/ply/*.ply")}
    assert len(kept) == 5
    assert crowdsim(*SECOND) == 0
    assert {name: (exported / "ply" / name).stat().st_mtime_ns for name in kept} == kept
    assert crowdsim(*SECOND, "--out", "elsewhere") == 0
    result = {name: text for name, text in tree(exported).items() if name in names_of(exported)}
    assert result == tree_of(exported.parent / "elsewhere")
    assert set(result) <= set(read_manifest(exported)["files"])
    capsys.readouterr()
    assert crowdsim("verify", exported) == 0
    assert capsys.readouterr().err == ""
    assert not [path for path in exported.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("moves", [0, 1, 3, 9, 24, 50])
def test_an_export_that_stopped_while_files_were_moved_is_seen_whole_and_completed_by_any_command_that_writes(
    exported: Path, monkeypatch, capsys, moves: int
) -> None:
    assert crowdsim(*SECOND, "--out", "elsewhere") == 0
    put, move, done = stage._put_in_place, os.replace, []

    def replace(source, target, **named) -> None:
        if len(done) == moves:
            raise Stop
        done.append(target)
        move(source, target, **named)

    def put_some(*values) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(files.os, "replace", replace)
            put(*values)

    with monkeypatch.context() as patch:
        patch.setattr(stage, "_put_in_place", put_some)
        if moves < 50:
            with pytest.raises(Stop):
                crowdsim(*SECOND)
        else:
            assert crowdsim(*SECOND) == 0
    before = tree(exported)
    for words in (("verify", exported), ("inspect", exported), ("status", exported)):
        assert crowdsim(*words) == 0, capsys.readouterr().err
    assert tree(exported) == before
    assert crowdsim("render", exported, *PICTURE) == 0
    assert crowdsim("verify", exported) == 0
    result = {name: text for name, text in tree(exported).items() if name in names_of(exported)}
    assert result == tree_of(exported.parent / "elsewhere")
    assert not [path for path in exported.iterdir() if path.name.startswith(".")]


def test_a_hidden_folder_of_a_run_keeps_its_name(exported: Path) -> None:
    picture = ("render", exported, *PICTURE, "-q")
    before = set(tree(exported))
    assert crowdsim(*picture, "--out", exported / ".pics") == 0
    written = {name for name in set(tree(exported)) - before if not name.endswith(".json")}
    assert written
    assert all(name.startswith(".pics/") for name in written)
    assert not (exported / "pics").exists()
    assert crowdsim("verify", exported) == 0


def test_another_export_removes_what_one_has_left(exported: Path, monkeypatch) -> None:
    for out in ("run", "elsewhere"):
        with monkeypatch.context() as patch:
            stop_at_cloud(patch, 5)
            with pytest.raises(Stop):
                crowdsim(*SECOND, "--out", out)
        folder = exported.parent / out
        assert (folder / ".export.partial").is_dir()
        assert crowdsim(*FIRST, "--out", out) == 0
        assert not [path for path in folder.rglob(".*") if "take.zarr" not in path.parts and path.name != OUTPUTS]
    assert crowdsim("verify", exported) == 0
    assert names_of(exported) == set(tree_of(exported.parent / "elsewhere"))


@pytest.mark.parametrize("held", [(), ("bvh",), (".stage.json.part",)])
def test_what_is_left_of_a_stage_goes_with_the_next_command(exported: Path, held: tuple[str, ...]) -> None:
    for words in (
        FIRST,
        ("run", "four.yaml", "--out", "run"),
        ("render", "run", "--png", "--size", "32x24", "--frames", "0:1", "--camera", "side"),
    ):
        for name in stage.STAGES:
            (exported / name).mkdir()
            for one in held:
                (exported / name / one).write_text("{") if one.endswith("part") else (exported / name / one).mkdir()
        assert crowdsim(*words) == 0
        assert not [path for path in exported.iterdir() if path.name.startswith(".")], words
