"""What became of a batch, read from its folder by any process: how far it is, and the state of each run."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from crowdsim.batch.plan import read_plan
from crowdsim.batch.progress import read_progress
from crowdsim.batch.results import is_done, read_result
from crowdsim.runs.lock import find_owner
from crowdsim.runs.status import describe_run


def describe_batch(folder: Path) -> dict[str, Any]:
    """Return what became of a batch.

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
    runs = {
        str(folder / run.folder): {**_describe(folder, plan, id), "values": values[id]} for id, run in plan.runs.items()
    }
    counts = {
        state: sum(facts["state"] == state for facts in runs.values())
        for state in ("done", "failed", "running", "interrupted")
    }
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


def _describe(folder: Path, plan: Any, id: str) -> dict[str, Any]:
    run, result = plan.runs[id], read_result(folder, id)
    facts: dict[str, Any] = {"avatars": run.avatars, "planned_frames": run.control_frames}
    if is_done(folder, run, result):
        seconds = result["seconds"].get("total")
        return {"state": "done", **facts, "control_frames": run.control_frames, "seconds": seconds}
    found = describe_run(folder / run.folder) if (folder / run.folder).is_dir() else {"state": "waiting"}
    if found["state"] == "none":
        found["state"] = "waiting"
    if found["state"] == "done":
        # Its take is; outputs are missing.
        found["state"] = "interrupted"
    if found["state"] != "running" and result.get("state") == "failed":
        found = {**found, **{key: result.get(key) for key in ("cause", "message", "log", "command")}, "state": "failed"}
    return {**facts, **found}
