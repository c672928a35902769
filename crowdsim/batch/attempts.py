"""Attempts at the tasks of a batch, and how each one ended, which a process that dies cannot report itself.

Every attempt writes a line to the log of its task when it begins and when it ends. Between the two are the traceback of
an exception, of a process that crashes or of one that takes too long, which Python's ``faulthandler`` writes from
outside the interpreter; it ends the latter, whatever it is at. An attempt without a last line has died. When
a worker dies, Dask blames every task that was assigned to it; here only the attempts that had begun count.
"""

from __future__ import annotations

import faulthandler
import json
import os
import shlex
import socket
import traceback
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TextIO

from crowdsim.batch.documents import read_bytes
from crowdsim.batch.plan import LOGS, SCENARIOS, PlannedRun
from crowdsim.config.documents import DocumentModel, document_fault, parse_json
from crowdsim.files import entries, make_folder, remove_plain
from crowdsim.runs.folder import RESOLVED

KINDS = {
    "raised": "an exception",
    "crashed": "a crash",
    "memory": "too much memory",
    "hung": "took too long",
    "killed": "killed",
    "lost": "lost",
}
"""Causes of failures, in words."""
_LONGEST = 10_000
"""Longest message of an exception."""
_TIMEOUT, _FATAL = "Timeout (", "Fatal Python error: "


class TaskError(Exception):
    """A task of a run has failed, with the kind of the cause (``KINDS``) and the cause in words; raised in a worker."""

    def __init__(self, task: str, kind: str, message: str) -> None:
        super().__init__(task, kind, message)
        self.task, self.kind, self.message = task, kind, message

    def __str__(self) -> str:
        """Return it in words."""
        return f"{self.task}: {self.message}"


class _Mark(DocumentModel):
    """A line of a log that says that an attempt begins or ends."""

    begin: str = ""
    session: str = ""
    worker: str = ""
    host: str = ""
    pid: int = 0
    timeout: float = 0.0
    end: str = ""
    kind: str = ""
    message: str = ""
    time: str = ""


@dataclass
class Attempt:
    """One attempt at a task: the mark of its begin, what the log holds of it, and the mark of its end if it has one."""

    begun: Mapping[str, Any]
    said: str
    ended: Mapping[str, Any]

    def cause(self) -> tuple[str, str]:
        """Return the kind of its failure, and the cause in words."""
        if self.ended:
            return "raised", str(self.ended.get("message", ""))
        where = f"process {self.begun.get('pid')} on {self.begun.get('host')}"
        for line in self.said.splitlines():
            if line.startswith(_TIMEOUT):
                return "hung", f"did not end within {self.begun.get('timeout', 0):g} s ({where})"
            if line.startswith(_FATAL):
                return "crashed", f"{line.removeprefix(_FATAL)} ({where})"
        return "killed", f"{where} was killed, or ran out of memory"


def log_path(folder: Path, id: str, task: str) -> Path:
    """Return the log of a task of a run, in the folder of its batch."""
    return folder / LOGS / id / f"{task}.log"


def read_attempts(path: Path, session: str = "") -> list[Attempt]:
    """Return the attempts in a log, in order; those of one session of the batch only where it is named.

    Raises:
        BatchError: The log is no regular file, or too long.
    """
    found: list[Attempt] = []
    for line in read_bytes(path.parent, path.name).decode("utf-8", "replace").splitlines():
        mark: dict[str, Any] = {}
        with suppress(ValueError):
            mark = parse_json(line) if line.startswith('{"') else {}
        if document_fault(_Mark, mark):
            mark = {}
        if "begin" in mark:
            found.append(Attempt(mark, "", {}))
        elif found:
            found[-1].said += f"{line}\n"
            found[-1].ended = mark if "end" in mark else found[-1].ended
    return [one for one in found if session in ("", one.begun.get("session"))]


def read_deaths(folder: Path, id: str, session: str) -> dict[str, list[Attempt]]:
    """Return the attempts at each task of a run that have died in a session of its batch."""
    logs = [log_path(folder, id, name[:-4]) for name in entries(folder, f"{LOGS}/{id}") if name.endswith(".log")]
    return {log.stem: [one for one in read_attempts(log, session) if not one.ended] for log in logs}


@contextmanager
def attempt(path: Path, session: str, retries: int, timeout: float, worker: str = "") -> Iterator[None]:
    """Hold one attempt at a task; what is raised within is logged, and raised as a ``TaskError``.

    The process ends when the attempt takes too long.

    Args:
        path: The log of the task, which stays only if there is something in it to be known.
        session: The session of the batch.
        retries: How often attempts may have died before.
        timeout: How long it may take [s].
        worker: Address of the worker.

    Raises:
        TaskError: The task has failed, or too many attempts have died before.
    """
    task = path.stem
    before = [one for one in read_attempts(path, session) if not one.ended]
    if len(before) > retries:
        raise TaskError(task, *before[-1].cause())
    begun = {"begin": task, "session": session, "worker": worker, "host": socket.gethostname(), "pid": os.getpid()}
    was_enabled = faulthandler.is_enabled()
    with _open_log(path) as log:
        _write(log, {**begun, "timeout": timeout})
        faulthandler.enable(log)
        faulthandler.dump_traceback_later(timeout, exit=True, file=log)
        try:
            yield
        except BaseException as error:
            # No longer than can be read again, and without halves of letters, which names of files may have.
            message = (str(error) or type(error).__name__)[:_LONGEST].encode("utf-8", "backslashreplace").decode()
            log.write(traceback.format_exc()[-10 * _LONGEST :])
            _write(log, {"end": "raised", "kind": type(error).__name__, "message": message})
            raise TaskError(task, "raised", message) from error
        finally:
            faulthandler.cancel_dump_traceback_later()
            faulthandler.disable()
            if was_enabled:
                faulthandler.enable()
        _write(log, {"end": "done"})
    if not before:
        remove_plain(path.parent.parent, [f"{path.parent.name}/{path.name}"])


def _open_log(path: Path) -> TextIO:
    """Open a log for more, not through a link; its folder may go meanwhile, with the log of another task."""
    while True:
        make_folder(path.parent)
        with suppress(FileNotFoundError):
            return open(path, "a", encoding="utf-8", errors="backslashreplace", opener=_open_plain)


def _open_plain(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def _write(log: TextIO, mark: Mapping[str, Any]) -> None:
    log.write(json.dumps({**mark, "time": datetime.now(timezone.utc).isoformat(timespec="seconds")}) + "\n")
    log.flush()


def describe_failure(
    folder: Path, run: PlannedRun, error: BaseException, session: str, out_of_memory: Collection[tuple[str, int]] = ()
) -> dict[str, Any]:
    """Return why a run failed, as its result, by the error that Dask reports.

    ``out_of_memory`` are workers, with the numbers of their processes, that Dask ended since they took too much memory.
    """
    if isinstance(error, TaskError):
        task, kind, message = error.task, error.kind, error.message
    else:
        # The task that died most often, where one did.
        task, died = max(read_deaths(folder, run.id, session).items(), key=lambda item: len(item[1]), default=("", []))
        kind, message = died[-1].cause() if died else ("lost", f"{type(error).__name__}: {error}")
        task = task if died else ""
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
        "command": _repeat_command(folder, run, task),
    }


def _repeat_command(folder: Path, run: PlannedRun, task: str) -> str:
    """Return the command that does a task of a run again, without Dask."""
    run_folder = str(folder / run.folder)
    for output in run.outputs.wanted():
        # Pictures are drawn in parts, and joined at the end.
        is_drawn = output.label == "pictures" and task.startswith(("pictures", "finish"))
        if is_drawn or task == f"export-{output.name}":
            return shlex.join(output.command(run_folder))
    scenario = str(folder / SCENARIOS / run.id / RESOLVED)
    return shlex.join(["crowdsim", "run", scenario, "--threads", "1", "--out", run_folder])


def log_tail(folder: Path, result: Mapping[str, Any], lines: int = 40) -> str:
    """Return the end of the log of a run that failed."""
    text = read_bytes(folder, result["log"]).decode("utf-8", "replace") if result.get("log") else ""
    return "\n".join([line for line in text.splitlines() if not line.startswith('{"')][-lines:])
