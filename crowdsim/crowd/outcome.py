"""How a run ends before its duration: who is still in the fight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.progress import Agenda
from crowdsim.crowd.script import End


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes:
        kind: What ended it, see ``script.End``.
        frame: The control frame in which that was decided.
        standing: Numbers of the avatars that were still in the fight. Shape (n,), int64.
    """

    kind: str
    frame: int
    standing: Array


def find_outcome(until: End, agenda: Agenda, crowd: Crowd) -> Outcome | None:
    """Return how a run ends now, or None where it goes on."""
    progress = agenda.progress
    out = progress.out
    standing = np.flatnonzero(~out & (progress.here | agenda.awaited(crowd.count)))
    if until.kind == "down":
        over = int(np.count_nonzero(out)) >= until.count
    elif until.kind == "landed":
        over = int(progress.landed.sum()) >= until.count
    elif until.kind == "last_team":
        over = len(np.unique(crowd.cast.teams[standing])) <= 1
    else:
        over = len(standing) <= 1
    return Outcome(until.kind, progress.frame, standing) if over else None
