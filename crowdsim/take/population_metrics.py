"""What the avatars of a run are like: their bodies, temperaments and stances, and how well they keep these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.record import TakeData
from crowdsim.crowd.stances import leading_feet
from crowdsim.poses.motion import fallen_frames
from crowdsim.take.measures import chunks_of
from crowdsim.take.spreads import PERCENTILES

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy

_SIGNS = np.array([0, 1, -1])
"""Which foot leads in each stance: 1 the left one, -1 the right one, 0 either."""


@dataclass(frozen=True)
class People:
    """What avatars are like: the 10th, 50th and 90th percentile over all of them, and counts.

    Attributes:
        scale_spread: Size of the body over its skeleton's.
        girth_spread: Thickness of trunk and limbs for their length.
        legs_spread: Length of thighs and shanks for the size of the body.
        arms_spread: Length of upper arms and forearms for it.
        tempo_spread: Strikes a minute that an avatar can sustain; None where the take says it of none, or none tires.
        aggression_spread: How readily it strikes, as a factor.
        range_spread: How much further than others it keeps from its opponent while it rests [m].
        orthodox: Avatars that keep the left foot in front.
        southpaws: Avatars that keep the right foot in front.
        stance_share: Share of the time in which these do, of that in which one of their feet is in front; None where
            no avatar has a stance.
    """

    scale_spread: list[float] | None
    girth_spread: list[float] | None
    legs_spread: list[float] | None
    arms_spread: list[float] | None
    tempo_spread: list[float] | None
    aggression_spread: list[float] | None
    range_spread: list[float] | None
    orthodox: int
    southpaws: int
    stance_share: float | None


def measure_people(take: TakeData, policies: Sequence[Policy]) -> People:
    """Return what the avatars of a take are like.

    Args:
        take: The take, in memory or lazily read.
        policies: Its policies.
    """
    cast = take.cast
    counts = np.bincount(cast.stances, minlength=len(_SIGNS))
    return People(
        scale_spread=_spread(cast.scales),
        girth_spread=_spread(cast.girths),
        legs_spread=_spread(cast.legs),
        arms_spread=_spread(cast.arms),
        tempo_spread=_spread(cast.tempos),
        aggression_spread=_spread(cast.aggressions),
        range_spread=_spread(cast.ranges),
        orthodox=int(counts[1]),
        southpaws=int(counts[2]),
        stance_share=_stance_share(take, policies),
    )


def _spread(values: Array) -> list[float] | None:
    known = np.asarray(values, float)[np.isfinite(values)]
    return [float(value) for value in np.percentile(known, PERCENTILES)] if len(known) else None


def _stance_share(take: TakeData, policies: Sequence[Policy]) -> float | None:
    """Return for which share of the time the right foot leads, of avatars with a stance that are up."""
    cast = take.cast
    if not cast.stances.any():
        return None
    kept = other = 0
    for index, policy in enumerate(policies):
        own = np.flatnonzero((cast.policies == index) & (cast.stances > 0))
        if not len(own):
            continue
        database = policy.database
        leads = np.where(fallen_frames(database)[:: database.stride], 0, leading_feet(database)).astype(np.int64)
        first, lengths = (
            np.asarray(values, np.int64) for values in (policy.graph.action_first, policy.actions.lengths)
        )
        for chunk in chunks_of(take):
            action, done = np.asarray(chunk.action)[:, own], np.asarray(chunk.action_frame)[:, own]
            some = np.maximum(action, 0)
            frames = first[some] - 1 + np.rint(np.minimum(done, lengths[some])).astype(np.int64)
            signs = np.where(action >= 0, leads[frames] * _SIGNS[cast.stances[own]], 0)
            kept += int(np.count_nonzero(signs > 0))
            other += int(np.count_nonzero(signs < 0))
    return kept / (kept + other) if kept + other else None
