"""Batches done by the workers of a scheduler: files as of single commands, nothing done twice, one report."""

import json
import re
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from batches import digests, write_batch
from scenes import crowdsim

import crowdsim as package
from crowdsim.batch.plan import read_plan
from crowdsim.runs.checkpoint import read_checkpoint
from crowdsim.runs.manifest import read_manifest, verify

OUTPUTS = {
    "bvh": {"fps": 30},
    "ply": {"fps": 15, "every": 4, "points": 20},
    "render": {"fps": 10, "size": [32, 24], "png": True, "contact_sheet": 2, "camera": "side"},
}


def test_a_batch_writes_what_single_commands_write(workplace: Path, scheduler: str, capsys) -> None:
    write_batch(workplace, axes=[{"seed": [3]}], outputs=OUTPUTS)
    assert crowdsim("batch", "trial.yaml", "--out", "all", "--scheduler", scheduler) == 0
    assert "1: 1 done, 0 failed" in capsys.readouterr().out
    (run,) = (workplace / "all" / "runs").iterdir()
    assert not verify(run).findings
    assert not verify(run).foreign
    single = workplace / "single"
    frozen = next((workplace / "all" / "scenarios").glob("*/scenario.resolved.yaml"))
    assert crowdsim("run", frozen, "--out", single, "--threads", "1") == 0
    assert crowdsim("export", single, "--bvh", "--fps", "30", "--threads", "1") == 0
    assert crowdsim("export", single, "--ply", "--fps", "15", "--every", "4", "--points", "20", "--threads", "1") == 0
    how = ["--size", "32x24", "--fps", "10", "--png", "--mp4", "--contact-sheet", "2", "--camera", "side"]
    assert crowdsim("render", single, *how, "--threads", "1") == 0
    one, other = read_manifest(run), read_manifest(single)
    assert one["files"] == other["files"]
    assert set(one["exports"]) == {"bvh", "ply", "pictures"}
    assert not (workplace / "all" / "work").exists() or not list((workplace / "all" / "work").iterdir())
    assert {"video.mp4", "contact_sheet.png", "frames/000000.png"} <= set(one["files"])


def test_what_differs_from_a_run_with_outputs_is_the_scenario_without_them(workplace: Path, scheduler: str) -> None:
    write_batch(workplace, {"outputs": OUTPUTS}, axes=[{"seed": [3]}])
    assert crowdsim("batch", "trial.yaml", "--out", "all", "--scheduler", scheduler) == 0
    assert crowdsim("run", "four.yaml", "--seed", "3", "--out", "single/runs/one", "--threads", "1") == 0
    (batched,), (single,) = digests(workplace / "all").values(), digests(workplace / "single").values()
    assert batched.keys() == single.keys()
    assert {name for name in single if single[name] != batched[name]} == {"checkpoint.bin", "scenario.resolved.yaml"}
    (one,), other = (workplace / "all" / "runs").iterdir(), workplace / "single" / "runs" / "one"
    scenarios = [yaml.safe_load((folder / "scenario.resolved.yaml").read_text()) for folder in (one, other)]
    without, whole = (scenario.pop("outputs") for scenario in scenarios)
    assert scenarios[0] == scenarios[1]
    assert without == {key: whole[key] for key in ("take", "profile") if key in whole}
    checkpoints = [read_checkpoint(folder, 100, 1_000_000) for folder in (one, other)]
    assert checkpoints[0].origin != checkpoints[1].origin
    for part in ("simulation", "take"):
        arrays = [getattr(checkpoint, part) for checkpoint in checkpoints]
        assert arrays[0].keys() == arrays[1].keys()
        assert all(np.array_equal(arrays[0][name], arrays[1][name]) for name in arrays[0])
    manifests = [read_manifest(folder) for folder in (one, other)]
    names = {name for name in manifests[0].keys() | manifests[1] if manifests[0].get(name) != manifests[1].get(name)}
    assert names - {"command", "seconds", "peak_memory_bytes", "checksum"} == {"exports", "files", "policy_folders"}
    assert (set(manifests[0]["exports"]), manifests[1].get("exports", {})) == ({"bvh", "ply", "pictures"}, {})


def test_finished_runs_are_not_repeated_and_a_new_value_runs_only_what_is_new(
    workplace: Path, scheduler: str, capsys
) -> None:
    write_batch(workplace, axes=[{"seed": [1, 2]}, {"duration": [20]}])
    command = ("batch", "trial.yaml", "--out", "all", "--scheduler", scheduler)
    assert crowdsim(*command) == 0
    times = {path: path.stat().st_mtime_ns for path in (workplace / "all" / "runs").glob("*/manifest.json")}
    assert crowdsim(*command) == 0
    assert "2: 0 done, 2 before" in capsys.readouterr().out
    write_batch(workplace, axes=[{"duration": [20]}, {"seed": [3, 2, 1]}])
    assert crowdsim(*command) == 0
    assert "3: 1 done, 2 before" in capsys.readouterr().out
    assert all(path.stat().st_mtime_ns == time for path, time in times.items())
    write_batch(workplace, axes=[{"seed": [3, 2, 1]}, {"duration": [20]}], outputs={"bvh": {"fps": 15}})
    takes = {path: path.stat().st_mtime_ns for path in (workplace / "all" / "runs").glob("*/take.zarr/x/0.0")}
    assert crowdsim(*command) == 0
    assert "3: 3 done, 0 failed" in capsys.readouterr().out
    assert len(list((workplace / "all" / "runs").glob("*/bvh/*.bvh"))) == 12
    assert all(path.stat().st_mtime_ns == time for path, time in takes.items())
    shutil.rmtree(next((workplace / "all" / "runs").iterdir()))
    assert crowdsim(*command) == 0
    assert "3: 1 done, 2 before" in capsys.readouterr().out


def test_a_report_and_one_dataset_hold_all_runs(workplace: Path, scheduler: str, capsys) -> None:
    axes = [{"seed": "0:2"}, {"duration": [20, 30], "groups[0].count": [1, 2]}]
    write_batch(workplace, axes=axes, exclude=[{"seed": 1, "duration": 30}])
    assert crowdsim("batch", "trial.yaml", "--scheduler", scheduler, "--out", "all", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["runs"], document["done"], document["failures"]) == (3, 3, {})
    data = package.open_batch(workplace / "all", ["x"])
    assert dict(data.sizes) == {"seed": 2, "duration": 2, "frame": 30, "avatar": 4}
    assert data["groups[0].count"].dims == ("duration",)
    assert data.state.values.tolist() == [["done", "done"], ["done", ""]]
    assert data.avatars.sel(seed=0).values.tolist() == [3, 4]
    assert np.isnan(data.hits_per_minute_per_avatar.sel(seed=1, duration=30))
    take = package.open_take(workplace / "all" / data.folder.sel(seed=0, duration=30).item())
    np.testing.assert_array_equal(data.x.sel(seed=0, duration=30), take.x[:])
    page = (workplace / "all" / "report" / "index.html").read_text(encoding="utf-8")
    assert page.count("<svg") >= 2
    assert page.count("data:image/png;base64,") == 3
    assert "http" not in page.replace("http-equiv", "")
    table = (workplace / "all" / "report" / "summary.csv").read_text(encoding="utf-8").splitlines()
    assert len(table) == 4
    assert (workplace / "all" / "report" / "summary.parquet").is_file()


def test_status_recognises_a_batch(workplace: Path, scheduler: str, capsys) -> None:
    write_batch(workplace, axes=[{"seed": "0:2"}])
    assert crowdsim("batch", "trial.yaml", "--scheduler", scheduler, "--out", "all", "--quiet") == 0
    assert crowdsim("status", "all", "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["state"], facts["total"], facts["done"]) == ("done", 2, 2)
    assert [run["values"]["seed"] for run in facts["runs"].values()] == [0, 1]
    (workplace / "all" / "results" / f"{next(iter(read_plan(workplace / 'all').runs))}.json").unlink()
    assert crowdsim("status", "all") == 0
    assert capsys.readouterr().out.startswith("interrupted  all  1 done")


def test_an_interrupted_run_goes_on_and_a_changed_policy_is_refused(workplace: Path, scheduler: str, capsys) -> None:
    write_batch(workplace, {"duration": 40, "outputs": {"take": {"chunk": 8}}}, axes=[{"seed": [7]}])
    command = ("batch", "trial.yaml", "--scheduler", scheduler)
    assert crowdsim(*command, "--out", "all") == 0
    assert crowdsim(*command, "--out", "again") == 0
    assert digests(workplace / "all") == digests(workplace / "again")
    recipe = workplace / "policies" / "tiny.yaml"
    changed = yaml.safe_load(recipe.read_text(encoding="utf-8"))
    changed["motion"]["performer"]["seed"] = 3
    recipe.write_text(yaml.safe_dump(changed), encoding="utf-8")
    capsys.readouterr()
    assert crowdsim(*command, "--out", "all") == 2
    said = capsys.readouterr().err
    assert "holds a batch that cannot be continued, since something has changed" in said
    assert "policy tiny: was " in said


def test_a_folder_that_is_no_batch_is_refused(workplace: Path, capsys) -> None:
    write_batch(workplace)
    (workplace / "mine").mkdir()
    (workplace / "mine" / "notes.txt").write_text("mine")
    assert crowdsim("batch", "trial.yaml", "--out", "mine") == 2
    assert "holds 'notes.txt', which is no batch's" in capsys.readouterr().err
    assert crowdsim("batch", "trial.yaml", "--out", "mine/notes.txt") == 2
    assert "is a file" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "tcp://10.255.255.1:8786", "nowhere"])
def test_a_scheduler_that_does_not_answer_is_reported_in_time(workplace: Path, capsys, address: str) -> None:
    write_batch(workplace)
    since = time.monotonic()
    assert crowdsim("batch", "trial.yaml", "--scheduler", address, "--insecure", "--out", "all") == 2
    assert time.monotonic() - since < 10
    assert f"--scheduler {address}: no scheduler answers there" in capsys.readouterr().err
    assert not (workplace / "all").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["four.yaml", "--timeout", "soon"], "timeout 'soon': expected a time above 0"),
        (["four.yaml", "--memory", "much"], "memory 'much': expected a size"),
        (["four.yaml", "--scheduler", "tcp://a:1", "--jobs", "2"], "expected neither --jobs nor --memory"),
        (["trial.yaml", "--seeds", "0:3"], "expected neither --seeds nor --sweep"),
        (["trial.yaml", "four.yaml"], "is a batch file, expected it alone"),
    ],
)
def test_options_that_do_not_fit_are_refused(workplace: Path, capsys, words: list[str], said: str) -> None:
    write_batch(workplace)
    assert crowdsim("batch", *words) == 2
    assert said in capsys.readouterr().err


def test_the_report_of_a_batch_links_to_those_of_its_runs(workplace: Path, scheduler: str) -> None:
    write_batch(workplace, scene={"outputs": {"report": {"player": False}}}, axes=[{"seed": "0:2"}])
    assert crowdsim("batch", "trial.yaml", "--scheduler", scheduler, "--out", "all", "--quiet") == 0
    page = (workplace / "all" / "report" / "index.html").read_text(encoding="utf-8")
    links = re.findall(r'href="([^"]+)"', page)
    assert len(links) == 2
    for link in links:
        assert (workplace / "all" / "report" / link).resolve().is_file()
