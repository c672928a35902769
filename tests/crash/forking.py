"""A process that is warm: it has loaded everything, and forks one that runs a command as soon as it is asked to.

Started as a program in a working folder, it reads lines of JSON, lists of words and maybe a trap each, and answers with
the number of the process that runs them, then with its exit code, negative when it was killed.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path


class Server:
    """Runs commands in forks of a warm process.

    Args:
        folder: Working folder.
        warm: Commands that are run first.
    """

    def __init__(self, folder: Path, warm: list[list[str]]) -> None:
        self.folder = folder
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        self._process = subprocess.Popen(
            [sys.executable, __file__], cwd=folder, env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip
        for words in warm:
            self._send([*words, "--warm"])
            assert self._receive() == 0, f"{words}: {self.said()}"

    def run(self, *words: str, kill_after: float | None = None, trap: dict[str, object] | None = None) -> int:
        """Run a command and return its exit code; kill it after some seconds, unless it has ended before.

        With a ``trap``, the arguments of ``traps.set_trap``, it is killed there.
        """
        self._send([*words, *([trap] if trap else [])])
        pid, begun = self._receive(), time.perf_counter()
        if kill_after is not None:
            time.sleep(max(0.0, kill_after - (time.perf_counter() - begun)))
            with suppress(ProcessLookupError):
                os.kill(pid, 9)
        return self._receive()

    def said(self) -> str:
        """Return what the last command said."""
        return (self.folder / "said.txt").read_text(encoding="utf-8", errors="replace")

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(timeout=30)
        assert self._process.stdout is not None
        self._process.stdout.close()

    def _send(self, words: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(words) + "\n")
        self._process.stdin.flush()

    def _receive(self) -> int:
        assert self._process.stdout is not None
        return int(self._process.stdout.readline())


def _main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    with open("said.txt", "a", encoding="utf-8") as said:
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
    for line in sys.stdin:
        words = json.loads(line)
        os.truncate("said.txt", 0)
        if words[-1] == "--warm":
            answer = _command(words[:-1])
        else:
            pid = os.fork()
            if pid == 0:
                if isinstance(words[-1], dict):
                    from traps import set_trap

                    set_trap(**words.pop())
                os._exit(_command(words))
            print(pid, file=answers, flush=True)
            answer = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        print(answer, file=answers, flush=True)


def _command(words: list[str]) -> int:
    from crowdsim.cli import main

    sys.argv = ["crowdsim", *words]
    try:
        main()
    except SystemExit as leave:
        return int(leave.code or 0)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0


if __name__ == "__main__":
    _main()
