"""The lock of a folder: one process writes in it at a time, and everyone can read which one that is.

The system's own lock on the folder decides; it ends with its process and leaves no file. ``.crowdsim-lock.json`` names
the owner for other commands.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path

from pydantic import TypeAdapter

from crowdsim.errors import OutputError, RunError
from crowdsim.files import make_folder, read_plain, remove_plain, write_plain

NAME = ".crowdsim-lock.json"
EXTENDING = ".extending.json"
"""What a run is extended to, until the command that does it has reported its end."""
LOCKS = frozenset({NAME, f".{NAME}.part", EXTENDING, f".{EXTENDING}.part"})
"""Files by which commands agree on a folder; they are no part of what is written into it."""
FORMAT = "crowdsim-lock"
_TRIES, _PAUSE = 5, 0.02
"""How often a lock is tried: another process may just be looking whether there is one [s]."""


@dataclass(frozen=True)
class Owner:
    """The process that holds a folder.

    Attributes:
        host: Name of its machine.
        pid: Number of the process.
        started: When the process was started, as the system counts; tells processes of one number apart.
        since: When it took the folder, in UTC.
        command: What it does.
    """

    host: str
    pid: int
    started: float
    since: str
    command: str

    def __str__(self) -> str:
        """Return it in words."""
        return f"process {self.pid} on {self.host} since {self.since} ({self.command})"


def this_owner(command: str) -> Owner:
    """Return this process as the owner of a folder that it takes now."""
    since = datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
    return Owner(socket.gethostname(), os.getpid(), _started(os.getpid()), since, command)


def find_owner(folder: Path) -> Owner | None:
    """Return the process that holds a folder now; None where no process does. Nothing is written."""
    try:
        data = read_plain(folder, NAME, 1 << 16)
        owner = TypeAdapter(Owner).validate_json(data, strict=True)
        if json.loads(data).get("format") != FORMAT:
            return None
        if owner.host == socket.gethostname():
            return owner if _started(owner.pid) == owner.started else None
        with _locked(folder) as decides:
            return None if decides else owner
    except BlockingIOError:
        return owner
    except (OSError, ValueError):
        return None


@contextmanager
def hold_folder(folder: Path, command: str = "") -> Iterator[None]:
    """Make a folder, and keep other processes from writing in it.

    Args:
        folder: The folder.
        command: What this process does in it, for others to read; by default its command line.

    Raises:
        OutputError: The folder cannot be made, or another process holds it.
        RunError: The lock cannot be written.
    """
    make_folder(folder)
    with ExitStack() as stack:
        for attempt in range(_TRIES):
            try:
                if not stack.enter_context(_locked(folder)) and find_owner(folder) is not None:
                    raise BlockingIOError
                break
            except BlockingIOError:
                owner = find_owner(folder)
                if owner is None and attempt < _TRIES - 1:
                    time.sleep(_PAUSE)
                    continue
                who = "another process" if owner is None else str(owner)
                raise OutputError(f"{folder}: is in use by {who}; wait for it, or name another with --out") from None
        own = asdict(this_owner(command or " ".join(["crowdsim", *sys.argv[1:]])))
        try:
            write_plain(folder, NAME, json.dumps({"format": FORMAT, **own}, indent=1) + "\n")
        except OutputError as error:
            raise RunError(str(error)) from None
        try:
            yield
        finally:
            with suppress(OSError):
                remove_plain(folder, [NAME])


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Take the system's lock on a folder unless another process has it; give whether there is one, which decides."""
    try:
        import fcntl
    except ImportError:
        yield False
        return
    number = os.open(folder, os.O_RDONLY)
    try:
        decides = True
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            # Some network file systems lock no folders.
            decides = False
        yield decides
    finally:
        os.close(number)


def _started(pid: int) -> float:
    """Return when a process was started [s]; 0 where there is none, or it cannot be looked at."""
    import psutil

    try:
        process = psutil.Process(pid)
        # One that has ended and that its parent has not asked for yet holds nothing any more.
        return 0.0 if process.status() == psutil.STATUS_ZOMBIE else float(process.create_time())
    except (psutil.Error, ValueError):
        return 0.0


def boot_id() -> str:
    """Return what tells apart the times between which this machine was started again."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        import psutil

        return f"{psutil.boot_time():.0f}"
