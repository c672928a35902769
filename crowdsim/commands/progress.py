"""Progress on standard error: bars on a terminal, elsewhere a line a stage."""

from __future__ import annotations

import shutil
import sys
from time import perf_counter
from typing import Any

from crowdsim.commands import common
from crowdsim.commands.process import escaped, terminal


class Bars:
    """Progress on standard error, called with (stage, done, total).

    On a terminal each stage has a bar. Elsewhere it has one line of plain text when it ends. With ``--quiet`` there is
    neither.
    """

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._quiet = common.talk.quiet
        self._stage = ""
        self._bar: Any = None
        self._reached = (0, 0)
        self._since = 0.0
        self._finished = ""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Move a stage to ``done`` of ``total``."""
        if self._quiet or (stage == self._finished and done >= total):
            # Where the end was a guess, a stage may go beyond it; its line has been written.
            return
        if stage != self._stage:
            self.close()
            self._begin(stage, total)
        self._reached = (done, total)
        if self._bar is not None:
            self._bar.total = total
            self._bar.update(done - self._bar.n)
        if done >= total:
            self.close()
            self._finished = stage

    def note(self, text: str) -> None:
        """Print a line of its own, above the bar where there is one."""
        if self._quiet:
            return
        if self._bar is not None:
            self._bar.clear()
        print(text, file=sys.stderr, flush=True)
        if self._bar is not None:
            self._bar.refresh()

    def close(self) -> None:
        """Finish the stage that is shown."""
        if self._bar is not None:
            # Between two looks at the clock the bar may have moved on.
            self._bar.refresh()
            self._bar.close()
        elif self._stage:
            done, total = self._reached
            count = f"{done:,} of {total:,}, " if total > 1 else ""
            print(f"{self._stage}: {count}{perf_counter() - self._since:.1f} s", file=sys.stderr, flush=True)
        self._bar, self._stage = None, ""

    def _begin(self, stage: str, total: int) -> None:
        self._stage, self._finished, self._since = stage, "", perf_counter()
        if self._live:
            from tqdm import tqdm

            # Some terminals say that they have no columns.
            columns = None if shutil.get_terminal_size((0, 0)).columns else 80
            self._bar = tqdm(
                total=total,
                desc=escaped(stage),
                file=terminal(),
                ncols=columns,
                dynamic_ncols=columns is None,
                mininterval=0.2,
            )

    def __enter__(self) -> Bars:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
