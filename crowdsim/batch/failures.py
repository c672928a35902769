"""Why runs of a batch failed, and the commands that repeat them."""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection
from pathlib import Path
from typing import Any

from crowdsim.batch.attempts import TaskError, log_path, read_attempts
from crowdsim.batch.documents import read_bytes
from crowdsim.batch.plan import LOGS, SCENARIOS, PlannedRun
from crowdsim.files import entries
from crowdsim.runs.folder import RESOLVED


def describe_failure(
    folder: Path, run: PlannedRun, error: BaseException, session: str, out_of_memory: Collection[tuple[str, int]] = ()
) -> dict[str, Any]:
    """Return why a run failed, as its result.

    Args:
        folder: Folder of the batch.
        run: The run.
        error: What Dask reports.
        session: The session of the batch.
        out_of_memory: Workers, with the numbers of their processes, that Dask ended since they took too much memory.
    """
    if isinstance(error, TaskError):
        task, kind, message = error.task, error.kind, error.message
    else:
        task, kind, message = _find_death(folder, run, session) or ("", "lost", f"{type(error).__name__}: {error}")
    path = log_path(folder, run.id, task)
    attempts = read_attempts(path, session)
    if attempts and kind == "killed":
        begun = attempts[-1].begun
        if (begun.get("worker"), begun.get("pid")) in out_of_memory:
            where = f"process {begun.get('pid')} on {begun.get('host')}"
            kind, message = "memory", f"took more memory than its worker may ({where})"
    return {
        "state": "failed",
        "task": task,
        "cause": kind,
        "message": message,
        "attempts": len(attempts),
        "log": os.path.relpath(path, folder) if path.is_file() else "",
        "command": repeat_command(folder, run, task),
    }


def _find_death(folder: Path, run: PlannedRun, session: str) -> tuple[str, str, str] | None:
    """Return task, kind and cause of the death of a run's tasks that died most often; None where none has died."""
    died = {}
    for name in entries(folder, f"{LOGS}/{run.id}"):
        if name.endswith(".log"):
            log = folder / LOGS / run.id / name
            died[log.stem] = [one for one in read_attempts(log, session) if not one.ended]
    task = max(died, key=lambda name: len(died[name]), default="")
    return (task, *died[task][-1].cause()) if task and died[task] else None


def repeat_command(folder: Path, run: PlannedRun, task: str) -> str:
    """Return the command that does a task of a run again, without Dask."""
    run_folder = str(folder / run.folder)
    for output in run.outputs.wanted():
        # Pictures are drawn in parts, and joined at the end.
        is_drawn = output.label == "pictures" and task.startswith(("pictures", "finish"))
        if is_drawn or task == f"export-{output.name}":
            return shlex.join(output.command(run_folder))
    scenario = str(folder / SCENARIOS / run.id / RESOLVED)
    return shlex.join(["crowdsim", "run", scenario, "--threads", "1", "--out", run_folder])


def log_tail(folder: Path, result: dict[str, Any], lines: int = 40) -> str:
    """Return the end of the log of a run that failed.

    Raises:
        BatchError: The log is no regular file, or too long.
    """
    text = read_bytes(folder, result["log"]).decode("utf-8", "replace") if result.get("log") else ""
    said = [line for line in text.splitlines() if not line.startswith('{"')]
    return "\n".join(said[-lines:])
