"""What a model knows of guards: how long hands hang in each action, and until they are up again behind it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

AROUND = 1.0
"""Time before and after a strike in which a fighter is in its usual guard [s]."""
HANGS = 0.1
"""Height of the lower fist over the pelvis, over its usual one near strikes, up to which the guard is dropped."""
LEAST = 0.25
"""Shortest time in which hands hang [s]: a fist that only dips on its way is no dropped guard."""
LATER = 0.6
"""What a second without guard counts a second later."""
_SWEEPS, _SETTLED = 200, 1e-4


def unguarded_rows(policy: Policy) -> Array:
    """Return how long hands hang in each action, and at least behind it, which counts less [s]. Shape (A,), float32.

    Zero where the motion has no strikes, by which its guard could be known.
    """
    database, actions = policy.database, policy.actions
    if not len(database.strike_frames):
        return np.zeros(actions.action_count, np.float32)
    rate = database.control_rate
    hanging = np.concatenate([[0.0], np.cumsum(drops_guard(policy)[:: database.stride])]) / rate
    first, lengths = np.asarray(policy.graph.action_first, np.int64), np.asarray(actions.lengths, np.int64)
    spent, fades = hanging[first + lengths] - hanging[first], LATER ** (lengths / rate)
    later, choices = np.zeros(actions.state_count), slice(0, actions.choice_count)
    for _ in range(_SWEEPS):
        before = later
        later = np.minimum.reduceat((spent + fades * before[actions.next])[choices], actions.offsets[:-1])
        if np.abs(later - before).max() < _SETTLED:
            break
    return np.asarray(spent + fades * later[actions.next], np.float32)


def drops_guard(policy: Policy) -> Array:
    """Return in which frames of a policy's motion a hand hangs that is up where it strikes. Shape (F,), bool."""
    database = policy.database
    lower = (database.fists[..., 1] - database.pelvises[:, None, 1]).min(axis=1)
    reach, fights = round(AROUND * database.playback_rate), np.zeros(len(lower), bool)
    for frame in database.strike_frames:
        fights[max(frame - reach, 0) : frame + reach + 1] = True
    dropped = lower < HANGS * np.median(lower[fights])
    # Where it begins and ceases to hang. Shape (n, 2).
    spans = np.flatnonzero(np.diff(dropped, prepend=False, append=False)).reshape(-1, 2)
    for first, end in spans[np.diff(spans)[:, 0] < round(LEAST * database.playback_rate)]:
        dropped[first:end] = False
    return np.asarray(dropped)
