"""The plan of a batch: what it holds, what it estimates, and how it is read again."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import pytest
from batches import write_batch
from scenes import crowdsim

from crowdsim.batch.description import MAXIMUM_RUNS, batch_of_options, load_batch, with_overrides
from crowdsim.batch.documents import MAXIMUM_BYTES
from crowdsim.batch.plan import NAME, Plan, PlannedRun, check_disk, estimate, read_plan, write_plan
from crowdsim.batch.running import frame_ranges, plan_batch
from crowdsim.errors import BatchError
from crowdsim.outputs.bvh import BvhOutput
from crowdsim.outputs.csv import CsvOutput
from crowdsim.outputs.ply import PlyOutput
from crowdsim.outputs.render import RenderOutput
from crowdsim.scenario.output import Extent
from crowdsim.scenario.outputs import Outputs

AXES = [{"seed": "0:3"}, {"duration": [20, 30]}]


def test_a_dry_run_lists_the_runs_and_what_they_take_and_writes_nothing(workplace: Path, capsys) -> None:
    write_batch(workplace, axes=AXES, outputs={"bvh": {"fps": 30}})
    before = sorted(path.name for path in workplace.iterdir())
    assert crowdsim("batch", "trial.yaml", "--dry-run", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert [run["values"]["seed"] for run in report["runs"]] == [0, 0, 1, 1, 2, 2]
    assert [run["control_frames"] for run in report["runs"]] == [20, 30] * 3
    assert {(run["avatars"], run["done"]) for run in report["runs"]} == {(4, False)}
    assert all(run["bytes"] > 4 * 38 * 600 and run["memory_bytes"] > 1e8 for run in report["runs"])
    assert all(run["minutes"] > 0 for run in report["runs"])
    assert crowdsim("batch", "trial.yaml", "--dry-run") == 0
    assert "6 of 6 runs to do: " in capsys.readouterr().out
    assert sorted(path.name for path in workplace.iterdir()) == before


def test_values_that_are_set_are_those_of_all_runs_and_in_the_plan(workplace: Path, capsys) -> None:
    write_batch(workplace, axes=AXES[:1])
    assert (
        crowdsim("batch", "trial.yaml", "--dry-run", "--json", "--set", "duration=7", "--set", "groups[0].count=1") == 0
    )
    report = json.loads(capsys.readouterr().out)
    assert [(run["control_frames"], run["avatars"]) for run in report["runs"]] == [(7, 3)] * 3
    assert crowdsim("batch", "four.yaml", "--dry-run", "--json", "--seeds", "0:3", "--set", "duration=7") == 0
    others = json.loads(capsys.readouterr().out)
    assert {run["run"] for run in report["runs"]}.isdisjoint(run["run"] for run in others["runs"])
    assert crowdsim("batch", "trial.yaml", "--dry-run", "--set", "duraton=7") == 2
    assert capsys.readouterr().err.startswith("--set duraton=7: duraton: unknown key")
    plan, _ = plan_batch(workplace / "out", with_overrides(load_batch(workplace / "trial.yaml"), ["duration=7"]))
    folder = workplace / "kept"
    folder.mkdir()
    write_plan(folder, replace(plan, environment={"versions": {}, "processor": "Abacus"}))
    assert read_plan(folder).batch.set == ("duration=7",)


def test_runs_that_the_disk_cannot_hold_are_refused(workplace: Path, capsys) -> None:
    scene = {"duration": 100_000_000, "outputs": {"ply": {"points": 100_000}}}
    write_batch(workplace, scene, axes=[{"seed": "0:100"}])
    assert crowdsim("batch", "trial.yaml", "--dry-run") == 2
    said = capsys.readouterr().err
    assert "the runs take about " in said
    assert "GB are free in " in said
    assert not (workplace / "output").exists()


def test_a_plan_is_read_as_it_was_written(workplace: Path) -> None:
    outputs = {"bvh": {"avatars": [0, 2]}, "render": {"fps": 10, "frames": [0, 12]}}
    plan, _ = plan_batch(workplace / "out", load_batch(write_batch(workplace, axes=AXES, outputs=outputs)))
    folder = workplace / "kept"
    folder.mkdir()
    plan = replace(plan, environment={"versions": {"numpy": "2"}, "processor": "Abacus"}, policies={"tiny": "0" * 64})
    write_plan(folder, plan)
    read = read_plan(folder)
    assert replace(read, batch=plan.batch) == plan
    assert read.batch.model_dump() == plan.batch.model_dump()
    assert [run.mark for run in read.runs.values()] == [run.mark for run in plan.runs.values()]


def test_a_plan_of_as_many_runs_as_there_may_be_is_read_again_and_a_longer_one_not_written(tmp_path: Path) -> None:
    batch = batch_of_options(["four.yaml"], f"0:{MAXIMUM_RUNS}", ["duration=20"])
    one, count = run_of(20, Outputs(render=RenderOutput())), itertools.count()
    ids = {f"{number:016x}": number for number in range(MAXIMUM_RUNS)}
    runs = {id: replace(one, id=id, seed=number) for id, number in ids.items()}
    pairs = tuple((each, f"{next(count):016x}") for each in batch.combinations())
    plan = Plan(batch, pairs, runs, environment={"versions": {}, "processor": "Abacus"})
    write_plan(tmp_path, plan)
    assert len(read_plan(tmp_path).runs) == MAXIMUM_RUNS
    before = (tmp_path / NAME).read_bytes()
    with pytest.raises(BatchError, match="would be too long, expected fewer runs"):
        write_plan(tmp_path, replace(plan, policies={"tiny": "0" * MAXIMUM_BYTES}))
    assert (tmp_path / NAME).read_bytes() == before


def test_estimates_grow_with_what_is_written() -> None:
    size = Extent(30, 1000, 15.0)
    least = estimate(size, Outputs())
    motion = estimate(size, Outputs(bvh=BvhOutput(fps=60)))
    clouds = estimate(size, Outputs(ply=PlyOutput(fps=15)))
    assert 70e6 < motion.bytes - least.bytes < 90e6
    assert 700e6 < clouds.bytes - least.bytes < 800e6
    assert least.seconds < motion.seconds < 10
    some = estimate(size, Outputs(bvh=BvhOutput(fps=60, avatars=(0, 1), frames=(0, 60))))
    assert some.bytes - least.bytes == 650 * 2 * 60
    standing = estimate(size._replace(obstacle_area=100.0), Outputs(ply=PlyOutput(fps=15)))
    assert standing.bytes - clouds.bytes == 50 * 50 * 100 * 1000
    hands = estimate(size, Outputs(csv=CsvOutput(fps=15, every=10, joints=("left_hand", "right_hand"))))
    assert hands.bytes - least.bytes == 30 * 100 * (16 + 2 * 30)


def test_a_disk_with_room_is_not_refused(tmp_path: Path) -> None:
    check_disk(tmp_path / "a" / "b", [estimate(Extent(2, 10, 15.0), Outputs())])


def run_of(frames: int, outputs: Outputs) -> PlannedRun:
    return PlannedRun("id", "four", 0, 4, frames, 15.0, outputs, ("tiny",), estimate(Extent(4, frames, 15.0), outputs))


def test_tasks_draw_whole_segments_and_together_all_pictures() -> None:
    render = RenderOutput(fps=30)
    run = run_of(300, Outputs(render=render))
    ranges = list(frame_ranges(render, run, 240))
    assert ranges == [(0, 240), (240, 480), (480, 600)]
    part = RenderOutput(fps=30, frames=(100, 500))
    assert list(frame_ranges(part, run, 240)) == [(100, 240), (240, 480), (480, 500)]
    assert list(frame_ranges(part, run, 480)) == [(100, 480), (480, 500)]
    assert list(frame_ranges(RenderOutput(mp4=False, contact_sheet=4), run, 240)) == []
