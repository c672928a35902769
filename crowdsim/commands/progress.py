"""Progress bars on standard error."""

from __future__ import annotations

import sys
from typing import Any


class Bars:
    """Progress bars on standard error, one a stage: called with (stage, done, total)."""

    def __init__(self) -> None:
        self._stage = ""
        self._bar: Any = None
        self._finished = ""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Move the bar of a stage to ``done`` of ``total``."""
        from tqdm import tqdm

        if stage == self._finished and done >= total:
            # Where the end was a guess, a stage may go beyond it; its line has been written.
            return
        if stage != self._stage:
            self.close()
            self._stage, self._finished = stage, ""
            self._bar = tqdm(total=total, desc=stage, file=sys.stderr, dynamic_ncols=True, mininterval=0.2)
        self._bar.total = total
        self._bar.update(done - self._bar.n)
        if done >= total:
            self.close()
            self._finished = stage

    def close(self) -> None:
        """Finish the bar that is shown."""
        if self._bar is not None:
            # Between two looks at the clock the bar may have moved on.
            self._bar.refresh()
            self._bar.close()
            self._bar, self._stage = None, ""

    def __enter__(self) -> Bars:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
