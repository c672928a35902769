"""The arrays of a model: what the policies of a run hold, one after another, as control reads it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.records import GRID_AXIS, MOVE, REACH, records
from crowdsim.crowd.model_breaks import bound_strikes
from crowdsim.motion import ground
from crowdsim.policy.axes.registry import AXES
from crowdsim.policy.rewards import StrikeTerm

if TYPE_CHECKING:
    from crowdsim.policy.actions import Actions
    from crowdsim.policy.policy import LookupTables, Policy

BRAKING = 4
"""Actions in which a body can halt out of any motion."""


def count_rows(policies: Sequence[Policy], tables: Sequence[LookupTables]) -> dict[str, Array]:
    """Return where the rows of each policy begin in arrays of each kind, and behind them where the last one ends."""
    actions = [table.actions for table in tables]
    return {
        "state": _starts_of([action.state_count + _spare_states(action) for action in actions]),
        "action": _starts_of([action.action_count for action in actions]),
        "path": _starts_of([len(action.paths) for action in actions]),
        "strike": _starts_of([len(action.strike_times) for action in actions]),
        "frame": _starts_of([len(policy.database.ground) for policy in policies]),
        "behaviour": _starts_of([len(table.behaviours) for table in tables]),
        "axis": _starts_of([len(table.axes) for table in tables]),
        "term": _starts_of([len(table.terms) for table in tables]),
        "table": _starts_of([len(table.table) for table in tables]),
    }


def _spare_states(actions: Actions) -> int:
    """Return how many states a policy has in a run besides its own: one for each fall, to which no action leads."""
    return actions.action_count - actions.choice_count


def behaviour_rows(
    policies: Sequence[Policy], tables: Sequence[LookupTables], starts: dict[str, Array]
) -> tuple[Array, Array]:
    """Return the records of all behaviours, and the tables that they read."""
    behaviours = []
    for p, table in enumerate(tables):
        rows = table.behaviours.copy()
        for name in ("axis", "term"):
            rows[f"first_{name}"] += starts[name][p]
            rows[f"end_{name}"] += starts[name][p]
        # Entries of a table count from the policy's own first action or state; here from the run's.
        first = np.where(rows["looks_ahead"], starts["state"][p], starts["action"][p])
        rows["table"] += starts["table"][p] - first * rows["cells"]
        behaviours.append(rows)
    parts = [np.asarray(table.table) for table in tables]
    if len({part.dtype for part in parts}) > 1:
        parts = [policy_values(policy) for policy in policies]
        for rows in behaviours:
            rows["low"], rows["step"] = 0.0, 1.0
    values = (parts[0] if len(parts) == 1 else np.concatenate(parts)).view(np.ndarray)
    values.flags.writeable = False  # mapped or not, kernels are compiled for one type
    return np.concatenate(behaviours), values


def policy_values(policy: Policy) -> Array:
    """Return the tables of all behaviours as numbers, float32, one after another."""
    return np.concatenate([behaviour.values() for behaviour in policy.behaviours]).astype(np.float32)


def action_rows(policies: Sequence[Policy], actions: Sequence[Actions], starts: dict[str, Array]) -> Array:
    """Return a row for each action, and one that closes paths and strikes."""
    origins = [
        start + policy.database.stride * (np.asarray(policy.graph.action_first, np.int64) - 1)
        for start, policy in zip(starts["frame"], policies, strict=False)
    ]
    columns = [
        _moved([action.next for action in actions], starts["state"]),
        joined([action.lengths for action in actions], np.int32),
        joined(origins, np.int32),
        _moved([action.path_offsets[:-1] for action in actions], starts["path"]),
        _moved([action.strike_offsets[:-1] for action in actions], starts["strike"]),
        np.concatenate([_before_first_strike(action) for action in actions]),
    ]
    closing = np.array([[-1, 0, 0, starts["path"][-1], starts["strike"][-1], layout.NO_STRIKE]])
    return np.concatenate([np.column_stack(columns), closing]).astype(np.int32)


def action_starts(policy: Policy) -> Array:
    """Return what lies on the avatar's ground transform when each action starts, in the clip's world. Shape (A, 3)."""
    first = policy.database.stride * (np.asarray(policy.graph.action_first, np.int64) - 1)
    return ground.compose(policy.database.ground[first], ground.inverse(policy.actions.shifts))


def _before_first_strike(actions: Actions) -> Array:
    found, follows = np.full(actions.action_count, layout.NO_STRIKE), bound_strikes(actions)[actions.next]
    before = np.ceil(actions.strike_times.astype(np.float32)).astype(int) - 1
    bound = np.flatnonzero(follows >= 0)
    found[bound] = actions.lengths[bound] + before[follows[bound]]
    owners = np.repeat(np.arange(actions.action_count), np.diff(actions.strike_offsets))
    np.minimum.at(found, owners, before)
    return found


def strike_rows(
    policies: Sequence[Policy], behaviours: Array, terms: Array, starts: dict[str, Array]
) -> tuple[Array, Array]:
    """Return the strikes in actions (``REACH``), and what they earn and waste by each strike term of their policy.

    The column of what a term earns is written into its record.
    """
    strikes, parts = [], []
    for p, policy in enumerate(policies):
        actions, database = policy.actions, policy.database
        speeds, limbs = database.strike_speeds[actions.strike_ids], database.strike_limbs[actions.strike_ids]
        positions = np.reshape(actions.strike_positions, (-1, 3))
        owners = np.repeat(np.arange(actions.action_count), np.diff(actions.strike_offsets))
        owners -= np.repeat(actions.offsets[:-1], np.diff(actions.offsets))[owners]
        origins = np.reshape(actions.strike_origins, (-1, 2))
        strikes.append(np.column_stack([actions.strike_times, positions, speeds, limbs, owners, origins]))
        columns: list[Array] = []
        for behaviour, row in zip(policy.behaviours, behaviours[starts["behaviour"][p] :], strict=False):
            for term, record in zip(behaviour.terms, terms[row["first_term"] :], strict=False):
                if isinstance(term, StrikeTerm):
                    record["column"] = len(columns)
                    faded = behaviour.discount ** actions.strike_times.astype(float)
                    columns += [term.earned(actions, behaviour.discount), faded * term.weight * term.waste]
        parts.append(np.reshape(columns, (len(columns), len(owners))).T)
    width = max(part.shape[1] for part in parts)
    earnings = np.concatenate([np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in parts])
    return records(np.concatenate(strikes), REACH), earnings.astype(np.float32, order="C")


def halt_rows(actions: Actions) -> Array:
    """Return where a body halts after each action at the earliest: see ``Model.halts``. Shape (A, 2), float32.

    Out of a run it takes some steps: ``BRAKING`` actions more, of all that may follow one another those that lead the
    least way.
    """
    moves, follow = actions.displacements.astype(float), actions.next
    firsts, owners = actions.offsets[:-1], np.repeat(np.arange(actions.state_count), np.diff(actions.offsets))
    choices = slice(0, actions.choice_count)
    way, travel = np.zeros((actions.state_count, 3)), np.zeros(actions.state_count)
    for _ in range(BRAKING):
        through = np.hypot(moves[choices, 0], moves[choices, 1]) + travel[follow[choices]]
        travel = np.minimum.reduceat(through, firsts)
        least = np.flatnonzero(through == travel[owners])
        best = least[np.unique(owners[least], return_index=True)[1]]
        way = ground.compose(moves[best], way[follow[best]])
    return ground.compose(moves, way[follow])[:, :2].astype(np.float32)


def reach_rows(displacements: Array, halts: Array, offsets: Array) -> Array:
    """Return how far the actions of each state lead at most, and until the body can halt. Shape (S,), float64."""
    further = np.maximum(np.hypot(displacements[:, 0], displacements[:, 1]), np.hypot(halts[:, 0], halts[:, 1]))
    return np.asarray(np.maximum.reduceat(further, offsets[:-1]))


def twin_states(policies: Sequence[Policy], starts: dict[str, Array]) -> Array:
    """Return for each state the one of the captured motion that it is, or is the mirror image of. Shape (S,), int32."""
    parts = []
    for first, policy in zip(starts["state"], policies, strict=False):
        captured = policy.graph.captured_states(policy.database.captured_frames)
        count = policy.actions.state_count
        parts.append(first + np.arange(count) % max(captured, 1))
        parts.append(first + np.arange(count, count + _spare_states(policy.actions)))
    return np.concatenate(parts).astype(np.int32)


def discount_rows(discounts: Array, longest: int) -> Array:
    """Return powers of each discount: row 0 from 0 on, row T for frames 1 to T of an action, and zeros behind them."""
    times = np.arange(-(-(longest + 1) // layout.LANES) * layout.LANES)
    rows = discounts[:, None, None] ** (times + 1.0) * (times < np.arange(longest + 1)[:, None])
    rows[:, 0] = discounts[:, None] ** times
    return np.asarray(rows)


def path_frames(actions: Sequence[Actions]) -> Array:
    """Return the control frame of each row of paths, from 1 on in each action."""
    parts = []
    for one in actions:
        owners = np.repeat(np.arange(one.action_count), np.diff(one.path_offsets))
        parts.append(np.arange(len(one.paths)) - one.path_offsets[owners] + 1)
    return np.concatenate(parts)


def move_rows(
    displacements: Array, policies: Sequence[Policy], tables: Sequence[LookupTables], starts: dict[str, Array]
) -> tuple[Array, Array]:
    """Return where actions end (``MOVE``), and what they cost each behaviour wherever the target is."""
    costs = joined([table.actions.costs for table in tables], np.float64)
    slots = int(np.diff(starts["behaviour"]).max())
    columns = [displacements[:, :2], np.cos(displacements[:, 2]), np.sin(displacements[:, 2]), costs]
    prices = np.zeros((len(displacements), slots), np.float32)
    for p, (policy, table) in enumerate(zip(policies, tables, strict=True)):
        own = slice(starts["action"][p], starts["action"][p + 1])
        for slot, behaviour in enumerate(policy.behaviours):
            for term in behaviour.terms:
                spent = term.spent(table.actions, behaviour.discount) if isinstance(term, StrikeTerm) else 0.0
                prices[own, slot] += spent - term.of_actions(table.actions)
    return records(np.column_stack(columns), MOVE), prices


def grid_records(policies: Sequence[Policy]) -> Array:
    """Return each behaviour's axes, those of a kind in one place; one that it does not have is a single point."""
    grids = np.zeros((sum(len(policy.behaviours) for policy in policies), len(AXES)), GRID_AXIS)
    grids["per_unit"] = grids["points"] = 1.0
    behaviours = (behaviour for policy in policies for behaviour in policy.behaviours)
    for grid, behaviour in zip(grids, behaviours, strict=True):
        for axis in behaviour.grid.pack():
            record = grid[axis["kind"]]
            for name in ("first", "wraps", "rate"):
                record[name] = axis[name]
            record["per_unit"], record["points"], record["apart"] = 1.0 / axis["step"], axis["count"], axis["stride"]
            last = axis["first"] + (axis["count"] - 1.0) * axis["step"]
            record["fade"] = 0.0 if axis["wraps"] else axis["fade"]
            record["least"], record["greatest"] = axis["minimum"], last / (1.0 - axis["rate"] * last)
    return grids


def padded(rows: Sequence[Array]) -> Array:
    """Return rows with room to read beyond their ends, float32."""
    return np.pad(np.stack(rows), ((0, 0), (0, layout.LANES))).astype(np.float32)


def _starts_of(counts: Sequence[int]) -> Array:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def joined(parts: Sequence[Array], dtype: Any) -> Array:
    """Return arrays of each policy as one."""
    return np.concatenate([np.asarray(part) for part in parts]).astype(dtype)


def _moved(parts: Sequence[Array], starts: Array) -> Array:
    moved = [np.asarray(part, np.int64) + start for part, start in zip(parts, starts, strict=False)]
    return np.concatenate(moved).astype(np.int32)


def joined_offsets(actions: Sequence[Actions], starts: Array) -> Array:
    """Return CSR offsets of the actions of each policy as one; falls have a state each behind those of their policy."""
    inner = [
        start + np.concatenate([np.asarray(one.offsets[:-1], np.int64), np.arange(one.choice_count, one.action_count)])
        for one, start in zip(actions, starts, strict=False)
    ]
    return np.concatenate([*inner, starts[-1:]]).astype(np.int32)
