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
import socket
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TextIO

from crowdsim.batch.documents import read_bytes
from crowdsim.batch.plan import LOGS
from crowdsim.config.documents import DocumentModel, document_fault, parse_json
from crowdsim.files import make_folder, remove_plain

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
    """A task of a run has failed; raised in a worker, and understood by the process that sent the task.

    Attributes:
        task: Name of the task.
        kind: Kind of the cause, of ``KINDS``.
        message: The cause in words.
    """

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


@dataclass(frozen=True)
class Attempt:
    """One attempt at a task.

    Attributes:
        begun: Session of the batch, worker, host, process and time.
        said: What the log holds of it.
        ended: How it ended; nothing where it did not.
    """

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
        mark = _read_mark(line)
        if "begin" in mark:
            found.append(Attempt(mark, "", {}))
        elif found:
            last = found[-1]
            found[-1] = Attempt(last.begun, f"{last.said}{line}\n", mark if "end" in mark else last.ended)
    return [one for one in found if session in ("", one.begun.get("session"))]


def _read_mark(line: str) -> dict[str, Any]:
    if not line.startswith('{"'):
        return {}
    try:
        mark = parse_json(line)
        return {} if document_fault(_Mark, mark) else dict(mark)
    except ValueError:
        return {}


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
    with _opened(path) as log:
        _write(log, {**begun, "timeout": timeout, "time": _now()})
        faulthandler.enable(log)
        faulthandler.dump_traceback_later(timeout, exit=True, file=log)
        try:
            yield
        except BaseException as error:
            # No longer than can be read again, and without halves of letters, which names of files may have.
            message = (str(error) or type(error).__name__)[:_LONGEST].encode("utf-8", "backslashreplace").decode()
            log.write(traceback.format_exc()[-10 * _LONGEST :])
            _write(log, {"end": "raised", "kind": type(error).__name__, "message": message, "time": _now()})
            raise TaskError(task, "raised", message) from error
        finally:
            faulthandler.cancel_dump_traceback_later()
            faulthandler.disable()
            if was_enabled:
                faulthandler.enable()
        _write(log, {"end": "done", "time": _now()})
    if not before:
        remove_plain(path.parent.parent, [f"{path.parent.name}/{path.name}"])


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    """Open a log for more, not through a link; its folder may go meanwhile, with the log of another task."""
    while True:
        make_folder(path.parent)
        with suppress(FileNotFoundError):
            log = open(path, "a", encoding="utf-8", errors="backslashreplace", opener=_open_plain)  # noqa: SIM115
            break
    with log:
        yield log


def _open_plain(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def _write(log: TextIO, mark: Mapping[str, Any]) -> None:
    log.write(json.dumps(mark) + "\n")
    log.flush()


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")
