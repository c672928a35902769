"""How much time a victim has to react: from the attacker's decision to the impact, read from takes.

An avatar decides when an action ends, in a control frame; what it has chosen is seen from then on. A victim can react
to a strike where it takes a decision of its own at least ``REACTION`` after the attacker's and before the impact.
Everything that starts an action counts as a decision, so takes are of scenes in which nobody is hurt.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.take.take import Take

REACTION = 0.2
"""Time that it takes to see what is coming [s]."""
PERCENTILES = (5, 50, 95)
_ROUNDING = 1e-3
"""Below what times of a take differ because they are rounded [control frames]."""


def find_starts(take: Take) -> Array:
    """Return whether an avatar has started an action in or since the frame before. Shape (F, N), bool."""
    starts = np.ones(take.action.shape, bool)
    starts[1:] = (np.diff(take.action, axis=0) != 0) | (np.diff(take.action_frame, axis=0) <= 0.0)
    return starts


def find_decisions(take: Take) -> Array:
    """Return the frame in which the action that each avatar does was chosen. Shape (F, N), int64."""
    starts = find_starts(take)
    frames = np.arange(len(starts))[:, None]
    return np.maximum.accumulate(np.where(starts, frames, 0), axis=0)


def reaction_times(take: Take) -> tuple[Array, Array]:
    """Return, for each strike at an avatar, its lead and whether its victim could react.

    Returns:
        leads: Time from the attacker's decision to the impact, 0 of a strike that begins an action [s]. Shape (S,).
        reactable: Whether the victim has decided in time. Shape (S,), bool.
    """
    decisions, starts, events = find_decisions(take), find_starts(take), take.events
    at_avatars = np.asarray(events.victim) >= 0
    impact = np.asarray(events.frame, float)[at_avatars]
    attacker, victim = (np.asarray(who, np.int64)[at_avatars] for who in (events.attacker, events.victim))
    # The frame that shows the strike. The action in it may have started after the strike, which the one before holds.
    shown = np.ceil(impact - _ROUNDING).astype(np.int64)
    began = shown - take.action_frame[shown, attacker] / take.cast.speeds[attacker]
    later = starts[shown, attacker] & (impact <= began + _ROUNDING)
    thrown = decisions[np.maximum(shown - later, 0), attacker]
    answered = decisions[np.maximum(shown - 1, 0), victim]
    in_time = answered - thrown >= REACTION * take.control_rate - _ROUNDING
    return np.maximum(impact - thrown, 0.0) / take.control_rate, in_time


def measure_reactions(takes: Sequence[Take]) -> dict[str, Any]:
    """Return percentiles of the time that victims have, and the share of strikes that they could react to."""
    found = [reaction_times(take) for take in takes]
    leads, reactable = (np.concatenate([one[k] for one in found]) for k in (0, 1))
    if len(leads) == 0:
        return {"strikes": 0, "lead_seconds": [None] * len(PERCENTILES), "reactable_share": None}
    return {
        "strikes": len(leads),
        "lead_seconds": np.percentile(leads, PERCENTILES).tolist(),
        "reactable_share": float(reactable.mean()),
    }


def lines(found: Mapping[str, Any]) -> Iterator[str]:
    """Yield the table of reaction times, a line each."""
    yield f"{'decision to impact [s]':<26}" + "".join(f"{f'{p} %':>9}" for p in PERCENTILES) + f"{'reactable':>12}"
    for name, figures in found.items():
        if figures["strikes"]:
            leads = "".join(f"{lead:9.2f}" for lead in figures["lead_seconds"])
            yield f"{name:<26}{leads}{figures['reactable_share']:12.1%}"
