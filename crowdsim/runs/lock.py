"""The lock of a run folder: one process writes in it at a time, and everyone can read which one that is.

The system's own lock on the folder ends with its process, and decides wherever it can. Beside it the file
``.crowdsim-lock.json`` names the owner, who renews its time while he works. Of a lock that was left behind by a killed
process, before the machine was started again, or by another machine that shows no sign of life, nothing remains.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path

from crowdsim.errors import OutputError, RunError
from crowdsim.files import make_folder, open_plain

NAME = ".crowdsim-lock.json"
EXTENDING = ".extending.json"
"""What a run is extended to, until the command that does it has reported its end."""
LOCKS = frozenset({NAME, f"{NAME}.part", EXTENDING, f"{EXTENDING}.part"})
"""Files by which commands agree on a run folder; they are not part of the run."""
FORMAT = "crowdsim-lock"

BEAT = 10.0
"""How often the owner renews the time of the lock [s]."""
SILENCE = 60.0
"""After so long without it, a lock of another machine is stale [s]."""


@dataclass(frozen=True)
class Owner:
    """The process that holds a run folder.

    Attributes:
        host: Name of its machine.
        machine: What tells machines of one name apart; empty where the system has no such number.
        boot: What tells the times apart between which the machine was started again.
        pid: Number of the process.
        started: When the process was started, as the system counts; tells processes of one number apart.
        since: When it took the folder, in UTC.
        command: What it does.
    """

    host: str
    machine: str
    boot: str
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
    pid = os.getpid()
    return Owner(socket.gethostname(), _first_line("/etc/machine-id"), _boot(), pid, _started(pid), since, command)


def read_owner(folder: Path) -> Owner | None:
    """Return who a folder's lock names; None where there is none, or it cannot be read."""
    try:
        with open_plain(folder, NAME) as file:
            document = json.loads(file.read(65536).decode("utf-8"))
        if document.pop("format") != FORMAT:
            return None
        owner = Owner(**document)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    numbers = {"pid": (int,), "started": (int, float)}
    is_sound = all(isinstance(value, numbers.get(name, (str,))) for name, value in asdict(owner).items())
    return owner if is_sound else None


def find_owner(folder: Path) -> Owner | None:
    """Return the process that holds a folder now; None where no process does, or only a stale lock is left."""
    owner = read_owner(folder)
    return owner if owner is not None and _is_alive(folder, owner, False) else None


def rebooted(owner: Owner) -> bool:
    """Whether the owner of a stale lock was on a machine that has been started again, or on another one."""
    return owner.boot != _boot()


@contextmanager
def hold_folder(folder: Path, command: str = "") -> Iterator[Owner | None]:
    """Make a folder, and keep other processes from writing in it.

    Args:
        folder: The run folder.
        command: What this process does in it, for others to read; by default its command line.

    Returns:
        The owner of a stale lock that was there, which is gone now; None where there was none.

    Raises:
        OutputError: The folder cannot be made, or another process holds it.
        RunError: The lock cannot be written.
    """
    make_folder(folder)
    with ExitStack() as held:
        try:
            before = held.enter_context(_taken(folder, command))
        except BlockingIOError:
            owner = read_owner(folder)
            who = "another process" if owner is None else str(owner)
            choice = "wait for it, or name another with --out"
            if owner is not None and owner.host != socket.gethostname():
                choice += f"; after {SILENCE:.0f} s without a sign of life from {owner.host} the folder is free"
            raise OutputError(f"{folder}: is in use by {who}; {choice}") from None
        yield before


@contextmanager
def _taken(folder: Path, command: str) -> Iterator[Owner | None]:
    """Take a folder.

    Raises:
        BlockingIOError: Another process holds it.
    """
    path = folder / NAME
    with _locked(folder) as decides:
        before = read_owner(folder)
        if before is not None and _is_alive(folder, before, decides):
            raise BlockingIOError
        own = this_owner(command or " ".join(["crowdsim", *sys.argv[1:]]))
        _write(path, own)
        stop = threading.Event()
        threading.Thread(target=_beat, args=(path, stop), name="lock", daemon=True).start()
        try:
            yield before
        finally:
            stop.set()
            if read_owner(folder) == own:
                with suppress(OSError):
                    path.unlink()


def _write(path: Path, owner: Owner) -> None:
    """Write the lock anew; where two do so at once, one of them fails."""
    try:
        path.unlink(missing_ok=True)
        text = json.dumps({"format": FORMAT, **asdict(owner)}, indent=1) + "\n"
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise BlockingIOError from None
    except OSError as error:
        with suppress(OSError):
            path.unlink(missing_ok=True)
        raise RunError(f"{path}: cannot be written: {error.strerror or error}") from None


@contextmanager
def _locked(folder: Path) -> Iterator[bool]:
    """Take the system's lock on a folder; give whether it has one, so that it decides for processes of this machine.

    Raises:
        BlockingIOError: Another process has it.
    """
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


def _is_alive(folder: Path, owner: Owner, decides: bool) -> bool:
    """Whether the owner that a lock names is at work; ``decides`` is whether the system's lock, which we have, says."""
    here = this_owner("")
    if owner.boot == here.boot and decides:
        return False
    if (owner.host, owner.machine) == (here.host, here.machine):
        # Of a machine that was started again since, no process is left.
        return owner.boot == here.boot and _started(owner.pid) == owner.started
    return _silence(folder) < SILENCE


def _silence(folder: Path) -> float:
    """Return how long ago a lock was renewed, by the clock of the machine that keeps the files [s]."""
    probe = folder / f"{NAME}.part"
    try:
        probe.write_bytes(b"")
        now = probe.stat().st_mtime
    except OSError:
        now = time.time()
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
    try:
        return now - (folder / NAME).stat().st_mtime
    except OSError:
        return SILENCE


def _beat(path: Path, stop: threading.Event) -> None:
    while not stop.wait(BEAT):
        with suppress(OSError):
            os.utime(path)


def _started(pid: int) -> float:
    """Return when a process was started [s]; 0 where there is none, or it cannot be looked at."""
    import psutil

    try:
        return float(psutil.Process(pid).create_time())
    except psutil.Error:
        return 0.0


def _boot() -> str:
    """Return what tells apart the times between which a machine was started again."""
    boot = _first_line("/proc/sys/kernel/random/boot_id")
    if boot:
        return boot
    import psutil

    return f"{psutil.boot_time():.0f}"


def _first_line(path: str) -> str:
    try:
        with open(path, encoding="ascii") as file:
            return file.readline().strip()
    except (OSError, ValueError):
        return ""
