"""Fights of pairs of avatars, and what follows each action that they choose.

Pairs stand far apart from one another. The first of a pair learns; what the other does follows from its weights. Every
decision is credited with the hits of the next ``HORIZON`` seconds, later ones less: a Monte Carlo estimate of action
values (Sutton and Barto, "Reinforcement Learning", 2nd ed., section 5.3).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from crowdsim.core.threats import CELLS
from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Model
from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.events import Events
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.random import Purpose, uniform
from crowdsim.crowd.simulation import Simulation
from crowdsim.policy.policy import Policy
from crowdsim.scenario.fitness import Damage
from crowdsim.scenario.parts import AvatarType
from crowdsim.training.pursuit import MARGIN, MOST

HORIZON = 0.8
"""How long after a decision hits count for it [s]."""
DISCOUNT = 0.34
"""What a hit counts a second later."""
BLOCKED: float = Damage.model_fields["blocked"].default
"""What a blocked strike counts, of one that lands."""
APART, SPACED = 2.4, 12.0
"""How far from one another the two of a pair begin, and pairs are [m]."""
REACTION: float = AvatarType.model_fields["reaction"].default
"""Time that it takes to see what an opponent has decided [s]."""
TEMPO: float = AvatarType.model_fields["tempo"].default
"""Strikes per minute that avatars can sustain."""


@dataclass(frozen=True)
class Side:
    """How one of each pair chooses.

    Attributes:
        temperature: Randomness of the draw.
        defence: Weight of the table that is learned; a tiny one observes without any effect.
    """

    temperature: float
    defence: float = 0.0


@dataclass
class Tally:
    """What followed actions that were chosen while no strike was seen, in sums over decisions; A actions.

    Cells are those of ``core.threats``.

    Attributes:
        taken: Hits that those who chose the action took. Shape (A, CELLS).
        landed: Hits that they landed. Shape (A, CELLS).
        count: Decisions. Shape (A, CELLS).
    """

    taken: Array
    landed: Array
    count: Array

    @classmethod
    def empty(cls, actions: int) -> Tally:
        """Return a tally of no decisions."""
        return cls(*(np.zeros((actions, CELLS)) for _ in range(3)))

    def fade(self, share: float) -> None:
        """Let what was counted so far count less."""
        for values in (self.taken, self.landed, self.count):
            values *= share


def start_fights(
    policies: Sequence[Policy], model: Model, pairs: int, first: Side, other: Side, seed: int
) -> Simulation:
    """Return fights of pairs; avatars ``k`` and ``pairs + k`` are a pair, ``k`` the first of it.

    Args:
        policies: What the first of each pair has learned, then the other; one policy for both.
        model: Their arrays, with the table that is learned.
        pairs: Number of pairs, at most 200.
        first: How the first of each pair chooses.
        other: How the other one does.
        seed: Seed of every draw.
    """
    sides = np.arange(2 * pairs) // pairs
    number = np.arange(2 * pairs) % pairs
    row = math.ceil(math.sqrt(pairs))
    turned = 2.0 * math.pi * uniform(seed, Purpose.FACING, number)
    away = (sides - 0.5) * APART
    rate = policies[0].database.control_rate
    both = (first, other)
    crowd = build_crowd(
        SPACED * (number % row) + away * np.sin(turned),
        SPACED * (number // row) + away * np.cos(turned),
        turned + math.pi * sides,
        team=sides,
        cohort=sides.astype(np.int16),
        policy=sides * (len(policies) - 1),
        weights=np.stack([policies[0].weights, policies[-1].weights]),
        margins=np.full(2, MARGIN),
        temperatures=np.array([side.temperature for side in both]),
        intervals=np.full(2, 60.0 * rate / TEMPO),
        varieties=np.full(2, 1.0),
        defences=np.array([side.defence for side in both]),
        reactions=np.full(2, math.ceil(round(REACTION * rate, 6))),
        seed=seed,
        policies=policies,
    )
    crowd = replace(crowd, hysteresis=np.zeros(2), most=np.full(2, MOST, np.int32))
    return Simulation(crowd, model=model)


def watch_fights(
    simulation: Simulation, frames: int, learners: Array, tally: Tally, report: Callable[[int, int], None] | None = None
) -> None:
    """Run fights, and add to a tally what follows the decisions of some avatars.

    Args:
        simulation: The fights.
        frames: Control frames.
        learners: Whose decisions count. Shape (N,), bool.
        tally: What is added to.
        report: Called with frames done and frames.
    """
    count = simulation.crowd.count
    avatars, decisions_of = simulation.avatars, simulation.avatars.fight["decisions"]
    decided = decisions_of.copy()
    decisions, taken, landed = [], np.zeros((frames, count)), np.zeros((frames, count))
    for frame in range(frames):
        events = simulation.run(1).events
        threats = avatars.fight["threat"]
        slots = np.flatnonzero((decisions_of != decided) & (threats >= 0))
        decided = decisions_of.copy()
        numbers = avatars.number[slots]
        row = np.stack([np.full(len(slots), frame), numbers, avatars.motion["action"][slots], threats[slots]])
        decisions.append(row[:, learners[numbers]])
        worth = _worth(events)
        np.add.at(taken[frame], events.victim[worth > 0.0], worth[worth > 0.0])
        np.add.at(landed[frame], events.attacker[worth > 0.0], worth[worth > 0.0])
        if report is not None and frame % 100 == 99:
            report(frame + 1, frames)
    when, who, action, cell = np.concatenate(decisions, axis=1)
    horizon = round(HORIZON * simulation.rate)
    kept = when < frames - horizon
    when, who, at = when[kept], who[kept], (action[kept], cell[kept])
    fade = DISCOUNT ** (1.0 / simulation.rate)
    np.add.at(tally.taken, at, _later(taken, horizon, fade)[when, who])
    np.add.at(tally.landed, at, _later(landed, horizon, fade)[when, who])
    np.add.at(tally.count, at, 1.0)


def _worth(events: Events) -> Array:
    """Return what each strike counts: 1 where it lands, ``BLOCKED`` where it is blocked, otherwise 0. Shape (E,)."""
    worth = np.where(events.outcome == layout.LANDED, 1.0, np.where(events.outcome == layout.BLOCKED, BLOCKED, 0.0))
    return np.where(events.victim >= 0, worth, 0.0)


def _later(hits: Array, horizon: int, fade: float) -> Array:
    """Return the hits of the frames behind each frame, the nearest counting most. Shape as ``hits``, (F, N)."""
    padded = np.concatenate([hits, np.zeros((horizon, hits.shape[1]))])
    return np.sum([fade**d * padded[d : d + len(hits)] for d in range(1, horizon + 1)], axis=0)
