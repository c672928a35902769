"""Runs from scenario to manifest, and everything that can go wrong on the way."""

import errno
import functools
import hashlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim, write_scene

import crowdsim as package
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.simulation import Simulation
from crowdsim.errors import RunError
from crowdsim.preparation import prepare as preparation
from crowdsim.preparation.prepare import load_policies
from crowdsim.runs import recording, runner
from crowdsim.runs.manifest import Verdict, read_manifest, verify, write_manifest
from crowdsim.runs.opening import open_run
from crowdsim.runs.runner import run, run_to
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.store import open_take
from crowdsim.take.take import VARIABLES

OUTPUTS = {"bvh": {"fps": 30}, "ply": {"fps": 30, "every": 20, "points": 500}}


def take_bytes(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted((folder / "take.zarr").rglob("*"))
        if path.is_file()
    }


def tree(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "manifest.json"
    }


def test_a_run_writes_take_outputs_and_a_manifest_and_reports_them(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs={**OUTPUTS, "profile": {}})
    assert crowdsim("run", "four.yaml", "--threads", "1") == 0
    folder = workplace / "output" / "four"
    names = {path.name for path in folder.iterdir()}
    expected = {"manifest.json", "scenario.resolved.yaml", "checkpoint.bin", "take.zarr", "bvh", "ply", "profile.csv"}
    assert names == expected
    result = read_manifest(folder)
    assert (result["status"], result["seed"], result["avatars"], result["control_frames"]) == ("done", 5, 4, 40)
    assert result["command"] == "crowdsim run four.yaml --threads 1"
    assert set(result["seconds"]) >= {"policies", "compile", "control", "take", "export", "total"}
    assert result["peak_memory_bytes"] > 10_000_000
    assert set(result["policies"]) == {"tiny"}
    assert set(result["files"]) == set(tree(folder))
    printed = capsys.readouterr().out
    assert len(printed.splitlines()) < 20
    for line in ("avatars         4\n", "control frames  40 (2.7 s)\n", "per avatar per minute\n",
                 "bvh             output/four/bvh (5 files, ", "ply             output/four/ply (5 files"):  # fmt: skip
        assert line in printed
    assert crowdsim("verify", "output/four") == 0


def test_the_resolved_scenario_runs_again_to_the_same_bytes(workplace: Path) -> None:
    (workplace / "in").mkdir()
    (workplace / "in" / "places.csv").write_text("-1,0\n1,0\n")
    groups = [
        {"name": "pair", "type": "boxer", "count": 2, "placement": {"kind": "points", "file": "places.csv"}},
    ]
    write_scene(workplace / "in" / "pair.yaml", groups=groups, opponents={"kind": "anyone"}, outputs=OUTPUTS)
    assert crowdsim("run", "in/pair.yaml", "--out", "first") == 0
    assert (workplace / "first" / "places.csv").read_text() == "-1,0\n1,0\n"
    assert crowdsim("run", "first/scenario.resolved.yaml", "--out", "second") == 0
    assert tree(workplace / "first") == tree(workplace / "second")


def test_takes_do_not_depend_on_threads(workplace: Path) -> None:
    path = write_scene(workplace / "four.yaml")
    for threads in (1, 2):
        run_to(workplace / f"by{threads}", load_scenario(path), threads)
    assert take_bytes(workplace / "by1") == take_bytes(workplace / "by2")


def test_takes_do_not_depend_on_the_search(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    for search in ("auto", "kd_tree", "scipy"):
        assert crowdsim("run", "four.yaml", "--search", search, "--out", search) == 0
        assert f"search: {search}" in (workplace / search / "scenario.resolved.yaml").read_text()
        assert take_bytes(workplace / search) == take_bytes(workplace / "auto")
    capsys.readouterr()
    for search, ran in (("auto", "direct"), ("kd_tree", "kd_tree")):
        assert crowdsim("profile", "four.yaml", "--frames", "3", "--search", search, "--json") == 0
        assert json.loads(capsys.readouterr().out)["profiles"][0]["search"] == ran
    assert crowdsim("run", "four.yaml", "--search", "kdtree", "--out", "no") == 2
    assert "expected 'auto', 'kd_tree' or 'scipy' (did you mean 'kd_tree'?)" in capsys.readouterr().err
    assert not (workplace / "no").exists()


def test_takes_do_not_depend_on_the_order_of_storage_and_python_runs_as_the_command_line_does(
    workplace: Path, monkeypatch
) -> None:
    path = write_scene(workplace / "four.yaml")
    scenario = package.load_scenario(path)
    policies = load_policies(scenario)
    plain = run(scenario, policies)
    with monkeypatch.context() as patch:
        patch.setattr(recording, "Simulation", functools.partial(Simulation, order=np.array([2, 0, 3, 1])))
        permuted = run(scenario, policies, threads=2)
    assert crowdsim("run", path, "--out", "written") == 0
    stored = open_take(workplace / "written")
    for take in (permuted, stored):
        for name in VARIABLES:
            assert getattr(plain, name)[:].tobytes() == getattr(take, name)[:].tobytes(), name
        for name in ("frame", "attacker", "victim", "hand", "point", "speed", "landed"):
            assert getattr(plain.events, name).tobytes() == getattr(take.events, name).tobytes(), name
    assert isinstance(plain.x, np.ndarray)
    assert plain.x.shape == (40, 4)


def test_a_finished_run_is_not_done_again_but_by_force(workplace: Path, finish, capsys) -> None:
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    manifest = workplace / "output" / "four" / "manifest.json"
    before = manifest.stat().st_mtime_ns
    capsys.readouterr()
    assert crowdsim("run", "four.yaml") == 0
    assert capsys.readouterr().out == "output/four: this run is done already; --force does it again\n"
    assert manifest.stat().st_mtime_ns == before
    assert crowdsim("run", "four.yaml", "--force") == 0
    assert manifest.stat().st_mtime_ns > before


def test_another_run_under_a_name_is_refused_with_the_difference(workplace: Path, finish, capsys) -> None:
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    before = tree(workplace / "output" / "four")
    capsys.readouterr()
    assert crowdsim("run", "four.yaml", "--seed", "6", "--set", "duration=50") == 2
    assert capsys.readouterr().err == (
        "output/four: holds another run; --force replaces it, --out names another folder\n"
        "--- run there\n+++ asked for\n@@ -4,2 +4,2 @@\n-seed: 5\n-duration: 40\n+seed: 6\n+duration: 50\n"
    )
    assert tree(workplace / "output" / "four") == before
    assert crowdsim("run", "four.yaml", "--seed", "6", "--force") == 0


def test_several_runs_do_not_hurt_each_other(workplace: Path, capsys) -> None:
    write_scene(workplace / "a.yaml", name="a")
    write_scene(workplace / "b.yaml", name="b", duration=-3)
    write_scene(workplace / "c.yaml", name="c")
    assert crowdsim("run", "a.yaml", "b.yaml", "c.yaml", "--out", "runs") == 1
    assert sorted(path.name for path in (workplace / "runs").iterdir()) == ["a", "c"]
    result = capsys.readouterr().err
    assert "\nb.yaml:4:11: duration: is -3, expected a whole number from 1 to 100000000" in result
    assert result.endswith("\n1 of 3 runs failed: b.yaml\n")


def test_foreign_folders_and_files_are_left_alone(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    (workplace / "mine" / "bvh").mkdir(parents=True)
    (workplace / "mine" / "bvh" / "capture.bvh").write_text("mine")
    (workplace / "file").write_text("mine")
    for out, message in (
        ("mine", "mine: holds 'bvh', which is no run's; expected an empty folder or a run's; --out names another\n"),
        ("file", "file: is a file, expected a folder for the run\n"),
        ("file/run", "file/run: cannot be made: file is a file\n"),
    ):
        for force in ((), ("--force",)):
            assert crowdsim("run", "four.yaml", "--out", out, *force) == 2
            assert capsys.readouterr().err == message
    assert (workplace / "mine" / "bvh" / "capture.bvh").read_text() == "mine"


def test_a_folder_in_use_by_another_run_is_refused_and_free_when_that_ends(workplace: Path, capsys) -> None:
    write_scene(workplace / "long.yaml", name="long", duration=50_000_000)
    process = start(workplace, "run", "long.yaml")
    wait_for(workplace / "output" / "long" / ".run.partial" / "take.zarr.partial" / "x" / "0.0", process)
    assert crowdsim("run", "long.yaml", "--frames", "20") == 2
    result = capsys.readouterr().err.splitlines()[-1]
    since = r"since \d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ \(crowdsim run long.yaml\)"
    who = rf"process {process.pid} on {re.escape(socket.gethostname())} {since}"
    assert re.fullmatch(f"output/long: is in use by {who}; wait for it, or name another with --out", result), result
    process.kill()
    process.communicate(timeout=60)
    assert crowdsim("run", "long.yaml", "--frames", "20", "--force") == 0


FOREIGN = {
    "parts": {".a.part": "mine", "b.part": "mine"},
    "video": {".video-0123456789abcdef/notes.txt": "mine"},
    "manifest": {"manifest.json": '{"format": "webapp"}', "bvh/capture.bvh": "mine", "video.mp4": "mine"},
    "broken manifest": {"manifest.json": "{", "frames/0.png": "mine"},
    "resolved": {"scenario.resolved.yaml": "mine", "bvh/capture.bvh": "mine"},
    "take": {"take.zarr/.zgroup": "{}", "take.zarr.partial/x/0.0": "mine"},
    "stage": {".run.partial/stage.json": '{"format": "crowdsim-stage", "key": "", "boot": ""}', "bvh/a.bvh": "x"},
    "stage without a note": {".run.partial/take.zarr/x/0.0": "mine"},
}


@pytest.mark.parametrize("force", [(), ("--force",)], ids=["plain", "force"])
@pytest.mark.parametrize("held", FOREIGN.values(), ids=FOREIGN)
def test_names_alone_do_not_make_a_folder_a_run(workplace: Path, capsys, held: dict, force: tuple) -> None:
    write_scene(workplace / "four.yaml")
    for name, text in held.items():
        (workplace / "mine" / name).parent.mkdir(parents=True, exist_ok=True)
        (workplace / "mine" / name).write_text(text)
    assert crowdsim("run", "four.yaml", "--out", "mine", *force) == 2
    said = capsys.readouterr().err
    assert "; --out names another\n" in said or "no command of crowdsim has made it; move it\n" in said
    assert {name: (workplace / "mine" / name).read_text() for name in held} == held
    assert sum(path.is_file() for path in (workplace / "mine").rglob("*")) == len(held)


def test_force_removes_only_what_the_run_has_written(workplace: Path, finish, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs=OUTPUTS)
    finish(workplace, out="output/four")
    folder = workplace / "output" / "four"
    mine = ["notes.txt", "bvh/mine.bvh", "frames/000000.png", "video.mp4", ".a.part", "take.part", ".video-1/a.mp4"]
    for name in mine:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("mine")
    assert crowdsim("run", "four.yaml", "--force", "--set", "outputs={}") == 0
    names = {name for name in tree(folder) if not name.startswith("take.zarr/")}
    assert names == {*mine, "scenario.resolved.yaml", "checkpoint.bin"}
    assert not (folder / "ply").exists()
    assert not set(mine) & set(read_manifest(folder)["files"])
    capsys.readouterr()
    assert crowdsim("verify", folder) == 0
    result = capsys.readouterr().err
    assert result == f"{folder}: not written by crowdsim: .a.part, .video-1/a.mp4, bvh/mine.bvh, ...\n"


@pytest.mark.parametrize(
    ("name", "found"),
    [("bvh/red_0.bvh", "bvh/red_0.bvh"), ("take.zarr/mine", "take.zarr/mine"), ("profile.csv/x", "profile.csv")],
)
def test_foreign_files_in_a_run_folder_stop_the_run_before_anything_is_removed(
    workplace: Path, finish, capsys, name: str, found: str
) -> None:
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    folder = workplace / "output" / "four"
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text("mine")
    before = tree(folder)
    write_scene(workplace / "four.yaml", outputs={"bvh": {"fps": 30}, "profile": {}})
    capsys.readouterr()
    assert crowdsim("run", "four.yaml", "--force") == 2
    assert capsys.readouterr().err == (
        f"output/four/{found}: is in the way of what is to be written, and no run has written it; move it, or name "
        "another folder with --out\n"
    )
    assert tree(folder) == before
    assert (folder / "manifest.json").exists()


def test_a_run_writes_nothing_through_a_link(workplace: Path, finish, capsys) -> None:
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    (workplace / "elsewhere").mkdir()
    (workplace / "output" / "four" / "bvh").symlink_to(workplace / "elsewhere")
    for words in (("run", "four.yaml", "--force", "--set", "outputs.bvh.fps=30"), ("export", "output/four", "--bvh")):
        capsys.readouterr()
        assert crowdsim(*words) == 2
        assert "output/four/bvh: is in the way of what is to be written" in capsys.readouterr().err
    assert list((workplace / "elsewhere").iterdir()) == []
    assert crowdsim("verify", "output/four") == 0


def test_a_resigned_manifest_removes_and_reads_nothing_outside(workplace: Path, finish, capsys) -> None:
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    folder = workplace / "output" / "four"
    (workplace / "victim").write_text("mine")
    result = read_manifest(folder)
    write_manifest(folder, {"status": "done"}, {**result["files"], "bvh/../../../victim": {"bytes": 4, "sha256": ""}})
    message = "manifest.json: names 'bvh/../../../victim', expected only files that a run writes inside "
    for words in (("export", "output/four", "--bvh"), ("verify", "output/four"), ("run", "four.yaml", "--force"),
                  ("render", "output/four", "--contact-sheet", "1", "--size", "64x48")):  # fmt: skip
        capsys.readouterr()
        assert crowdsim(*words) == 2
        assert message in capsys.readouterr().err
    assert (workplace / "victim").read_text() == "mine"
    assert not (folder / "bvh").exists()


def test_a_take_whose_names_lead_elsewhere_is_not_exported(workplace: Path, finish, capsys) -> None:
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    import zarr

    names = zarr.open_group(str(workplace / "output" / "four" / "take.zarr"), mode="r+")["name"]
    names[0] = "../x"
    capsys.readouterr()
    assert crowdsim("export", "output/four", "--bvh", "--out", "out") == 2
    assert "take.zarr: avatar 0 is named '../x', expected letters, digits" in capsys.readouterr().err
    assert not (workplace / "out").exists()


def test_a_scenario_that_reads_a_file_where_the_run_writes_is_refused(workplace: Path, capsys) -> None:
    (workplace / "bvh").mkdir()
    (workplace / "bvh" / "places.csv").write_text("-1,0\n1,0\n")
    placement = {"kind": "points", "file": "bvh/places.csv"}
    groups = [{"name": "pair", "type": "boxer", "count": 2, "placement": placement}]
    write_scene(workplace / "pair.yaml", groups=groups, opponents={"kind": "anyone"}, outputs=OUTPUTS)
    assert crowdsim("run", "pair.yaml", "--out", "run") == 2
    message = "reads 'bvh/places.csv', which would lie in run where the run writes; expected another file name"
    assert message in capsys.readouterr().err
    assert not (workplace / "run").exists()


def test_a_floor_plan_has_no_name_that_a_run_keeps_for_itself(workplace: Path, capsys) -> None:
    line = {"type": "LineString", "coordinates": [[5, -5], [5, 5]]}
    feature = {"type": "Feature", "properties": {}, "geometry": line}
    for name in ("stage.json", "manifest.json"):
        (workplace / name).write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
        write_scene(workplace / "four.yaml", obstacles={"file": name})
        assert crowdsim("run", "four.yaml", "--out", "run") == 2
        assert f"reads '{name}', which would lie in run where the run writes" in capsys.readouterr().err
        assert not (workplace / "run").exists()


def test_a_floor_plan_of_a_run_is_a_regular_file(workplace: Path, finish) -> None:
    line = {"type": "LineString", "coordinates": [[9, -9], [9, 9]]}
    feature = {"type": "Feature", "properties": {}, "geometry": line}
    (workplace / "plan.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    write_scene(workplace / "four.yaml", obstacles={"file": "plan.geojson"})
    finish(workplace)
    assert len(open_run(workplace / "run").obstacles) == 1
    plan = workplace / "run" / "plan.geojson"
    plan.unlink()
    os.mkfifo(plan)
    assert len(open_run(workplace / "run").obstacles) == 0
    plan.unlink()
    plan.symlink_to("/dev/zero")
    assert len(open_run(workplace / "run").obstacles) == 0


def test_the_plan_of_a_run_names_all_that_it_writes(workplace: Path, monkeypatch) -> None:
    pictures = {"fps": 30, "frames": [3, 9], "size": [64, 48], "png": True, "contact_sheet": 2, "camera": "side"}
    cloud = {"fps": 20, "frames": [5, 53], "every": 7, "points": 20}
    outputs = {**OUTPUTS, "pcd": cloud, "render": pictures, "profile": {"plots": True}}
    write_scene(workplace / "four.yaml", outputs=outputs)
    plans, refuse = [], runner.refuse_others
    monkeypatch.setattr(
        runner, "refuse_others", lambda base, plan, ledger: (plans.append(plan), refuse(base, plan, ledger))
    )
    assert crowdsim("run", "four.yaml") == 0
    written = set(read_manifest(workplace / "output" / "four")["files"])
    (plan,) = plans
    assert plan - {"manifest.json", "take.zarr"} == {name for name in written if not name.startswith("take.zarr/")}
    verdict = verify(workplace / "output" / "four")
    assert verdict == Verdict()


def test_all_that_export_and_render_write_into_a_run_is_verified(workplace: Path, finish, capsys) -> None:
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    folder = workplace / "output" / "four"
    small = ("--size", "64x48", "--frames", "0:4", "--camera", "side")
    assert crowdsim("export", folder, "--bvh", "--frames", "0:9") == 0
    assert crowdsim("render", folder, *small, "--mp4", "--png", "--contact-sheet", "2") == 0
    assert crowdsim("render", folder, *small, "--png", "--out", folder / "more") == 0
    assert crowdsim("render", folder / "bvh" / "red_0.bvh", *small, "--mp4") == 0
    assert crowdsim("export", folder, "--bvh", "--frames", "0:5") == 0
    capsys.readouterr()
    assert crowdsim("verify", folder) == 0
    assert capsys.readouterr().err == ""
    written = set(read_manifest(folder)["files"])
    assert written == set(tree(folder))
    assert {"video.mp4", "contact_sheet.png", "frames/000003.png", "more/frames/000003.png",
            "bvh/red_0/video.mp4"} <= written  # fmt: skip
    (folder / "video.mp4").write_bytes(b"changed")
    assert crowdsim("verify", folder) == 1
    assert "video.mp4: has 7 bytes, expected " in capsys.readouterr().err
    assert crowdsim("run", "four.yaml", "--force") == 0
    # What has changed since it was written may be worth something.
    left = {"scenario.resolved.yaml", "checkpoint.bin", "take.zarr", "video.mp4"}
    assert {name.split("/")[0] for name in tree(folder)} == left


def test_render_and_export_into_a_run_leave_files_of_others_alone(workplace: Path, finish, capsys) -> None:
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    folder = workplace / "output" / "four"
    (folder / "bvh").mkdir()
    for name in ("video.mp4", "bvh/blue_1.bvh"):
        (folder / name).write_text("mine")
    for words, name in (
        (("render", folder, "--size", "64x48", "--frames", "0:2"), "video.mp4"),
        (("export", folder, "--bvh", "--frames", "0:2"), "bvh/blue_1.bvh"),
    ):
        capsys.readouterr()
        assert crowdsim(*words) == 2
        assert f"{folder / name}: is in the way of what is to be written" in capsys.readouterr().err
        assert (folder / name).read_text() == "mine"
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_an_interrupted_rendering_is_distinguished_from_foreign_files(
    workplace: Path, finish, monkeypatch, capsys
) -> None:
    from crowdsim.render import batch

    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    folder = workplace / "output" / "four"
    small = ("--size", "64x48", "--frames", "0:6", "--camera", "side")
    words = ("render", folder, *small, "--png", "--mp4", "--threads", "1")
    with monkeypatch.context() as patch:
        patch.setattr(batch, "join", lambda *_: signal.raise_signal(signal.SIGINT))
        assert crowdsim(*words) == 130
    (folder / "notes.txt").write_text("mine")
    capsys.readouterr()
    assert crowdsim("verify", folder) == 0
    result = capsys.readouterr().err.splitlines()
    assert result[0] == f"{folder}: a command was not finished: .pictures.partial"
    assert result[1] == f"{folder}: not written by crowdsim: notes.txt"
    assert crowdsim(*words) == 0
    capsys.readouterr()
    assert crowdsim("verify", folder) == 0
    assert capsys.readouterr().err == f"{folder}: not written by crowdsim: notes.txt\n"
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]


def test_what_the_system_refuses_names_the_path_and_ends_with_1(workplace: Path, monkeypatch, capsys) -> None:
    from crowdsim.crowd import profile_files

    write_scene(workplace / "four.yaml", outputs={"profile": {}})

    def full(source: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        files = profile_files.os
        patch.setattr(files, "replace", lambda *paths: full(*paths) if "csv" in str(paths[0]) else move(*paths))
        move = os.rename
        assert crowdsim("run", "four.yaml") == 1
    message = "output/four/.run.partial/profile.csv: cannot be written: No space left on device"
    assert capsys.readouterr().err.splitlines()[-1] == message
    assert not [path for path in (workplace / "output" / "four").rglob("*") if path.name.endswith(".part")]


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser writes anywhere")
def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_done(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    (workplace / "locked").mkdir(mode=0o555)
    assert crowdsim("run", "four.yaml", "--out", "locked/run") == 2
    message = "locked/run: cannot be written, expected a folder with write permission\n"
    assert capsys.readouterr().err == message


def crowd(count: int, radius: float = 5.0) -> dict:
    placement = {"kind": "disc", "radius": radius, "distance": 0.5}
    return {
        "groups": [{"name": "all", "type": "boxer", "count": count, "placement": placement}],
        "opponents": {"kind": "anyone"},
    }


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (crowd(0), "four.yaml:11:10: groups[0].count: is 0, expected a whole number from 1 to 10000000"),
        (
            crowd(1),
            "four.yaml:17:3: opponents: there is one avatar without an opponent, expected a second avatar or a "
            "scripted target",
        ),
        (
            crowd(10_000_001),
            "four.yaml:11:10: groups[0].count: is 10000001, expected a whole number from 1 to 10000000",
        ),
        (
            {**crowd(9), "opponents": {"kind": "other_team"}},
            "four.yaml:17:9: opponents.kind: is 'other_team', but all avatars are of team 'one', expected a second "
            "team or kind 'anyone'",
        ),
        (
            crowd(1_000_000, 1.0),
            "four.yaml:13:5: groups[0].placement: 10 of 1000000 avatars fit in a disc of radius 1 m at least 0.5 m "
            "apart, expected a radius of about 354 m, a smaller distance or fewer avatars",
        ),
        (
            {"types": {"boxer": {"policy": "tiny", "behaviours": {"aproach": 2}}}},
            "four.yaml:9:16: types.boxer.behaviours.aproach: policy 'tiny' has no such behaviour (did you mean "
            "'approach'?); it has approach, punch",
        ),
        (
            {"types": {"boxer": {"policy": "tinny"}}},
            "four.yaml:7:13: types.boxer.policy: is 'tinny', no known policy, expected boxer, boxer_cmu, "
            "boxer_crowd, boxer_defender, boxer_paper, stick_fighter or tiny (did you mean 'tiny'?)",
        ),
    ],
)  # fmt: skip
def test_scenarios_that_cannot_be_run_end_with_2_and_nothing_made(workplace: Path, capsys, changes, message) -> None:
    write_scene(workplace / "four.yaml", **changes)
    held = sorted(workplace.rglob("*"))
    for word in ("run", "validate"):
        assert crowdsim(word, "four.yaml") == 2
        assert capsys.readouterr().err == f"{message}\n", word
    assert sorted(workplace.rglob("*")) == held


def test_missing_capture_is_named_and_nothing_is_made(workplace: Path, capsys) -> None:
    # The recipe under another name, since the one that ships may have been trained already.
    recipe = Path(__file__).parents[2] / "policies" / "boxer_cmu.yaml"
    shutil.copy(recipe, workplace / "policies" / "captured.yaml")
    write_scene(workplace / "four.yaml", types={"boxer": {"policy": "captured"}})
    assert crowdsim("run", "four.yaml") == 2
    assert "CROWDSIM_MOCAP" in capsys.readouterr().err
    assert not (workplace / "output").exists()


def test_damaged_and_foreign_bundles_are_refused_and_stale_ones_trained_again(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    bundle = workplace / "policies" / "tiny"
    values = bundle / "values.npy"
    whole = values.read_bytes()
    values.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    assert crowdsim("run", "four.yaml") == 2
    assert capsys.readouterr().err.endswith(
        "policies/tiny/values.npy: damaged: its SHA-256 is not the one in policy.json; train the policy again\n"
    )
    assert not (workplace / "output").exists()
    values.write_bytes(whole)
    document = (bundle / "policy.json").read_text()
    (bundle / "policy.json").write_text('{"kind": "something else"}')
    assert crowdsim("run", "four.yaml") == 2
    assert capsys.readouterr().err.endswith("policies/tiny/policy.json: foreign: its kind is not 'crowdsim policy'\n")
    (bundle / "policy.json").write_text(document)
    assert crowdsim("run", "four.yaml") == 0
    recipe = workplace / "policies" / "tiny.yaml"
    recipe.write_text(recipe.read_text().replace("count: 6, fade", "count: 5, fade"))
    capsys.readouterr()
    assert crowdsim("run", "four.yaml") == 0
    assert "done already" in capsys.readouterr().out
    assert crowdsim("run", "four.yaml", "--force") == 0
    assert json.loads((bundle / "policy.json").read_text())["fingerprint"] != json.loads(document)["fingerprint"]
    assert crowdsim("verify", "output/four") == 0


def test_a_finished_run_reports_policies_trained_since(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    assert crowdsim("run", "four.yaml") == 0
    recipe = workplace / "policies" / "tiny.yaml"
    recipe.write_text(recipe.read_text().replace("count: 6, fade", "count: 5, fade"))
    assert crowdsim("train", "tiny") == 0
    capsys.readouterr()
    assert crowdsim("run", "four.yaml") == 0
    result = capsys.readouterr()
    assert result.err == "output/four: policy 'tiny' has been trained again since; --force runs with it\n"
    assert crowdsim("export", "output/four", "--bvh") == 2
    assert "is not the one that the take was recorded with" in capsys.readouterr().err


def test_values_that_are_no_numbers_name_avatar_and_frame_and_leave_no_take(workplace: Path) -> None:
    path = write_scene(workplace / "four.yaml")
    scenario = load_scenario(path)
    policies = load_policies(scenario)
    policies[0].values[:] = np.nan
    with pytest.raises(RunError, match=r"^avatar 0 at control frame 0: "):
        run(scenario, policies)


def test_policies_of_one_run_share_a_control_rate(workplace: Path) -> None:
    text = (workplace / "policies" / "tiny.yaml").read_text()
    (workplace / "policies" / "slow.yaml").write_text(f"control_rate: 10\n{text}")
    types = {"boxer": {"policy": "tiny"}, "slow": {"policy": "slow"}}
    path = write_scene(workplace / "four.yaml", types=types)
    scenario = load_scenario(path, ["groups[0].type=slow"])
    with pytest.raises(RunError, match="four: policies of one run need one control rate, but tiny has 15, slow has 10"):
        draw_crowd(scenario, load_policies(scenario))


def start(workplace: Path, *arguments: str) -> subprocess.Popen:
    program = "from crowdsim.cli import main; main()"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(
        [sys.executable, "-c", program, *arguments], cwd=workplace, env=environment, stderr=subprocess.PIPE, text=True
    )


def wait_for(path: Path, process: subprocess.Popen) -> None:
    for _ in range(6000):
        if path.exists():
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    raise AssertionError(f"{path} does not come")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_keeps_its_frames_and_reports_it(workplace: Path, capsys, number: int, code: int) -> None:
    write_scene(workplace / "long.yaml", name="long", duration=50_000_000, outputs={"bvh": {"fps": 30}})
    process = start(workplace, "run", "long.yaml")
    wait_for(workplace / "output" / "long" / ".run.partial" / "take.zarr.partial" / "x" / "0.0", process)
    process.send_signal(number)
    _, error = process.communicate(timeout=60)
    assert process.returncode == code
    assert "output/long: interrupted; the " in error
    take = open_take(workplace / "output" / "long")
    assert take.status == "interrupted"
    assert take.frame_count >= 64
    assert np.isfinite(take.x[:]).all()
    assert error.endswith("control frames that were done are kept; the same command goes on from there\n")
    folder = workplace / "output" / "long"
    assert [path.name for path in folder.iterdir()] == [".run.partial"]
    assert sorted(path.name for path in (folder / ".run.partial").iterdir()) == [
        "checkpoint.bin",
        "scenario.resolved.yaml",
        "stage.json",
        "take.zarr",
    ]
    kept = tree(folder)
    for more, old, new in (
        (("--frames", "20"), "duration: 50000000", "duration: 20"),
        (("--seed", "6"), "seed: 5", "seed: 6"),
    ):
        assert crowdsim("run", "long.yaml", *more) == 2
        result = capsys.readouterr().err.splitlines()
        what = "holds an unfinished run of another scenario; --force replaces it, --out names another folder"
        assert result[0] == f"output/long: {what}"
        assert result[-2:] == [f"-{old}", f"+{new}"]
        assert tree(folder) == kept
    assert crowdsim("export", "output/long", "--bvh", "--frames", "0:30") == 0
    assert "output/long: the run was interrupted; " in capsys.readouterr().err
    assert crowdsim("verify", "output/long") == 2
    assert capsys.readouterr().err == "output/long: no manifest.json here, so this is no finished run\n"
    (folder / "bvh" / "mine.bvh").write_text("mine")
    assert crowdsim("run", "long.yaml", "--frames", "20", "--force", "--set", "outputs={}") == 0
    assert list((folder / "bvh").iterdir()) == [folder / "bvh" / "mine.bvh"]
    assert crowdsim("verify", "output/long") == 0


def test_a_killed_run_leaves_nothing_under_a_final_name_and_the_next_one_reports_it(workplace: Path, capsys) -> None:
    write_scene(workplace / "long.yaml", name="long", duration=50_000_000)
    process = start(workplace, "run", "long.yaml")
    wait_for(workplace / "output" / "long" / ".run.partial" / "take.zarr.partial" / "x" / "0.0", process)
    process.kill()
    process.wait(timeout=60)
    process.stderr.close()
    folder = workplace / "output" / "long"
    stage = folder / ".run.partial"
    assert {path.name for path in folder.iterdir()} == {".crowdsim-lock.json", ".run.partial"}
    names = {"stage.json", "scenario.resolved.yaml", "take.zarr.partial"}
    assert {path.name for path in stage.iterdir()} - {".checkpoint.bin.part", "checkpoint.bin"} == names
    assert crowdsim("export", "output/long", "--bvh") == 2
    assert "only what a run left that was killed; run its scenario again" in capsys.readouterr().err
    assert crowdsim("run", "long.yaml", "--set", "duration=20") == 2
    assert "holds an unfinished run of another scenario; --force replaces it" in capsys.readouterr().err
    (stage / "take.zarr.partial" / ".zattrs.0123456789abcdef0123456789abcdef.partial").write_text("half")
    (stage / ".scenario.resolved.yaml.part").write_text("half")
    assert crowdsim("run", "long.yaml", "--set", "duration=20", "--force") == 0
    assert crowdsim("verify", "output/long") == 0
    assert not [path for path in folder.iterdir() if "part" in path.name]


def test_an_interrupt_while_outputs_are_written_keeps_the_take(workplace: Path, monkeypatch, capsys) -> None:
    import crowdsim.export.stream as stream

    write_scene(workplace / "four.yaml", outputs=OUTPUTS)
    monkeypatch.setattr(stream, "_POSES_AT_ONCE", 40)
    write, calls = stream._stream, []

    def signalled(sampler, fps, sinks, pool, progress):
        def report(*result):
            calls.append(result)
            os.kill(os.getpid(), signal.SIGINT) if len(calls) == 3 else None
            progress(*result)

        return write(sampler, fps, sinks, pool, report)

    monkeypatch.setattr(stream, "_stream", signalled)
    assert crowdsim("run", "four.yaml") == 130
    folder = workplace / "output" / "four"
    assert open_take(folder).status == "done"
    assert not (folder / "manifest.json").exists()
    assert not [path for path in folder.rglob("*") if path.name.endswith(".part") or ".part." in path.name]
    told = "output/four: interrupted; the take is finished, outputs are missing; the same command goes on from there\n"
    assert capsys.readouterr().err.endswith(told)


@pytest.mark.slow
def test_a_full_disk_is_an_error_that_leaves_nothing_half_written(workplace: Path) -> None:
    resource = pytest.importorskip("resource")
    write_scene(workplace / "four.yaml", outputs=OUTPUTS)
    program = (
        "import resource, sys\n"
        "from crowdsim.scenario.scenario import load_scenario\n"
        "from crowdsim.runs.runner import run_to\n"
        "from pathlib import Path\n"
        "run_to(Path('warm'), load_scenario('four.yaml'), force=True)\n"
        "sys.dont_write_bytecode = True\n"  # one that is cut off would be kept as if it were whole
        "resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2)\n"
        "from crowdsim.cli import main\n"
        "main()\n"
    )
    assert resource
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_DISABLE_PERFORMANCE_WARNINGS": "1"}
    # So much fits: a scenario but no take, a take but no BVH, all but a whole cloud.
    for limit, path in ((2000, "checkpoint.bin"), (47_500, "bvh/"), (60_000, "ply/000000.ply")):
        done = subprocess.run(
            [sys.executable, "-c", program, str(limit), "run", "four.yaml", "--force"],
            cwd=workplace, env=environment, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 1, done.stderr
        assert done.stderr.splitlines()[-1].startswith(f"output/four/.run.partial/{path}")
        assert "cannot be written: " in done.stderr.splitlines()[-1]
        folder = workplace / "output" / "four"
        assert not (folder / "manifest.json").exists()
        assert not [path for path in folder.rglob("*") if path.name.endswith(".part") or ".part." in path.name]
        shutil.rmtree(folder)


def test_status_distinguishes_finished_runs_from_others(workplace: Path, capsys) -> None:
    write_scene(workplace / "a.yaml", name="a")
    write_scene(workplace / "b.yaml", name="b")
    assert crowdsim("run", "a.yaml", "b.yaml") == 0
    (workplace / "output" / "b" / "manifest.json").unlink()
    (workplace / "output" / "other").mkdir()
    capsys.readouterr()
    assert crowdsim("status", "output") == 0
    assert capsys.readouterr().out == (
        "done         output/a  4 avatars, 40 control frames\nunfinished   output/b  4 avatars, 40 control frames\n"
    )
    assert crowdsim("status", "output/a", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["output/a"].pop("seconds") > 0
    assert result == {"output/a": {"state": "done", "avatars": 4, "control_frames": 40, "outputs": {}}}
    assert crowdsim("status", "policies") == 2
    assert capsys.readouterr().err == "policies: holds no run\n"


def test_status_fails_where_a_run_is_damaged(workplace: Path, capsys) -> None:
    write_scene(workplace / "a.yaml", name="a")
    write_scene(workplace / "b.yaml", name="b")
    assert crowdsim("run", "a.yaml", "b.yaml") == 0
    (workplace / "output" / "b" / "manifest.json").write_text("{")
    for options in ([], ["--json"]):
        assert crowdsim("status", "output/a", *options) == 0
        capsys.readouterr()
        assert crowdsim("status", "output", *options) == 1
        out = capsys.readouterr().out
        assert "damaged" in out
        assert "output/b/manifest.json" in out
    # A take without a manifest whose metadata is damaged.
    (workplace / "output" / "b" / "manifest.json").unlink()
    (workplace / "output" / "b" / "take.zarr" / ".zattrs").write_text("[]")
    assert crowdsim("status", "output/b") == 1


def test_the_needs_of_a_large_crowd_are_reported_beforehand(tmp_path, monkeypatch):
    result = preparation.needs(1_000_000, 60, tmp_path / "not" / "there")
    assert re.fullmatch(
        r"1,000,000 avatars x 60 control frames take up to 2\.0 GB of memory and 1\.2 GB on disk, without outputs.*",
        result,
    )
    monkeypatch.setattr(preparation, "available_memory", lambda: 10**9)
    short = preparation.needs(1_000_000, 10**7, tmp_path)
    assert "; only 1.0 GB of memory are free; only " in short
    assert short.endswith(f" GB are free in {tmp_path}")


def test_needs_are_reported_only_of_large_crowds(workplace, monkeypatch):
    scenario = load_scenario(write_scene(workplace / "four.yaml"))
    result = []
    run_to(workplace / "quiet", scenario, notify=result.append)
    assert result == []
    monkeypatch.setattr(runner, "LARGE", 4)
    run_to(workplace / "loud", scenario, notify=result.append)
    assert [words.split(" take ")[0] for words in result] == ["4 avatars x 40 control frames"]
