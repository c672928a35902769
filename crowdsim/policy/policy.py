"""A trained policy: the motion, the graph over it, and for each behaviour what its values are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.errors import PolicyError, nearest
from crowdsim.motion import ground
from crowdsim.policy.action_rewards import action_reward
from crowdsim.policy.actions import Actions
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.policy.environment import AXIS_WIDTH, HALFWAY, LEAD, Grid, corners, fade_factor
from crowdsim.policy.falls import Falls
from crowdsim.policy.rests import Rests
from crowdsim.policy.rewards import TERM_WIDTH, TargetBody, Term, TransitionTerm, pack_terms

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.motion.database import MotionDatabase


LOOKUPS = ("q", "v")


class StateValues(NamedTuple):
    """V of each state, in whole steps: what a table of Q in bytes is one backup of (``training.behaviours``).

    Attributes:
        table: V(state, cell) at ``s * cells + c``. Flat, uint16.
        low: What an entry of 0 is worth.
        step: What an entry is worth more than the one below it.
        spread: The scale on which the behaviour decides, see ``Behaviour.scale``, normalised or not.
    """

    table: Array
    low: float
    step: float
    spread: float


@dataclass(frozen=True)
class Behaviour:
    """What an avatar has learned to do to its target, such as ``approach`` or ``punch``.

    Attributes:
        name: What a scenario calls it.
        grid: The environment's grid.
        lookup: ``q``: the table holds Q(action, cell); entry of state s, cell c and its k-th action is
            ``offsets[s] * cells + c * n + k``, where n is the number of actions of s, so that actions lie side by side.
            ``v``: it holds V(state, cell) at ``s * cells + c``, and Q(action, e) is the action's own reward, exactly
            where the target is, plus gamma^T times V interpolated where the target will be.
        table: The values, flat. Shape (A * cells,) or (S * cells,), float32; or uint8 or uint16, whole numbers of
            steps.
        scale: How much better the best action of a state is than the median one (``scales.decisive_scale``). Values are
            divided by it before behaviours are added up. 0: the behaviour has no preference and counts for nothing.
        terms: The reward's terms.
        discount: gamma, a control frame.
        low: What an entry of 0 is worth.
        step: What an entry is worth more than the one below it.
        state_values: Where the table is one of Q in bytes that has just been trained: the values behind it. Bundles
            keep them for packing; they are not read with a policy.
    """

    name: str
    grid: Grid
    lookup: str
    table: Array
    scale: float
    terms: tuple[Term, ...]
    discount: float
    low: float = 0.0
    step: float = 1.0
    state_values: StateValues | None = None

    def values(self, entries: Any = slice(None)) -> Array:
        """Return entries of the table as numbers, float64."""
        numbers: Array = self.low + self.step * self.table[entries].astype(np.float64)
        return numbers


class LookupTables(NamedTuple):
    """All that control needs of a policy as flat arrays, for compiled code, which can be handed all of it at once.

    ``kernels/values.py`` reads exactly this, and names the columns. B is the number of behaviours.

    Attributes:
        actions: The graph's actions; see ``Actions``.
        behaviours: A row for each behaviour. Shape (B, 11), float64, whole numbers where they are places or counts:
            first and end row in ``axes``; first and end row in ``terms``; look-up (0 is q, 1 is v); number of cells;
            first entry in ``table``; scale; discount; what an entry of 0 is worth, and a step of 1 more.
        axes: A row for each axis of each grid. Shape (n, 9), float64; see ``Grid.pack``.
        terms: A row for each reward term. Shape (n, 13), float64: code, then the term's numbers as its ``pack`` says.
        table: The tables of all behaviours, one after another. Flat, float32, uint8 or uint16.
        leads: How many control frames later a moving target is seen: now, by tables of Q (``environment.HALFWAY``), and
            behind an action, by tables of V (``environment.LEAD``). Shape (2,), float64.
    """

    actions: Actions
    behaviours: Array
    axes: Array
    terms: Array
    table: Array
    leads: Array


@dataclass(frozen=True)
class Policy:
    """A trained policy, read from a bundle or just trained.

    Attributes:
        name: The stem of its recipe.
        database: The motion.
        graph: The motion graph.
        actions: What the graph's actions do, as seen from their states.
        behaviours: What has been learned.
        body: Sizes of the target that it was trained for.
        values: The tables of all behaviours one after another, of which each ``table`` is a part. Flat, float32 or
            uint8.
        recipe: The recipe as it was resolved, plain data.
        statistics: What ``crowdsim inspect`` reports, plain data.
        fingerprint: SHA-256 over recipe, capture and sources, in hexadecimal.
        fingerprints: The same for each of the three alone.
        falls: Which actions knock an avatar down; None where the motion has no falls. Actions of the graph behind
            those that states choose among are these, and those of rests behind them.
        rests: Which actions let an avatar stand at ease; None where the motion has no rests, or none were wanted.
        defence: Hits that follow each action of the states, by what is seen coming (``core.threats``); None where it
            was not learned. Shape (choice_count, threats.CELLS), float32.
    """

    name: str
    database: MotionDatabase
    graph: MotionGraph
    actions: Actions
    behaviours: tuple[Behaviour, ...]
    body: TargetBody
    values: Array
    recipe: Mapping[str, Any]
    statistics: Mapping[str, Any]
    fingerprint: str
    fingerprints: Mapping[str, str]
    falls: Falls | None = None
    rests: Rests | None = None
    defence: Array | None = None

    def behaviour(self, name: str) -> Behaviour:
        """Return the behaviour called ``name``.

        Raises:
            PolicyError: There is none; the message lists those there are.
        """
        for behaviour in self.behaviours:
            if behaviour.name == name:
                return behaviour
        known = [behaviour.name for behaviour in self.behaviours]
        raise PolicyError(
            f"policy {self.name!r} has no behaviour {name!r}{nearest(name, known)}; it has {', '.join(known)}"
        )

    @property
    def weights(self) -> Array:
        """Weight of each behaviour where a scenario names none, from the recipe; 1 each by default. Shape (B,)."""
        given: Mapping[str, float] = self.recipe.get("weights") or {}
        return np.array([given.get(one.name, 0.0 if given else 1.0) for one in self.behaviours], dtype=np.float64)

    @property
    def defence_weight(self) -> float:
        """Weight of ``defend`` where a scenario names none, from the recipe; 0 where it was not learned."""
        given: Mapping[str, float] = self.recipe.get("weights") or {}
        return 0.0 if self.defence is None else float(given.get(DEFEND, 0.0 if given else 1.0))

    @property
    def learned(self) -> list[str]:
        """Names of all behaviours, ``defend`` behind the others where it was learned."""
        return [one.name for one in self.behaviours] + ([] if self.defence is None else [DEFEND])

    def lookup_tables(self) -> LookupTables:
        """Return the policy as flat arrays for compiled code; the values are not copied."""
        return build_lookup_tables(self.actions, self.behaviours, self.body, self.values)


def build_lookup_tables(
    actions: Actions, behaviours: tuple[Behaviour, ...], body: TargetBody, values: Array | None = None
) -> LookupTables:
    """Return behaviours as flat arrays; ``values`` are their tables one after another, when they lie so already."""
    rows, axes, terms = [], [np.zeros((0, AXIS_WIDTH))], [np.zeros((0, TERM_WIDTH))]
    axis_start = term_start = table_start = 0
    for behaviour in behaviours:
        axes.append(behaviour.grid.pack())
        terms.append(pack_terms(behaviour.terms, body))
        axis_end, term_end = axis_start + len(axes[-1]), term_start + len(terms[-1])
        lookup, cells = LOOKUPS.index(behaviour.lookup), behaviour.grid.cells
        facts = (behaviour.scale, behaviour.discount, behaviour.low, behaviour.step)
        rows.append((axis_start, axis_end, term_start, term_end, lookup, cells, table_start, *facts))
        axis_start, term_start, table_start = axis_end, term_end, table_start + len(behaviour.table)
    if values is None:
        values = np.concatenate([behaviour.table for behaviour in behaviours])
    packed = np.array(rows, dtype=np.float64).reshape(-1, 11)
    leads = np.array([HALFWAY, LEAD]) * actions.mean_length
    return LookupTables(actions, packed, np.concatenate(axes), np.concatenate(terms), np.asarray(values), leads)


def action_values(
    policy: Policy,
    weights: Mapping[str, float],
    state: int,
    target: ArrayLike,
    moving: ArrayLike = (0.0, 0.0, 0.0),
    lasts: float = math.inf,
) -> Array:
    """Return what each action of a state is worth for a target: slow and plain, the meaning of the compiled version.

    Values of behaviours are divided by their scale, multiplied by their weight and by how much they count at the target
    (``fade_factor``), and added (paper, section 5). What a transition costs is in the values of every behaviour that
    prices it; here it is counted once, at the highest of their prices.

    Args:
        policy: The policy.
        weights: Weight of each behaviour by name; those left out count nothing.
        state: The avatar's state.
        target: Centre of the target's head in the avatar's ground frame [m]. Shape (3,).
        moving: How far the target moves in a control frame, in the same frame [m]. Shape (3,).
        lasts: For how many control frames it moves on.

    Returns:
        The values. Shape (n,), n being the number of actions of the state.
    """
    actions = policy.actions
    first, end = int(actions.offsets[state]), int(actions.offsets[state + 1])
    total = np.zeros(end - first)
    costs = actions.costs[first:end].astype(float)
    prices = [np.zeros(end - first)]
    motion = np.asarray(moving, dtype=float), lasts
    for name, weight in weights.items():
        behaviour = policy.behaviour(name)
        if behaviour.scale == 0.0:
            continue
        factor = weight * fade_factor(behaviour.grid, target) / behaviour.scale
        if factor == 0.0:
            continue
        for k, action in enumerate(range(first, end)):
            total[k] += factor * _action_value(
                policy, behaviour, state, action, np.asarray(target, dtype=float), *motion
            )
        priced = [term for term in behaviour.terms if isinstance(term, TransitionTerm)]
        price = sum(term.weight * costs + term.each * (costs > 0.0) for term in priced)
        prices.append(factor * price * np.ones(end - first))
    return total + np.sum(prices, axis=0) - np.max(prices, axis=0)


def _action_value(
    policy: Policy, behaviour: Behaviour, state: int, action: int, target: Array, moving: Array, lasts: float
) -> float:
    """Return Q(e, a) of one behaviour."""
    actions, grid = policy.actions, behaviour.grid
    first, n = int(actions.offsets[state]), int(actions.offsets[state + 1] - actions.offsets[state])
    if behaviour.lookup == "q":
        # The table holds targets at rest only: it is read at the position of the target half an action later.
        cells, shares = corners(grid, target + min(HALFWAY * actions.mean_length, lasts) * moving)
        return float(shares @ behaviour.values(first * grid.cells + cells * n + (action - first)))
    velocity = moving[[0, 2]], lasts
    reward = action_reward(actions, action, target, behaviour.terms, policy.body, behaviour.discount, *velocity)
    # Values are those of a target at rest; an avatar that pursues a moving one must look ahead.
    moved = target + min(float(actions.lengths[action]) + LEAD * actions.mean_length, lasts) * moving
    later = ground.to_local(actions.displacements[action].astype(float), moved)
    cells, shares = corners(grid, later)
    value = float(shares @ behaviour.values(int(actions.next[action]) * grid.cells + cells))
    return reward + math.pow(behaviour.discount, int(actions.lengths[action])) * value
