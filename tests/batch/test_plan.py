"""The plan of a batch: what it holds, what it estimates, and how it is read again."""

import json
from pathlib import Path

import pytest
from batches import write_batch
from scenes import crowdsim

from crowdsim.batch.description import load_batch
from crowdsim.batch.estimates import check_disk, estimate
from crowdsim.batch.plan import PlannedRun, read_plan, write_plan
from crowdsim.batch.running import plan_batch
from crowdsim.batch.submitting import frame_ranges
from crowdsim.errors import BatchError
from crowdsim.scenario.outputs import BvhOutput, CloudOutput, Outputs, RenderOutput

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
    write_plan(folder, plan)
    assert read_plan(folder) == plan
    assert [run.mark for run in read_plan(folder).runs.values()] == [run.mark for run in plan.runs.values()]


def test_a_plan_that_is_damaged_or_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BatchError, match="so this is no batch"):
        read_plan(tmp_path)
    (tmp_path / "batch.json").write_text('{"format": "crowdsim-batch", "version": 1, "checksum": "0"}')
    with pytest.raises(BatchError, match="is damaged"):
        read_plan(tmp_path)


def test_estimates_grow_with_what_is_written() -> None:
    least = estimate(30, 1000, 15.0, Outputs())
    motion = estimate(30, 1000, 15.0, Outputs(bvh=BvhOutput(fps=60)))
    clouds = estimate(30, 1000, 15.0, Outputs(ply=CloudOutput(fps=15)))
    assert 70e6 < motion.bytes - least.bytes < 90e6
    assert 700e6 < clouds.bytes - least.bytes < 800e6
    assert least.seconds < motion.seconds < 10
    some = estimate(30, 1000, 15.0, Outputs(bvh=BvhOutput(fps=60, avatars=(0, 1), frames=(0, 60))))
    assert some.bytes - least.bytes == 650 * 2 * 60


def test_a_disk_with_room_is_not_refused(tmp_path: Path) -> None:
    check_disk(tmp_path / "a" / "b", [estimate(2, 10, 15.0, Outputs())])


def run_of(frames: int, outputs: Outputs) -> PlannedRun:
    return PlannedRun("id", "four", 0, 4, frames, 15.0, outputs, ("tiny",), estimate(4, frames, 15.0, outputs))


def test_tasks_draw_whole_segments_and_together_all_pictures() -> None:
    render = RenderOutput(fps=30)
    run = run_of(300, Outputs(render=render))
    ranges = list(frame_ranges(render, run, 240))
    assert ranges == [(0, 240), (240, 480), (480, 599)]
    part = RenderOutput(fps=30, frames=(100, 500))
    assert list(frame_ranges(part, run, 240)) == [(100, 240), (240, 480), (480, 500)]
    assert list(frame_ranges(part, run, 480)) == [(100, 480), (480, 500)]
    assert list(frame_ranges(RenderOutput(mp4=False, contact_sheet=4), run, 240)) == []
