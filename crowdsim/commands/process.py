"""The process of a command: what it needs of the system, what it shows, and that it ends when a signal comes."""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any, TextIO

from crowdsim.core.workers import CORES
from crowdsim.errors import CrowdsimError, RunError

GRACE = 1.25
"""How long a command may take to end by itself after a signal [s]."""
FILES, THREADS = 64, 16 + CORES
"""Files that a command must be able to open at once, and threads it must be able to start; numpy starts one a core."""

_HIDDEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")
"""All control characters but line breaks and tabs, and those that change the direction of text."""


def escaped(text: str) -> str:
    """Return text with control characters, which terminals obey, as escapes."""
    return _HIDDEN.sub(lambda found: repr(found[0])[1:-1], text)


def terminal() -> TextIO:
    """Return standard error without escapes, for bars that move the cursor."""
    return getattr(sys.stderr, "stream", sys.stderr)


class Shown:
    """A text stream on which control characters, and what its encoding lacks, are shown as escapes.

    Attributes:
        stream: The stream itself.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        """Write text, and return its length."""
        self.stream.write(escaped(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        """Return anything else of the stream, but for the bytes below it."""
        if name == "buffer":
            raise AttributeError(name)
        return getattr(self.stream, name)


@contextmanager
def shown() -> Iterator[None]:
    """Show escapes on standard output and standard error, both of which must be open.

    Raises:
        CrowdsimError: One of them is closed.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # Else the next file that is opened would have this number, and take in what is printed.
            os.open(os.devnull, os.O_RDONLY if number == 0 else os.O_WRONLY)
    streams = {"output": sys.stdout, "error": sys.stderr}
    closed = " and ".join(name for name, stream in streams.items() if stream is None)
    if closed:
        raise CrowdsimError(f"standard {closed}: closed, expected a terminal, a file, a pipe or {os.devnull}")
    with redirect_stdout(Shown(sys.stdout)), redirect_stderr(Shown(sys.stderr)):  # type: ignore[type-var]
        yield


def check_process() -> None:
    """Check what every command needs of the system: a working folder, and room for open files and threads.

    Raises:
        CrowdsimError: The working folder has been deleted.
        RunError: Too few files can be open, or too few threads started.
    """
    try:
        os.getcwd()
    except FileNotFoundError:
        raise CrowdsimError("the working folder has been deleted, expected one that exists: cd elsewhere") from None
    files: list[int] = []
    try:
        while len(files) < FILES:
            files.append(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        if error.errno not in (errno.EMFILE, errno.ENFILE):
            raise
        what = f"only {len(files)} more files can be open at once, expected at least {FILES}"
        raise RunError(f"crowdsim: {what}; ulimit -n sets the limit") from None
    finally:
        for file in files:
            os.close(file)
    release = threading.Event()
    threads: list[threading.Thread] = []
    try:
        while len(threads) < THREADS:
            thread = threading.Thread(target=release.wait, daemon=True)
            thread.start()
            threads.append(thread)
    except RuntimeError:
        what = f"only {len(threads)} more threads can be started, expected at least {THREADS}"
        raise RunError(f"crowdsim: {what}; ulimit -u sets the limit") from None
    finally:
        release.set()
        for thread in threads:
            thread.join()


def describe_failure(error: OSError | RuntimeError) -> CrowdsimError | None:
    """Return as an error of the program what the system refused; None for a defect of the program."""
    if isinstance(error, OSError):
        where = error.filename or "crowdsim"
        if error.errno == errno.ENAMETOOLONG:
            return CrowdsimError(f"{where}: name too long for a file, expected fewer characters")
        if error.errno in (errno.EMFILE, errno.ENFILE):
            return RunError(f"{where}: too many files are open at once; ulimit -n sets the limit")
        return RunError(f"{where}: {error.strerror or error}")
    if any(frame.f_code is threading.Thread.start.__code__ for frame, _ in traceback.walk_tb(error.__traceback__)):
        what = "no more threads can be started; --threads takes fewer, ulimit -u sets the limit"
        return RunError(f"crowdsim: {what}")
    return None


_temporary: set[Path] = set()


@contextmanager
def opened_run(path: Path) -> Iterator[Path]:
    """Give a run's folder, or one with what its archive holds, which goes in any case (``runs.archive.opened``)."""
    from crowdsim.runs.archive import opened

    with opened(path) as folder:
        own = {folder.parent} if folder != path else set()
        _temporary.update(own)
        try:
            yield folder
        finally:
            _temporary.difference_update(own)


@contextmanager
def leave_in_time(is_program: bool) -> Iterator[None]:
    """End the process ``GRACE`` seconds after SIGINT or SIGTERM, should it not have ended by itself.

    Where the command is all that the process is for (``is_program``), that holds until the process has ended, and else
    until the command has.

    Python handles a signal only when its main thread leaves compiled code, and ends only when all threads have ended;
    either can take minutes for a large crowd. What is lost is what a process that is killed loses: files appear under
    their names when they are whole, and the same command goes on from there.
    """
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    left = threading.Event()
    threading.Thread(target=_watch, args=(reader, left), name="signals", daemon=True).start()
    before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        if not is_program:
            left.set()
        signal.set_wakeup_fd(before)
        writer.close()


def _watch(reader: socket.socket, left: threading.Event) -> None:
    """Wait for a signal that ends the process, and see to it that it does; return when the other end is closed."""
    with reader:
        while came := reader.recv(1):
            if came[0] in (signal.SIGINT, signal.SIGTERM) and not left.wait(GRACE):
                _leave(came[0])


def _leave(number: int) -> None:
    """End the process and those that it started, at once."""
    try:
        import psutil

        print("stopped in the middle; what was finished is kept", file=sys.stderr, flush=True)
        for child in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                child.kill()
        for folder in list(_temporary):
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        os._exit(128 + number)
