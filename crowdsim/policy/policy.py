"""A trained policy: the motion, the graph over it, and for each behaviour what its values are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import PolicyError, nearest
from crowdsim.policy.actions import Actions
from crowdsim.policy.axes.registry import BEARING, DISTANCE, HEIGHT
from crowdsim.policy.defence import NAME as DEFEND
from crowdsim.policy.environment import Grid
from crowdsim.policy.falls import Falls
from crowdsim.policy.records import AXIS, BEHAVIOUR
from crowdsim.policy.rests import Rests
from crowdsim.policy.rewards import TargetBody, Term, TransitionTerm, once_of, pack_terms
from crowdsim.policy.terms.registry import TERM

if TYPE_CHECKING:
    from crowdsim.graph.motion_graph import MotionGraph
    from crowdsim.motion.database import MotionDatabase


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
        return self.low + self.step * self.table[entries].astype(np.float64)

    def everywhere(self) -> Behaviour:
        """Return this behaviour, counting fully wherever the target is, on the scale of its own reward."""
        return replace(self, grid=Grid(tuple(replace(axis, fade=0.0) for axis in self.grid.axes)), scale=1.0)

    def in_numbers(self) -> Behaviour:
        """Return this behaviour with its values in float32, for which training has compiled what reads them."""
        return replace(self, table=self.values().astype(np.float32), low=0.0, step=1.0)


class LookupTables(NamedTuple):
    """All that control needs of a policy as flat arrays, for compiled code, which can be handed all of it at once.

    ``kernels/values.py`` reads exactly this. B is the number of behaviours, A of actions.

    Attributes:
        actions: The graph's actions; see ``Actions``.
        behaviours: The behaviours. Shape (B,), ``records.BEHAVIOUR``.
        axes: The axes of each grid. Shape (n,), ``records.AXIS``.
        terms: The reward terms of each behaviour. Shape (n,), ``terms.registry.TERM``.
        once: What each action earns each behaviour wherever the target is (``Term.of_actions``). Shape (B, A), float64.
        table: The tables of all behaviours, one after another. Flat, float32, uint8 or uint16.
    """

    actions: Actions
    behaviours: Array
    axes: Array
    terms: Array
    once: Array
    table: Array


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
        defence: Hits that follow each action of the states where no strike is seen coming, by the distance of attackers
            (``core.threats``); None where it was not learned. Shape (choice_count, threats.CELLS), float32.
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
    records = np.zeros(len(behaviours), BEHAVIOUR)
    axes, terms = [np.zeros(0, AXIS)], [np.zeros(0, TERM)]
    once = np.array([once_of(behaviour.terms, actions) for behaviour in behaviours])
    axis_start = term_start = table_start = 0
    for behaviour, record in zip(behaviours, records, strict=True):
        axes.append(behaviour.grid.pack())
        terms.append(pack_terms(behaviour.terms, body))
        record["first_axis"], record["first_term"], record["table"] = axis_start, term_start, table_start
        axis_start, term_start = axis_start + len(axes[-1]), term_start + len(terms[-1])
        table_start += len(behaviour.table)
        record["end_axis"], record["end_term"] = axis_start, term_start
        record["further"] = any(axis.kind not in (DISTANCE, BEARING, HEIGHT) for axis in behaviour.grid.axes)
        record["lead_now"], record["lead_later"] = (lead * actions.mean_length for lead in behaviour.grid.leads)
        record["looks_ahead"], record["cells"] = behaviour.lookup == "v", behaviour.grid.cells
        for name in ("scale", "discount", "low", "step"):
            record[name] = getattr(behaviour, name)
        for term in behaviour.terms:
            if isinstance(term, TransitionTerm):
                record["price"] += term.weight
                record["each"] += term.each
    if values is None:
        values = np.concatenate([behaviour.table for behaviour in behaviours])
    return LookupTables(actions, records, np.concatenate(axes), np.concatenate(terms), once, np.asarray(values))
