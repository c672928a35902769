"""Knock-downs: how soon an avatar falls after the blow, and which way."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.take.take import Take

WITHIN = 3.0
"""Time after a knock-down within which its fall is looked for [s]."""


def measure_knock_downs(takes: Sequence[Take], falls: Array) -> dict[str, Any]:
    """Return how avatars fall that are knocked down.

    Args:
        takes: Runs of one policy.
        falls: Its actions that lead from standing to lying (``Falls.fall``). Shape (F,).

    Returns:
        ``knock_downs``, their number; ``seen``, those whose fall begins before the run ends; ``delay_median``,
        ``delay_95`` and ``delay_most``, percentiles of the time from the blow to the fall [s]; ``away_share``, of falls
        that lead away from the attacker: by less than a right angle from the line from it to the victim at the blow.
    """
    count, delays, angles = 0, [], []
    for take in takes:
        events, action = take.events, np.asarray(take.action)
        places = np.stack([np.asarray(take.x, dtype=float), np.asarray(take.z, dtype=float)], axis=-1)
        within = int(WITHIN * take.control_rate)
        for k in np.flatnonzero(events.down):
            attacker, victim, frame = int(events.attacker[k]), int(events.victim[k]), float(events.frame[k])
            count, row = count + 1, int(np.ceil(frame))
            falling = np.isin(action[:, victim], falls)
            starts = np.flatnonzero(falling[row : row + within])
            if not len(starts):
                continue
            start = row + int(starts[0])
            delays.append((start - frame) / take.control_rate)
            stop = start + int(np.argmin(np.append(falling[start:], False)))
            if stop < len(action):
                way, blow = places[stop, victim] - places[start, victim], places[row, victim] - places[row, attacker]
                angles.append(abs(np.arctan2(way[0] * blow[1] - way[1] * blow[0], way @ blow)))
    percentiles = np.percentile(delays, (50, 95, 100)).tolist() if delays else [None] * 3
    return {
        "knock_downs": count,
        "seen": len(delays),
        **dict(zip(("delay_median", "delay_95", "delay_most"), percentiles, strict=True)),
        "away_share": float(np.mean(np.array(angles) < 0.5 * np.pi)) if angles else None,
    }


def lines(outcome: Mapping[str, Any]) -> Iterator[str]:
    """Yield the figures, a line each."""
    yield f"knock-downs {outcome['knock_downs']}, of which {outcome['seen']} are seen to fall"
    if outcome["delay_median"] is not None:
        times = (outcome[f"delay_{name}"] for name in ("median", "95", "most"))
        yield "  {:<28}{:8.2f}{:8.2f}{:8.2f}".format("after, 50, 95, 100 % [s]", *times)
    if outcome["away_share"] is not None:
        yield f"  {'away from the attacker':<28}{outcome['away_share']:8.1%}"
