"""How far a batch is: what workers report, what is done, and how long the rest may take."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from crowdsim.batch.documents import read_document
from crowdsim.batch.plan import PlannedRun
from crowdsim.config.documents import DocumentModel
from crowdsim.errors import OutputError
from crowdsim.files import write_text

NAME = "progress.json"
_NEWS = 2.0
"""How often progress is written for others to read [s]."""


_Count = Annotated[int, Field(ge=0, lt=2**63)]
_Seconds = Annotated[float, Field(ge=0, le=1e12)]


class _Stage(DocumentModel):
    """How far a run is."""

    stage: str
    done: _Count
    total: _Count


class _News(DocumentModel):
    """How far a batch is, as it is written."""

    runs: _Count
    done: _Count
    failed: _Count
    seconds: _Seconds
    seconds_left: _Seconds | None
    dashboard: str
    active: dict[str, _Stage]


@dataclass
class Progress:
    """The state of a batch that is going on.

    Attributes:
        folder: Folder of the batch.
        runs: All its runs by id.
        dashboard: Address of the dashboard; empty where there is none.
        done: Runs that are finished, those of before among them.
        failed: Runs that have failed.
        active: Runs that workers are at: stage, how much of it is done, and of how much.
    """

    folder: Path
    runs: Mapping[str, PlannedRun]
    dashboard: str = ""
    done: set[str] = field(default_factory=set)
    failed: set[str] = field(default_factory=set)
    active: dict[str, tuple[str, int, int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Start the clock."""
        self._since = time.monotonic()
        self._written = 0.0
        self._before = set(self.done)

    def begin(self) -> None:
        """Note that runs begin now, and which are finished already."""
        self._since, self._before = time.monotonic(), set(self.done)

    def hear(self, message: Mapping[str, Any]) -> None:
        """Note what a worker reports."""
        run = message.get("run")
        if run in self.runs and run not in self.done | self.failed:
            self.active[str(run)] = (str(message["stage"]), int(message["done"]), int(message["total"]))

    def settle(self, run: str, is_done: bool) -> None:
        """Note that a run has ended."""
        self.active.pop(run, None)
        (self.done if is_done else self.failed).add(run)

    def seconds_left(self) -> float | None:
        """Return about how long the rest takes, by what was done so far; None while nothing is known [s]."""
        costs = {id: max(run.estimate.seconds, 1e-6) for id, run in self.runs.items()}
        ended = sum(costs[id] for id in (self.done | self.failed) - self._before)
        ended += sum(costs[id] * part for id, part in self._parts().items())
        left = sum(costs.values()) - sum(costs[id] for id in self.done | self.failed)
        left -= sum(costs[id] * part for id, part in self._parts().items())
        return (time.monotonic() - self._since) * left / ended if ended > 0 else None

    def _parts(self) -> dict[str, float]:
        """Return how much of each run that is simulated now is done, as a share."""
        return {
            id: min(done / total, 1.0)
            for id, (stage, done, total) in self.active.items()
            if stage == "control" and total > 0
        }

    def describe(self) -> dict[str, Any]:
        """Return it as plain data."""
        left = self.seconds_left()
        return {
            "runs": len(self.runs),
            "done": len(self.done),
            "failed": len(self.failed),
            "seconds": round(time.monotonic() - self._since, 1),
            "seconds_left": None if left is None else round(left, 1),
            "dashboard": self.dashboard,
            "active": {
                id: {"stage": stage, "done": done, "total": total} for id, (stage, done, total) in self.active.items()
            },
        }

    def write(self, now: bool = False) -> None:
        """Write it into the folder of the batch, where it is time to."""
        if now or time.monotonic() - self._written > _NEWS:
            self._written = time.monotonic()
            with suppress(OutputError):
                # A disk that is full stops runs, which say so.
                write_text(self.folder / NAME, json.dumps(self.describe(), indent=1) + "\n")


def read_progress(folder: Path) -> dict[str, Any]:
    """Return how far a batch was when it last reported; nothing where that is not known.

    Raises:
        BatchError: The file is damaged.
    """
    return read_document(folder, NAME, _News)
