"""What came of the runs of a batch, a small file each, how far it is while it goes on, and the state of all of it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, RootModel

from crowdsim.batch.documents import read_document
from crowdsim.batch.plan import LOGS, RESULTS, PlannedRun, read_plan
from crowdsim.config.documents import DocumentModel
from crowdsim.errors import OutputError
from crowdsim.files import exists_plain, make_folder, walk, write_text
from crowdsim.runs.lock import find_owner
from crowdsim.runs.manifest import NAME as MANIFEST
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.status import describe_run

if TYPE_CHECKING:
    from crowdsim.take.take import Take

PROGRESS = "progress.json"
_NEWS = 2.0
"""How often progress is written for others to read [s]."""
_Count = Annotated[int, Field(ge=0, lt=2**63)]
_Number = Annotated[float, Field(ge=-1e30, le=1e30)]
_Seconds = Annotated[float, Field(ge=0, le=1e12)]


class _Done(DocumentModel):
    """What a finished run amounts to."""

    state: Literal["done"]
    outputs: str
    statistics: dict[str, _Number | None]
    seconds: dict[str, _Number]
    peak_memory_bytes: _Count
    bytes: _Count
    files: _Count


class _Failed(DocumentModel):
    """Why a run failed."""

    state: Literal["failed"]
    task: str
    cause: str
    message: str
    attempts: _Count
    log: Annotated[str, Field(pattern=rf"^(|{LOGS}/[0-9a-f]{{16}}/[a-z0-9-]+\.log)$")]
    command: str


class _Result(RootModel[Annotated[_Done | _Failed, Field(discriminator="state")]]):
    """What came of a run."""


class _Stage(DocumentModel):
    """How far a run is."""

    stage: str
    done: _Count
    total: _Count


class _News(DocumentModel):
    """How far a batch is, as it is written."""

    runs: _Count
    done: _Count
    failed: _Count
    seconds: _Seconds
    seconds_left: _Seconds | None
    dashboard: str
    active: dict[str, _Stage]


def collect(folder: Path, take: Take, mark: str) -> dict[str, Any]:
    """Return what a finished run amounts to, with the checksum ``mark`` of its outputs."""
    from crowdsim.take.measures import measure_fights

    manifest = read_manifest(folder, ("statistics", "seconds", "peak_memory_bytes"))
    sizes = [os.lstat(folder / name).st_size for name in walk(folder)]
    return {
        "state": "done",
        "outputs": mark,
        "statistics": {**asdict(measure_fights(take, take.policies)), **manifest["statistics"]},
        "seconds": manifest["seconds"],
        "peak_memory_bytes": manifest["peak_memory_bytes"],
        "bytes": sum(sizes),
        "files": len(sizes),
    }


def write_result(folder: Path, id: str, result: Mapping[str, Any]) -> None:
    """Write what came of a run into the folder of its batch."""
    make_folder(folder / RESULTS)
    write_text(folder / RESULTS / f"{id}.json", json.dumps(result, indent=1) + "\n")


def read_result(folder: Path, id: str) -> dict[str, Any]:
    """Return what came of a run; nothing where that is not known."""
    return read_document(folder, f"{RESULTS}/{id}.json", _Result)


def is_done(folder: Path, run: PlannedRun, result: Mapping[str, Any] | None = None) -> bool:
    """Whether a run is finished, with the outputs that are planned."""
    result = read_result(folder, run.id) if result is None else result
    is_same = result.get("state") == "done" and result.get("outputs") == run.mark
    return is_same and exists_plain(folder, f"{run.folder}/{MANIFEST}")


class Progress:
    """How far a batch is that is going on.

    Attributes:
        dashboard: Address of the dashboard; empty where there is none.
        done: Runs that are finished, those of before among them.
        failed: Runs that have failed.
        active: Runs that workers are at: stage, how much of it is done, and of how much.
    """

    def __init__(self, folder: Path, runs: Mapping[str, PlannedRun], dashboard: str = "") -> None:
        self._folder, self._runs, self.dashboard = folder, runs, dashboard
        self.done: set[str] = set()
        self.failed: set[str] = set()
        self.active: dict[str, tuple[str, int, int]] = {}
        self._written = 0.0
        self.begin(self.done)

    def begin(self, done: set[str]) -> None:
        """Note that runs begin now, and which are finished already."""
        self._since, self.done, self._before = time.monotonic(), done, set(done)

    def hear(self, message: Mapping[str, Any]) -> None:
        """Note what a worker reports."""
        run = message.get("run")
        if run in self._runs and run not in self.done | self.failed:
            self.active[str(run)] = (str(message["stage"]), int(message["done"]), int(message["total"]))

    def settle(self, run: str, is_done: bool) -> None:
        """Note that a run has ended."""
        self.active.pop(run, None)
        (self.done if is_done else self.failed).add(run)

    def seconds_left(self) -> float | None:
        """Return about how long the rest takes, by what was done so far; None while nothing is known [s]."""
        costs = {id: max(run.estimate.seconds, 1e-6) for id, run in self._runs.items()}
        simulated = sum(
            costs[id] * min(done / total, 1.0)
            for id, (stage, done, total) in self.active.items()
            if stage == "control" and total > 0
        )
        ended = sum(costs[id] for id in (self.done | self.failed) - self._before) + simulated
        left = sum(costs[id] for id in costs.keys() - self.done - self.failed) - simulated
        return (time.monotonic() - self._since) * left / ended if ended > 0 else None

    def write(self, now: bool = False) -> None:
        """Write it into the folder of the batch, where it is time to."""
        if not now and time.monotonic() - self._written <= _NEWS:
            return
        self._written, left = time.monotonic(), self.seconds_left()
        news = {
            "runs": len(self._runs),
            "done": len(self.done),
            "failed": len(self.failed),
            "seconds": round(time.monotonic() - self._since, 1),
            "seconds_left": None if left is None else round(left, 1),
            "dashboard": self.dashboard,
            "active": {id: dict(zip(_Stage.model_fields, at, strict=True)) for id, at in self.active.items()},
        }
        with suppress(OutputError):
            # A disk that is full stops runs, which say so.
            write_text(self._folder / PROGRESS, json.dumps(news, indent=1) + "\n")


def read_progress(folder: Path) -> dict[str, Any]:
    """Return how far a batch was when it last reported; nothing where that is not known."""
    return read_document(folder, PROGRESS, _News)


def describe_batch(folder: Path) -> dict[str, Any]:
    """Return what became of a batch, read from its folder by any process.

    Returns:
        ``state``: ``done``, ``failed`` (all runs have ended, some of them so), ``running`` or ``interrupted``; numbers
        of runs ``done``, ``failed``, ``running`` and ``waiting``; ``runs`` by folder, each as ``describe_run`` gives
        it, with its ``values`` of the swept keys, and the ``cause``, ``message``, ``log`` and ``command`` of one that
        failed. While a process is at work also its ``owner``, ``seconds_left`` and the address of its ``dashboard``.

    Raises:
        BatchError: There is no batch, or it is damaged.
    """
    plan, owner = read_plan(folder), find_owner(folder)
    values = {id: {"scenario": one.scenario, **one.values} for one, id in reversed(plan.combinations)}
    runs = {str(folder / run.folder): {**_describe(folder, run), "values": values[id]} for id, run in plan.runs.items()}
    states = [facts["state"] for facts in runs.values()]
    counts = {state: states.count(state) for state in ("done", "failed", "running", "interrupted")}
    counts["waiting"] = len(runs) - sum(counts.values())
    left = counts["waiting"] + counts["running"] + counts["interrupted"]
    state = "running" if owner else "interrupted" if left else "failed" if counts["failed"] else "done"
    live: dict[str, Any] = {}
    if owner is not None:
        progress = read_progress(folder)
        live = {"owner": asdict(owner), **{key: progress.get(key) for key in ("seconds_left", "dashboard")}}
        for id, at in progress.get("active", {}).items():
            if id in plan.runs:
                runs[str(folder / plan.runs[id].folder)]["task"] = at
    return {"state": state, "name": plan.batch.name, "total": len(runs), **counts, **live, "runs": runs}


def _describe(folder: Path, run: PlannedRun) -> dict[str, Any]:
    result = read_result(folder, run.id)
    facts: dict[str, Any] = {"avatars": run.avatars, "planned_frames": run.control_frames}
    if is_done(folder, run, result):
        seconds = result["seconds"].get("total")
        return {"state": "done", **facts, "control_frames": run.control_frames, "seconds": seconds}
    found = describe_run(folder / run.folder) if (folder / run.folder).is_dir() else {"state": "none"}
    # The take of one that is done is; outputs are missing.
    found["state"] = {"none": "waiting", "done": "interrupted"}.get(found["state"], found["state"])
    if found["state"] != "running" and result.get("state") == "failed":
        found = {**found, **{key: result.get(key) for key in ("cause", "message", "log", "command")}, "state": "failed"}
    return {**facts, **found}
