"""The policies of a run as one set of flat arrays, so that one kernel serves avatars of all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Model, Paths
from crowdsim.crowd.kernels.records import (
    ACTION,
    PLACE,
    POINT,
    POLICY,
    REST,
    REST_ENTRY,
    SIZE,
    WALK,
    records,
)
from crowdsim.crowd.model_arms import arm_radii, arm_rows, way_rows
from crowdsim.crowd.model_falls import fall_rows
from crowdsim.crowd.model_guard import unguarded_rows
from crowdsim.crowd.model_legs import leg_rows
from crowdsim.crowd.model_outlines import no_outlines, outline_rows
from crowdsim.crowd.model_stillness import calm_rows
from crowdsim.crowd.model_tables import (
    action_rows,
    action_starts,
    behaviour_rows,
    count_rows,
    discount_rows,
    grid_records,
    halt_rows,
    joined,
    joined_offsets,
    move_rows,
    padded,
    path_frames,
    reach_rows,
    strike_rows,
    twin_states,
)
from crowdsim.crowd.resting import note_walks, rest_rows, walk_rows
from crowdsim.crowd.stances import stance_rows
from crowdsim.errors import RunError
from crowdsim.policy.defence import join_defences
from crowdsim.policy.environment import LEAD
from crowdsim.policy.rewards import StrikeTerm

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy


TOLERANCE = 0.10
"""How far from the surface a strike lands (``rewards.lands``) [m], for a policy whose recipe rewards no strikes."""

STRONG = 75.0
"""Percentile of the speeds of a policy's strikes from which on they are strong."""

AT_REST = 0.25
"""How far bodies that begin a run need at most to halt [m]."""

FULL_REACH = 0.8
"""Distance over the ground of half of the strikes from which on bodies keep the whole gap [m]."""


def build_model(policies: Sequence[Policy], with_stances: bool = False, with_outlines: bool = False) -> Model:
    """Return all policies one after another, ``with_stances`` if avatars have them; a single table is not copied.

    With obstacles it needs the outlines of bodies.

    Raises:
        RunError: The policies run at different control rates.
    """
    _check_together(policies)
    tables = [policy.lookup_tables() for policy in policies]
    actions = [table.actions for table in tables]
    databases = [policy.database for policy in policies]
    starts = count_rows(policies, tables)
    behaviours, values = behaviour_rows(policies, tables, starts)
    terms = np.concatenate([table.terms for table in tables])
    paths = joined([action.paths for action in actions], np.float64)
    displacements = np.concatenate([action.displacements for action in actions]).astype(float)
    moves, prices = move_rows(displacements, policies, tables, starts)
    strikes, earnings = strike_rows(policies, behaviours, terms, starts)
    halts, offsets = np.concatenate([halt_rows(one) for one in actions]), joined_offsets(actions, starts["action"])
    rests, ways_to_rest = rest_rows(policies, starts)
    note_walks(policies, starts, halts)
    walks, walk_points = walk_rows(policies, starts)
    strides = [*(database.stride for database in databases), 0]
    origins = [action_starts(policy) for policy in policies]
    bodies = [np.stack([database.heads, database.necks, database.pelvises], axis=1) for database in databases]
    legs = [leg_rows(*one) for one in zip(policies, np.diff(starts["state"]), strict=True)]
    firsts = [starts[name] for name in ("behaviour", "action", "state")]
    action_records = records(action_rows(policies, actions, starts), ACTION)
    ground = records(joined([database.ground for database in databases], np.float64), PLACE)
    outlines = no_outlines()
    if with_outlines:
        of_actions = np.repeat(strides, [*np.diff(starts["action"]), 1])
        outlines = outline_rows(policies, action_records, ground, of_actions)
    return Model(
        offsets=offsets,
        reaches=reach_rows(displacements, halts, offsets),
        halts=records(halts, POINT),
        legs=np.concatenate([points for points, _ in legs]),
        leg_reaches=np.concatenate([reaches for _, reaches in legs]),
        calm=np.concatenate([calm_rows(policy) for policy in policies]),
        unguarded=np.concatenate([unguarded_rows(policy) for policy in policies]),
        actions=action_records,
        moves=moves,
        prices=prices,
        paths=Paths(
            *padded([paths[:, 0], paths[:, 1], np.cos(paths[:, 2]), np.sin(paths[:, 2]), path_frames(actions)])
        ),
        strikes=strikes,
        earnings=earnings,
        behaviours=behaviours,
        discounts=discount_rows(behaviours["discount"], int(max(action.lengths.max() for action in actions))),
        grids=grid_records(policies),
        terms=terms,
        table=values,
        ground=ground,
        starts=records(np.concatenate(origins), PLACE),
        bodies=np.concatenate(bodies).astype(np.float32),
        arms=np.concatenate([arm_rows(database) for database in databases]),
        ways=way_rows(policies, origins),
        policies=records(np.column_stack([strides, *firsts]), POLICY),
        sizes=records(np.array([_sizes(policy) for policy in policies]), SIZE),
        twins=twin_states(policies, starts),
        stances=stance_rows(policies, starts["state"]) if with_stances else np.zeros((0, 2), np.uint8),
        **fall_rows(policies, starts),
        **outlines,
        rests=records(rests, REST),
        walks=records(walks, WALK),
        walk_points=walk_points,
        ways_to_rest=records(ways_to_rest, REST_ENTRY),
        defence=join_defences([policy.defence for policy in policies], [len(action.next) for action in actions]),
        shields=np.zeros((0, 4), np.float32),
    )


def _check_together(policies: Sequence[Policy]) -> None:
    """Raise an error where policies run at different control rates."""
    rates = {policy.database.control_rate for policy in policies}
    if len(rates) > 1:
        names = ", ".join(f"{policy.name} at {policy.database.control_rate:g} Hz" for policy in policies)
        raise RunError(f"policies of one run decide at different rates: {names}; expected one control rate")


def entry_actions(model: Model) -> Array:
    """Return the cheapest action that ends in each state, the first among equals; -1 for none. Shape (S,), int32.

    Falls and rests are none of them. States in the middle of a run have none, since what is in the way there is not
    known yet.
    """
    rests = [model.rests["hold"], model.rests["leave"], model.ways_to_rest["enter"], model.walks["action"]]
    apart = [model.falls["action"], *rests]
    chosen = np.setdiff1d(np.arange(len(model.actions) - 1), np.concatenate(apart))
    ends = model.actions["next"][chosen]
    order = np.lexsort((np.arange(len(ends)), model.moves["cost"][chosen], ends))
    entries = np.full(len(model.offsets) - 1, -1, np.int32)
    states, first = np.unique(ends[order], return_index=True)
    entries[states] = chosen[order[first]]
    onwards = (model.halts[axis][entries] - model.moves[axis][entries] for axis in "xz")
    brakes = np.where(entries < 0, np.inf, np.hypot(*onwards))
    for start, stop in pairwise(model.policies["states"]):
        own = slice(start, stop)
        entries[own][brakes[own] > max(AT_REST, brakes[own].min())] = -1
    return entries


def _sizes(policy: Policy) -> list[float]:
    body, database = policy.body, policy.database

    def reach(*points: Array) -> float:
        return max((float(np.hypot(point[:, 0], point[:, 2]).max(initial=0.0)) for point in points), default=0.0)

    furthest = max(
        reach(database.heads) + body.head_radius, reach(database.necks, database.pelvises) + body.torso_radius
    )
    steps = np.hypot(*np.diff(database.ground[:, :2], axis=0).T)
    steps[np.asarray(database.clip_starts[1:-1], int) * database.stride - 1] = 0.0
    pace = float(steps.max(initial=0.0)) * database.stride
    drops = (body.neck_drop, body.pelvis_drop)
    tolerance = _tolerance(policy)
    watches = any(axis.name == "impact" for behaviour in policy.behaviours for axis in behaviour.grid.axes)
    far = farthest(policy)
    return [
        body.head_radius,
        body.torso_radius,
        *drops,
        tolerance,
        furthest + 1e-5,
        pace + 1e-5,
        far,
        LEAD * policy.actions.mean_length,
        float(watches),
        strong_speed(policy),
        space_of(policy),
        *arm_radii(database.body),
    ]


def strong_speed(policy: Policy) -> float:
    """Return the speed that a quarter of the strikes in a policy's motion reach [m/s]; these are strong."""
    speeds = np.asarray(policy.database.strike_speeds, dtype=float)
    return float(np.percentile(speeds, STRONG)) if len(speeds) else math.inf


def space_of(policy: Policy) -> float:
    """Return how much of the gap between bodies avatars keep: less where strikes are short, 1 for most boxers."""
    fists = np.reshape(policy.database.strike_positions, (-1, 3)).astype(float)
    return min(float(np.median(np.hypot(fists[:, 0], fists[:, 2]))) / FULL_REACH, 1.0) if len(fists) else 1.0


def farthest(policy: Policy) -> float:
    """Return the distance beyond which behaviours distinguish no positions [m]; further targets are observed there."""
    axes = [axis for behaviour in policy.behaviours for axis in behaviour.grid.axes if axis.name == "distance"]
    return max((axis.maximum + axis.fade for axis in axes), default=math.inf)


def _tolerance(policy: Policy) -> float:
    found = [
        term.tolerance for behaviour in policy.behaviours for term in behaviour.terms if isinstance(term, StrikeTerm)
    ]
    return float(max(found, default=TOLERANCE))
