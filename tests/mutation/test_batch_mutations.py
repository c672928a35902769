"""Folders of batches that strangers have made: each mutant of a file is refused with an error, or is read and reported.

Checksums fit: whoever writes a hostile file signs it too.
"""

from __future__ import annotations

import json
import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from mutants import Rng, mutate_json
from on_disk import change_bytes
from scenes import crowdsim

from crowdsim.batch.attempts import read_attempts
from crowdsim.batch.dataset import open_batch
from crowdsim.batch.plan import read_plan, resolve, write_plan
from crowdsim.batch.report import write_report
from crowdsim.batch.results import Progress, describe_batch, read_progress, write_result
from crowdsim.batch.workers import TOKEN, describe_worker
from crowdsim.errors import CrowdsimError
from crowdsim.runs.manifest import signed_text

COUNT = 30
SEEDS = st.integers(0, 2**40)
OUTPUTS = {"bvh": {"fps": 15.0}, "render": {"size": [32, 24], "frames": [0, 3]}}
MARKS = [
    {
        "begin": "simulate",
        "session": "one",
        "worker": "tcp://a",
        "host": "here",
        "pid": 7,
        "timeout": 60.0,
        "time": "now",
    },
    {"end": "raised", "kind": "ValueError", "message": "no", "time": "now"},
]


def blocks(count: int) -> settings:
    """Return settings that draw so many seeds of blocks of mutants."""
    return settings(max_examples=count, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module")
def batch(strangers: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a batch of four runs, of which one is done, two have failed and one is missing."""
    from crowdsim.batch.description import Batch
    from crowdsim.batch.plan import Plan, make_plan

    folder = tmp_path_factory.mktemp("batch")
    axes = [{"seed": "0:2"}, {"duration": [20, 30], "groups[0].count": [1, 2]}]
    data = {
        "version": 1,
        "name": "trial",
        "scenarios": [str(strangers / "four.yaml")],
        "axes": axes,
        "outputs": OUTPUTS,
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(strangers)
        batch = Batch.model_validate_json(json.dumps(data))
        plan = make_plan(batch, *resolve(batch))
        environment = {"versions": {"numpy": "2.0", "crowdsim": "0.1"}, "processor": "Abacus"}
        write_plan(folder, Plan(plan.batch, plan.combinations, plan.runs, {"tiny": "0" * 64}, environment))
        done, *failed = list(plan.runs.values())[:3]
        shutil.copytree(strangers / "run", folder / done.folder)
    statistics = {"avatars": 4, "control_frames": 40, "hits_per_minute_per_avatar": 2.5, "landed_share": None}
    seconds, sizes = {"total": 1.5, "control": 0.5}, {"peak_memory_bytes": 10**8, "bytes": 10**5, "files": 20}
    facts: dict[str, Any] = {
        "state": "done",
        "outputs": done.mark,
        "statistics": statistics,
        "seconds": seconds,
        **sizes,
    }
    write_result(folder, done.id, facts)
    for run in failed:
        log = folder / "logs" / run.id / "simulate.log"
        log.parent.mkdir(parents=True)
        log.write_text("".join(json.dumps(mark) + "\n" for mark in MARKS))
        facts = {"state": "failed", "task": "simulate", "cause": "raised", "message": "no", "attempts": 1}
        write_result(folder, run.id, {**facts, "log": f"logs/{run.id}/simulate.log", "command": "crowdsim run x"})
    progress = Progress(folder, plan.runs)
    progress.hear({"run": done.id, "stage": "control", "done": 3, "total": 40})
    progress.write(now=True)
    (folder / TOKEN).write_text("token")
    return folder


def use(folder: Path) -> int:
    """Do what commands do with the folder of a batch, each as if it were alone; return how many were refused."""
    log = next(iter(folder.glob("logs/*/*.log")), folder / "none")

    def report() -> None:
        write_report(folder, read_plan(folder))

    def attempts() -> None:
        for one in read_attempts(log):
            one.cause()

    refused = 0
    for step in (
        lambda: describe_batch(folder),
        lambda: open_batch(folder, ["x"]),
        lambda: read_progress(folder),
        report,
        attempts,
    ):
        try:
            step()
        except CrowdsimError:
            refused += 1
    assert describe_worker(str(folder), "token")["host"]
    return refused


def change(rng: Rng, folder: Path) -> None:
    """Change a file of a batch in one way."""
    names = [path for path in sorted(folder.rglob("*")) if path.is_file() and "runs" not in path.parts]
    path = folder / "batch.json" if rng.random() < 0.4 else names[int(rng.integers(len(names)))]
    if path.suffix != ".json" or rng.random() < 0.15:
        change_bytes(rng, path, path.stat().st_size)
        return
    document = mutate_json(rng, json.loads(path.read_text()))
    with suppress(ValueError):
        is_signed = path.name == "batch.json" and isinstance(document, dict)
        path.write_text(signed_text(document) if is_signed else json.dumps(document))


def test_the_batch_from_which_mutants_are_made_is_sound(batch: Path, capsys) -> None:
    assert use(batch) == 0
    assert crowdsim("status", batch, "--json") == 1
    assert json.loads(capsys.readouterr().out)["failed"] == 2


def check(batch: Path, place: Path, seed: int) -> None:
    """Check a block of mutants."""
    refused = 0
    for one in range(seed * COUNT, seed * COUNT + COUNT):
        folder = place / "batch"
        shutil.copytree(batch, folder, copy_function=shutil.copyfile)
        change(np.random.default_rng(one), folder)
        try:
            refused += use(folder) > 0
        except Exception as error:
            pytest.fail(f"batch {one}: {type(error).__name__}: {error}")
        shutil.rmtree(folder)
    assert 0 < refused < COUNT, "mutants are too tame, or too wild"


@blocks(2)
@given(SEEDS)
def test_a_mutant_of_a_batch_is_refused_or_reported(batch: Path, tmp_path_factory, seed: int) -> None:
    check(batch, tmp_path_factory.mktemp("mutants"), seed)


def test_documents_that_are_not_checked_are_noticed(batch: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("crowdsim.batch.documents.document_fault", lambda *_: "")
    with pytest.raises(pytest.fail.Exception, match=r"batch \d+: \w+: "):
        check(batch, tmp_path, 0)


@pytest.mark.slow
@blocks(20)
@given(SEEDS)
def test_600_mutants_of_a_batch(batch: Path, tmp_path_factory, seed: int) -> None:
    check(batch, tmp_path_factory.mktemp("mutants"), seed)
