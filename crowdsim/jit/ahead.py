"""Kernels that will be needed are compiled by processes of their own, while this one gets on with its work.

Each worker goes through the list of ``signatures`` in the order of need, and compiles each kernel that no process has
compiled or is compiling; one of them begins with what takes longest. Where a worker dies, cannot start or cannot write,
kernels are compiled when they are called.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from crowdsim.jit.signatures import Listed, digest, listed, resolve

PACKAGE = Path(__file__).resolve().parent.parent
SECONDS = 2.5
"""Roughly what a kernel takes to compile [s]."""
LONGEST = "run_frames"
"""The kernel that takes longest to compile, about as long as all others of a run."""
PATIENCE = 0.5
"""How long a worker may take to stop, which it does not while it optimises a kernel [s]."""


@contextmanager
def compile_ahead(uses: Collection[str], workers: int) -> Iterator[str]:
    """Let workers compile, while this is open, the kernels that some uses need and that are not compiled yet.

    Args:
        uses: What kernels will be needed for, of those in ``signatures.json``.
        workers: Processes; with fewer than two nothing is compiled ahead, since it would only take turns.

    Yields:
        What is missing, and about how long it takes to compile; nothing where all is there.
    """
    missing = [one for one in listed(uses) if not _is_compiled(one)]
    seconds = max(1, round(SECONDS * len(missing) / max(1, workers)))
    cores = "1 core" if workers < 2 else f"{workers} cores"
    report = f"compiling {len(missing)} kernels, which takes about {seconds} s on {cores} and is done once"
    processes: list[subprocess.Popen[bytes]] = []
    try:
        # A system that has no room for more processes compiles in this one.
        with suppress(OSError):
            for number in range(min(workers, len(missing)) if workers > 1 else 0):
                processes.append(_start(number, uses))
        yield report if missing else ""
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _is_compiled(entry: Listed) -> bool:
    """Return whether a kernel has been compiled for Python and these arguments, on whatever processor.

    True as well where it cannot be kept, so that compiling it ahead is of no use.
    """
    from crowdsim.jit.folders import Folder

    source = PACKAGE.parent.joinpath(*entry.module.split(".")).with_suffix(".py")
    if not source.is_file():
        return True
    folder = Folder(source)
    return bool(folder.problem()) or any(folder.path.glob(f"{entry.name}.{digest(entry.arguments)}.*.nbc"))


def _start(number: int, uses: Collection[str]) -> subprocess.Popen[bytes]:
    # Not from the folder that the command was called in, which may be a checkout of another version.
    program = f"import sys; sys.path = [path for path in sys.path if path]; from {__name__} import work; work()"
    return subprocess.Popen(
        [sys.executable, "-c", program, str(os.getpid()), str(number), *uses],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        start_new_session=True,
    )


def work() -> None:
    """Compile what is listed for some uses, in the order of need; what another process compiles meanwhile is left out.

    The arguments of the program are the number of the process that started it, with which it ends, its own number among
    workers, and the uses. The first one begins with ``LONGEST``.
    """
    from crowdsim.jit.environment import load_numba

    def stop(*_: Any) -> None:
        sys.exit(1)

    signal.signal(signal.SIGTERM, stop)
    warnings.simplefilter("ignore")
    owner, number, uses = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
    load_numba()
    for entry in sorted(listed(uses), key=lambda entry: number == 0 and entry.name != LONGEST):
        if os.getppid() != owner:
            return
        if not _is_compiled(entry):
            compile_listed(entry)


def compile_listed(entry: Listed) -> bool:
    """Compile one kernel unless it is compiled, or another process compiles it; return whether it was done here."""
    try:
        ((kernel, signature),) = resolve([entry])
    except (ImportError, AttributeError):
        # The list is of another version of the package.
        return False
    codegen = kernel.targetctx.codegen()
    if kernel.kept.path(signature, codegen).is_file():
        return False
    with kernel.kept.hold(signature, codegen, wait=False) as mine:
        if not mine or kernel.kept.path(signature, codegen).is_file():
            return False
        kernel.compile_held(signature)
    return True
