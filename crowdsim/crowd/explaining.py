"""Why avatars do what they do: the actions that they decide among, and what each is worth to them, term by term."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, Model, World
from crowdsim.crowd.buffers import empty_record, empty_scratch
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.kernels.decide import explain
from crowdsim.crowd.kernels.evaluate import TERMS
from crowdsim.crowd.kernels.layout import Now, Observed
from crowdsim.crowd.opponents import build_index
from crowdsim.crowd.stages import Stages, lost_avatar
from crowdsim.crowd.workers import Workers


@dataclass(frozen=True)
class Decision:
    """A decision of an avatar.

    Attributes:
        avatar: Number of the avatar.
        frame: Control frame in which it decides.
        opponent: Whom it decides about, see ``Frame.opponent``.
        actions: The actions that its state has, numbers of its policy's graph. Shape (k,).
        values: What each of ``evaluate.TERMS`` adds to the value of each, in normalised values. Shape (terms, k).
        chosen: The action that it takes; where that is none of these, it falls, rests or gets up.
        margin: How far below the best value a candidate may lie.
        most: How many candidates there are at most.
    """

    avatar: int
    frame: int
    opponent: int
    actions: Array
    values: Array
    chosen: int
    margin: float
    most: int

    @property
    def totals(self) -> Array:
        """What each action is worth. Shape (k,)."""
        totals: Array = self.values.sum(axis=0)
        return totals

    @property
    def candidates(self) -> Array:
        """Places of the actions that it draws among, the best first; one may be struck out by a veto. Shape (c,)."""
        order = np.argsort(-self.totals, kind="stable")
        near = order[self.totals[order] >= self.totals.max() - self.margin] if len(order) else order
        return near[: self.most]


class _Explained(Stages):
    """A frame of which the decisions are noted."""

    def __init__(self, crowd: Crowd, model: Model, avatars: Avatars, workers: Workers) -> None:
        super().__init__(crowd, model, avatars, build_index("kd_tree", workers), workers)
        self._most = crowd.crowding.most
        self.due, self.states = np.zeros(0, np.int64), np.zeros(0, np.int64)
        self.sums = np.zeros((len(TERMS), 0, 0))

    def _decide(self, world: World, now: Now, due: Array, chosen: Array) -> float:
        count = len(due)
        self.due = self._avatars.number[due]
        neighbours = np.empty((count, self._most), np.int32)
        observed = Observed(np.empty(count, np.int32), np.empty(count, np.int32), neighbours)
        scratch = empty_scratch(self._model, self._most, count)
        self.states, self.sums = scratch.states, np.empty((len(TERMS), *scratch.values.shape))
        self._index.observe(self._avatars, due, self._crowding.reach, observed)
        lost = explain(self._model, self._avatars, world, now, due, count, observed, scratch, chosen, self.sums)
        if lost >= 0:
            raise lost_avatar(self._avatars, lost, now.frame)
        return 0.0


def copy_avatars(avatars: Avatars) -> Avatars:
    """Return copies of all arrays of avatars."""
    return Avatars(*(values.copy() for values in avatars))


def explain_frame(
    crowd: Crowd, model: Model, avatars: Avatars, world: World, now: Now, fresh: Array, moves: bool
) -> list[Decision]:
    """Return the decisions of a control frame, in the order of avatars; nothing that is given changes.

    An avatar that is knocked down amid an action decides nothing: it falls, and has no actions to decide among.

    Args:
        crowd: The crowd.
        model: Its policies.
        avatars: Its avatars before that frame.
        world: What they share.
        now: The frame.
        fresh: Slots of avatars that have just entered.
        moves: Whether the others move in this frame.
    """
    workers = Workers(1)
    own = world._replace(weights=world.weights.copy(), cohorts=world.cohorts.copy(), rules=world.rules.copy())
    stages = _Explained(crowd, model, copy_avatars(avatars), workers)
    stages.run(own, now, fresh.copy(), empty_record(1, crowd.count), np.zeros((0, 6), np.int64), moves)
    workers.close()
    after = stages._avatars
    fell = np.setdiff1d(np.flatnonzero(_begun(after) > _begun(avatars)), stages.due)
    order = np.argsort(stages.due)
    found = []
    for number, q in [
        *zip(stages.due[order].tolist(), order.tolist(), strict=True),
        *((one, -1) for one in fell.tolist()),
    ]:
        slot, state = after.slot_of[number], int(stages.states[q]) if q >= 0 else -1
        cohort = own.cohorts[crowd.cohort[number]]
        first, stop = (int(model.offsets[state]), int(model.offsets[state + 1])) if state >= 0 else (0, 0)
        sums = stages.sums[:, q, : stop - first] if q >= 0 else np.zeros((len(TERMS), 0))
        base = int(model.policies["actions"][crowd.cast.policies[number]])
        found.append(
            Decision(
                number,
                now.frame,
                int(after.opponent[slot]),
                np.arange(first, stop) - base,
                np.diff(sums, axis=0, prepend=0.0),
                int(after.motion["action"][slot]) - base,
                float(cohort["margin"]),
                int(cohort["most"]),
            )
        )
    return sorted(found, key=lambda one: one.avatar)


def _begun(avatars: Avatars) -> Array:
    """Return how many actions each avatar has begun. Shape (N,)."""
    begun = np.zeros(len(avatars.number), np.int64)
    begun[avatars.number] = avatars.fight["decisions"]
    return begun
