"""Finished runs that go on are what longer runs would have been."""

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene
from test_resuming import EVENTS, GROUPS, OUTPUTS, Stop, same_as_undisturbed, stop_at
from test_runner import tree

from crowdsim import files
from crowdsim.commands import running
from crowdsim.runs import stage
from crowdsim.runs.checkpoint import Pace
from crowdsim.runs.manifest import read_manifest


def write_scene_of(workplace: Path, duration: int, chunk: int) -> None:
    outputs = {**OUTPUTS, "take": {"chunk": chunk}}
    write_scene(workplace / "four.yaml", duration=duration, outputs=outputs, groups=GROUPS, events=EVENTS)


@pytest.mark.parametrize(("duration", "more", "chunk"), [(30, 20, 8), (32, 8, 8), (10, 40, 64), (45, 15, 64)])
def test_an_extended_run_is_what_a_longer_one_would_have_been(
    workplace: Path, capsys, duration: int, more: int, chunk: int
) -> None:
    write_scene_of(workplace, duration, chunk)
    assert crowdsim("run", "four.yaml", "--frames", str(duration + more), "--out", "undisturbed") == 0
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert crowdsim("run", "four.yaml", "--out", "run", "--extend", str(more)) == 0
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")
    assert crowdsim("verify", "run") == 0
    capsys.readouterr()
    assert crowdsim("run", "four.yaml", "--out", "run") == 2
    assert f"-duration: {duration + more}\n+duration: {duration}\n" in capsys.readouterr().err


def test_runs_are_extended_by_seconds_and_again(workplace: Path) -> None:
    write_scene(workplace / "four.yaml", duration=10)
    assert crowdsim("run", "four.yaml", "--frames", "50", "--out", "undisturbed") == 0
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert crowdsim("run", "four.yaml", "--out", "run", "--extend", "2s") == 0
    assert read_manifest(workplace / "run")["control_frames"] == 40
    assert crowdsim("run", "four.yaml", "--out", "run", "--extend", "10") == 0
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


@pytest.mark.parametrize("number", [None, signal.SIGTERM])
def test_an_extension_that_stopped_leaves_the_run_as_it_is_and_goes_on(
    workplace: Path, finish: Callable[..., None], monkeypatch, capsys, number: int | None
) -> None:
    monkeypatch.setattr(Pace, "is_due", lambda self, size: True)
    write_scene_of(workplace, 30, 8)
    finish(workplace, "--frames", "60", out="undisturbed")
    finish(workplace)
    before = tree(workplace / "run")
    extend = ("run", "four.yaml", "--out", "run", "--extend", "30")
    with monkeypatch.context() as patch:
        stop_at(patch, 40, number)
        if number is None:
            with pytest.raises(Stop):
                crowdsim(*extend)
        else:
            assert crowdsim(*extend) == 143
            assert "run: interrupted; the 48 of 60 control frames that were done are kept" in capsys.readouterr().err
    kept = {name: text for name, text in tree(workplace / "run").items() if not name.startswith(".")}
    assert kept == before
    assert crowdsim("verify", "run") == 0
    capsys.readouterr()
    assert crowdsim("status", "run") == 0
    assert f"extension {40 if number is None else 48} of 60" in capsys.readouterr().out
    assert crowdsim(*extend) == 0
    assert "continuing after" in capsys.readouterr().err
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


@pytest.mark.parametrize("moves", [0, 1, 7, 40])
def test_an_extension_that_stopped_while_it_took_its_place_is_completed_by_any_command(
    workplace: Path, finish: Callable[..., None], monkeypatch, moves: int
) -> None:
    write_scene_of(workplace, 30, 8)
    finish(workplace, "--frames", "60", out="undisturbed")
    finish(workplace)
    move, done = os.replace, []

    def replace(source, target, **named) -> None:
        if len(done) == moves:
            raise Stop
        done.append(target)
        move(source, target, **named)

    def put_all(*values) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(files.os, "replace", replace)
            put(*values)

    put = stage._put_in_place
    with monkeypatch.context() as patch:
        patch.setattr(stage, "_put_in_place", put_all)
        with pytest.raises(Stop):
            crowdsim("run", "four.yaml", "--out", "run", "--extend", "30")
    assert len(done) == moves
    assert crowdsim("verify", "run") == 0
    assert crowdsim("run", "four.yaml", "--out", "run", "--extend", "30") == 0
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


@pytest.mark.parametrize("then", [(), ("verify", "run"), ("export", "run", "--bvh", "--fps", "15")])
def test_an_extension_that_stopped_before_its_report_is_not_repeated(
    workplace: Path, monkeypatch, capsys, then: tuple[str, ...]
) -> None:
    write_scene(workplace / "four.yaml", duration=10)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    extend = ("run", "four.yaml", "--out", "run", "--extend", "10")

    def stop(*_: object) -> None:
        raise Stop

    with monkeypatch.context() as patch:
        patch.setattr(running, "_print_report", stop)
        with pytest.raises(Stop):
            crowdsim(*extend)
    assert read_manifest(workplace / "run")["control_frames"] == 20
    if then:
        assert crowdsim(*then) == 0
    assert crowdsim("verify", "run") == 0
    assert crowdsim(*extend) == 0
    assert "run: the extension that was interrupted is complete" in capsys.readouterr().err
    assert read_manifest(workplace / "run")["control_frames"] == 20
    assert not [path for path in (workplace / "run").iterdir() if path.name.startswith(".ext")]
    assert crowdsim(*extend) == 0
    assert read_manifest(workplace / "run")["control_frames"] == 30


def test_an_extension_that_stopped_behind_its_last_file_leaves_nothing(workplace: Path, monkeypatch) -> None:
    write_scene(workplace / "four.yaml", duration=10)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0

    def stop(*_: object) -> None:
        raise Stop

    with monkeypatch.context() as patch:
        patch.setattr(stage, "discard", stop)
        with pytest.raises(Stop):
            crowdsim("run", "four.yaml", "--out", "run", "--extend", "10")
    assert crowdsim("run", "four.yaml", "--out", "run", "--extend", "10") == 0
    assert read_manifest(workplace / "run")["control_frames"] == 20
    assert not [path for path in (workplace / "run").iterdir() if path.name.startswith(".")]


def test_what_cannot_be_extended_says_why(workplace: Path, monkeypatch, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs={"take": {"chunk": 8}})
    for words, message in (
        (("--out", "none"), "none: no such folder, expected a finished run to extend"),
        (("--force",), "run --extend: goes on with a finished run, expected neither --force nor --frames"),
    ):
        assert crowdsim("run", "four.yaml", "--extend", "5", *words) == 2
        assert capsys.readouterr().err == f"{message}\n"
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    before = tree(workplace / "run")
    capsys.readouterr()
    assert crowdsim("run", "four.yaml", "--out", "run", "--seed", "6", "--extend", "5") == 2
    assert capsys.readouterr().err.endswith("-seed: 5\n+seed: 6\n")
    recipe = workplace / "policies" / "tiny.yaml"
    recipe.write_text(recipe.read_text().replace("count: 6, fade", "count: 5, fade"))
    assert crowdsim("run", "four.yaml", "--out", "run", "--extend", "5") == 2
    result = capsys.readouterr().err.splitlines()
    assert "run: holds a run that cannot be extended, since something has changed; --force" in result[-2]
    assert result[-1].startswith("policy tiny: was ")
    assert tree(workplace / "run") == before
