"""Breaks between rounds: how soon boxers stand at ease, and for how much of the break."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from crowdsim.policy.policy import Policy
from crowdsim.take.take import Take

BREAKS = ((8.0, 18.0), (26.0, 36.0))
"""Start and end of each break [s]."""
SCENE = (
    "duration=36s", "until=null", "types.boxer.damage=null", "types.boxer.stamina=null",
    *(f"events.{k}.when.seconds={seconds}" for k, seconds in enumerate(np.ravel(BREAKS).tolist())),
)  # fmt: skip
"""Overrides for `bout`: nobody goes down, and breaks come early."""


def measure_breaks(takes: Sequence[Take], policy: Policy) -> dict[str, Any]:
    """Return how boxers come to rest in the breaks of runs of one policy with rests.

    Returns:
        ``count``, breaks, counted for each boxer; ``seconds``, median time until the boxer drops its guard [s], None
        where most never do; ``never_share``, share of breaks in which it never does; ``ease_share``, share of the time
        in breaks that it stands at ease or drops its guard.
    """
    rests = policy.rests
    assert rests is not None, "the policy has rests"
    at_ease = np.concatenate([rests.enter, rests.hold])
    parts = []
    for take in takes:
        for start, stop in BREAKS:
            first, last = (round(seconds * take.control_rate) for seconds in (start, stop))
            if last <= take.frame_count:
                parts.append(np.isin(np.asarray(take.action[first:last]), at_ease))
    found = np.concatenate(parts, axis=1)
    comes = np.asarray(found.any(axis=0))
    seconds = np.where(comes, found.argmax(axis=0) / takes[0].control_rate, np.inf)
    return {
        "count": len(comes),
        "seconds": float(np.median(seconds)) if np.isfinite(np.median(seconds)) else None,
        "never_share": float(np.mean(~comes)),
        "ease_share": float(found.mean()),
    }


def lines(outcome: Mapping[str, Any]) -> Iterator[str]:
    """Yield the figures, a line each."""
    seconds = outcome["seconds"]
    yield f"breaks of ten seconds between rounds, {outcome['count']} counted for each boxer"
    yield f"  {'until at ease, median':<28}" + ("   never" if seconds is None else f"{seconds:7.1f} s")
    yield f"  {'never at ease':<28}{outcome['never_share']:8.1%}"
    yield f"  {'share of breaks at ease':<28}{outcome['ease_share']:8.1%}"
