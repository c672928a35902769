"""Strikes of a take that touch: attacker, victim and time.

They land, or are blocked; and some miss, for being too deep in a body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.layout import BLOCKED
from crowdsim.crowd.record import TakeData
from crowdsim.poses.kernels.fists import LEAN

SPANS = (0.16, 0.22)
"""Time before and after a strike over which the limb leaves its captured path [s]."""
TOGETHER = 0.07
"""Strikes of a limb that are no further apart are one: a transition shortly after a strike showed it again [s]."""


@dataclass(frozen=True)
class Landed:
    """Landed and blocked strikes in order of time, and others whose fists or feet would be seen in a body; E strikes.

    Attributes:
        times: When [s]. Shape (E,).
        attackers: Shape (E,).
        victims: Shape (E,); below -1 a scripted target.
        hands: Side of the limb, 0 left, 1 right. Shape (E,).
        limbs: Numbers of ``strikers.LIMBS``. Shape (E,).
        points: Where the fist or foot was [m]. Shape (E, 3).
        speeds: Shape (E,) [m/s].
        spans: How long before and after it the limb may be on its way: to its strikes before and after, and no
            longer than ``LEAN`` [s]. Shape (E, 2).
        again: Whether it is one with the limb's strike before. Shape (E,).
        missed: Whether it neither landed nor was blocked. Shape (E,).
        blocked: Whether a forearm or glove of the victim stopped it. Shape (E,).
    """

    times: Array
    attackers: Array
    victims: Array
    hands: Array
    limbs: Array
    points: Array
    speeds: Array
    spans: Array
    again: Array
    missed: Array
    blocked: Array

    def between(self, first: float, last: float) -> Landed:
        """Return those from ``first`` to ``last`` [s]."""
        low, high = np.searchsorted(self.times, (first, last))
        return self.of(slice(low, high))

    def around(self, first: float, last: float, columns: Array) -> Landed:
        """Return those for which avatars with a column (N,), not -1, strike or lean from ``first`` to ``last`` [s]."""
        near = self.between(first - LEAN - TOGETHER, last + LEAN + TOGETHER)
        return near.of(columns[near.attackers] >= 0)

    def around_each(self, avatars: Array, times: Array, within: float) -> Landed:
        """Return those of some avatars (E,) no further from their times (E,) than ``within``, and few others [s]."""
        within += TOGETHER + 1e-3
        near = self.between(times.min() - within, times.max() + within)
        # Times of all avatars one after another on one line.
        line = 2.0 * (float(times.max()) + within) + 1.0
        asked, keys = np.sort(avatars * line + times), near.attackers * line + near.times
        at = np.searchsorted(asked, keys - within)
        return near.of(np.append(asked, np.inf)[at] <= keys + within)

    def of(self, chosen: Any) -> Landed:
        """Return some of them, by index, slice or mask."""
        return Landed(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


def find_landed(take: TakeData, buried: Array | None = None) -> Landed:
    """Return a take's landed and blocked strikes and those that are ``buried`` (E,).

    Of two of a limb at once it is the first, and of two that are one the one that lands.
    """
    events = take.events
    blocked = np.asarray(events.outcome) == BLOCKED
    result = np.asarray(events.landed, dtype=bool) | blocked
    landed = np.flatnonzero(result if buried is None else result | buried)
    frames = np.asarray(events.frame, dtype=np.float64)[landed]
    attackers = np.asarray(events.attacker)[landed].astype(np.int64)
    limbs = np.asarray(events.limb)[landed].astype(np.int64)
    times = frames / take.control_rate
    order = np.lexsort((landed, times, limbs, attackers))
    same = (np.diff(attackers[order]) == 0) & (np.diff(limbs[order]) == 0)
    gaps = np.where(same, np.diff(times[order]), np.inf)
    twice = np.concatenate([[False], gaps < 1e-6]) if len(order) else np.zeros(0, bool)
    order = order[~(twice | _beside_landed(np.asarray(events.landed, dtype=bool)[landed][order], gaps))]
    same = (np.diff(attackers[order]) == 0) & (np.diff(limbs[order]) == 0)
    gaps = np.where(same, np.diff(times[order]), np.inf)
    ends = [np.inf] if len(order) else []
    spans = np.stack([np.concatenate([ends, gaps]), np.concatenate([gaps, ends])], axis=1)
    again = spans[:, 0] <= TOGETHER
    spans = np.minimum(spans, LEAN)
    later = np.lexsort((order, times[order]))
    order, spans, again = order[later], spans[later], again[later]
    chosen = landed[order]
    return Landed(
        times=times[order],
        attackers=attackers[order],
        victims=np.asarray(events.victim)[chosen].astype(np.int64),
        hands=limbs[order] % 2,
        limbs=limbs[order],
        points=np.asarray(events.point, dtype=np.float64)[chosen].reshape(-1, 3),
        speeds=np.asarray(events.speed)[chosen].astype(np.float64),
        spans=spans,
        again=again,
        missed=~result[chosen],
        blocked=blocked[chosen],
    )


def _beside_landed(lands: Array, gaps: Array) -> Array:
    """Which strikes (E,) do not land but are one with a strike that does: a fist is not stopped and lands at once.

    Args:
        lands: Which land, those of a limb one after another. Shape (E,).
        gaps: Time to the next one of the limb, infinite for the last one [s]. Shape (E - 1,).
    """
    found = np.zeros(len(lands), bool)
    found[:-1] |= lands[1:] & (gaps <= TOGETHER)
    found[1:] |= lands[:-1] & (gaps <= TOGETHER)
    return found & ~lands


def by_column(columns: Array, count: int, times: Array) -> tuple[Array, Array]:
    """Return an order by column, then time, and where each of ``count`` columns begins in it. Shapes (E,), (n + 1,)."""
    order = np.lexsort((times, columns))
    return order, np.searchsorted(columns[order], np.arange(count + 1))
