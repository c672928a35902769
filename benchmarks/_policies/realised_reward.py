"""What avatars of a run earn by given reward terms: from where they are, what they throw, and their transitions."""

from __future__ import annotations

from typing import Any

import numpy as np

from crowdsim.crowd.chunk import Chunk
from crowdsim.policy.policy import Policy
from crowdsim.policy.rewards import WASTED, ProximityTerm, StrikeTerm, Term, TransitionTerm
from crowdsim.take.measures import opponent_offsets


class RewardCounter:
    """Adds up what the avatars of a run earn, not discounted, chunk by chunk.

    Proximity counts in every frame, strikes and their costs when they are thrown, transitions when they happen; maxima
    count as sums. A strike's speed is taken over the mean of the policy's own strikes, places over an avatar's scale.

    Args:
        terms: The reward's terms.
        policy: What all avatars run.
        scales: Scale of each avatar. Shape (N,).
    """

    def __init__(self, terms: tuple[Term, ...], policy: Policy, scales: Any) -> None:
        self._terms, self._scales = terms, np.asarray(scales, dtype=float)
        self._costs = np.asarray(policy.actions.costs, dtype=float)
        self._speed = float(np.mean(policy.database.strike_speeds))
        self._last: tuple[Any, Any] | None = None
        self._total, self._frames = 0.0, 0

    def add(self, chunk: Chunk) -> None:
        """Count one more chunk; chunks come in the order of time."""
        dx, dz, known = opponent_offsets(chunk)
        cos, sin = np.cos(chunk.heading), np.sin(chunk.heading)
        aside, ahead = (dx * cos - dz * sin) / self._scales, (dx * sin + dz * cos) / self._scales
        costs = self._transitions(chunk)
        self._frames += int(np.count_nonzero(chunk.action >= 0))
        for term in self._terms:
            if isinstance(term, ProximityTerm):
                self._total += term.weight * float(_nearness(term, aside[known], ahead[known]).sum())
            elif isinstance(term, TransitionTerm):
                self._total -= float((term.weight * costs + term.each).sum())
            elif isinstance(term, StrikeTerm):
                self._total += term.weight * self._strikes(term, chunk, dx, dz, known)

    def mean(self) -> float:
        """Return what an avatar earns in a control frame."""
        return self._total / max(self._frames, 1)

    def _transitions(self, chunk: Chunk) -> Any:
        """Return the costs of the transitions that happen in a chunk. Flat."""
        action, done = chunk.action, chunk.action_frame
        if self._last is not None:
            action, done = np.vstack([self._last[0], action]), np.vstack([self._last[1], done])
        begun = (action[1:] >= 0) & ((np.diff(action, axis=0) != 0) | (np.diff(done, axis=0) <= 0.0))
        self._last = action[-1:].copy(), done[-1:].copy()
        costs = self._costs[action[1:][begun]]
        return costs[costs > 0.0]

    def _strikes(self, term: StrikeTerm, chunk: Chunk, dx: Any, dz: Any, known: Any) -> float:
        """Return what the strikes of a chunk earn, but for the weight."""
        events = chunk.events
        row = np.clip(np.round(events.frame).astype(int) - chunk.first, 0, chunk.frames - 1)
        who = np.asarray(events.attacker, int)
        x, z = chunk.x[row, who] + dx[row, who], chunk.z[row, who] + dz[row, who]
        away = np.hypot(events.point[:, 0] - x, events.point[:, 2] - z) / self._scales[who]
        wasted = known[row, who] & (away > WASTED)
        landed = np.asarray(events.speed, float)[np.asarray(events.landed, bool)] / self._speed
        spent = term.effort * len(who) + term.waste * np.count_nonzero(wasted)
        return float((landed**term.speed_weight).sum() - spent)


def _nearness(term: ProximityTerm, aside: Any, ahead: Any) -> Any:
    near, far = term.between
    distance = ahead if term.facing else np.hypot(aside, ahead)
    gap = np.abs(distance - np.clip(distance, near, far))
    if term.facing:
        gap = np.hypot(gap, np.maximum(np.abs(aside) - term.aside, 0.0))
    return np.exp(-gap / term.sigma)
