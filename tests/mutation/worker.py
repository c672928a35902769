"""A process that is warm, and runs mutants in forks of itself, where a crash is noticed and ends nothing else.

Started with a folder that holds a bundle and a run. It reads lines of JSON: a kind of mutant and a seed, from which
it makes the mutant again. It answers with how the fork ended: 0 where the mutant ran or was refused by an error of this
program, 4 after another exception, negative where a signal ended it.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import subprocess
import sys
import traceback
from pathlib import Path

MEMORY, SECONDS = 512 << 20, 2
"""What a fork may take beyond what the process has [bytes], and how long it may compute [s]."""


class Worker:
    """Runs mutants of a bundle and a run in a process of their own.

    Args:
        folder: The folder of both.
    """

    def __init__(self, folder: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_NUM_THREADS": "1"}
        self._said = folder / "said.txt"
        with open(self._said, "a") as said:
            self._process = subprocess.Popen(
                [sys.executable, __file__, str(folder)], env=environment, text=True,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said,
            )  # fmt: skip
        assert self.receive() == "ready", self._said.read_text()

    def fate(self, kind: str, seed: int) -> str:
        """Run a mutant; return why it must not be so, or an empty text."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps([kind, seed]) + "\n")
        self._process.stdin.flush()
        answer = int(self.receive())
        return f"{kind} {seed} ended with {answer}:\n{self._said.read_text()[-2000:]}" if answer else ""

    def receive(self) -> str:
        """Return a line that the process has written."""
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait(timeout=30)
        self._process.stdout.close()


def _limit() -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _run(base: object, kind: str, seed: int) -> int:
    from crowdsim.errors import CrowdsimError

    _limit()
    try:
        base.run(kind, seed)  # type: ignore[attr-defined]
    except CrowdsimError:
        return 0
    except BaseException:
        traceback.print_exc()
        return 4
    return 0


def _main() -> None:
    import warnings

    import numpy as np
    from runnable import Base

    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    base = Base(Path(sys.argv[1]))
    base.warm_up()
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        kind, seed = json.loads(line)
        with contextlib.suppress(OSError):
            os.truncate(Path(sys.argv[1]) / "said.txt", 0)
        pid = os.fork()
        if pid == 0:
            os._exit(_run(base, kind, seed))
        print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), file=answers, flush=True)


if __name__ == "__main__":
    _main()
