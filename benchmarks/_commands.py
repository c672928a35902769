"""Whole commands in processes of their own, as a user waits for them."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PROGRAM = "from crowdsim.cli import main; main()"


def whole_command(*words: str, kernels: Path | None = None) -> dict[str, float]:
    """Run a command of crowdsim; return its wall and CPU time [s] and the most memory of a process [bytes].

    Args:
        words: Its arguments.
        kernels: Folder of compiled kernels; the usual one when None.
    """
    environment = {**os.environ, **({"NUMBA_CACHE_DIR": str(kernels)} if kernels else {})}
    with tempfile.TemporaryFile("w+") as said:
        started = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *words, "--quiet"], env=environment, stdout=subprocess.DEVNULL, stderr=said
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            sys.exit(said.read().strip() or f"crowdsim {' '.join(words)} failed")
    return {
        "wall_seconds": seconds,
        "cpu_seconds": usage.ru_utime + usage.ru_stime,
        "peak_bytes": usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024),
    }


def warm_and_cold(folder: Path, *words: str) -> dict[str, dict[str, float]]:
    """Measure a command that writes to ``--out`` with compiled kernels and, in ``cold``, with none.

    Args:
        folder: A folder for what it writes.
        words: Its arguments, but for ``--out``.
    """
    # What the first one compiles the second one finds.
    whole_command(*words, "--out", str(folder / "before"))
    warm = whole_command(*words, "--out", str(folder / "warm"))
    with tempfile.TemporaryDirectory() as kernels:
        cold = whole_command(*words, "--out", str(folder / "cold"), kernels=Path(kernels))
    return {"warm": warm, "cold": cold}
