"""The policies of a run as one set of flat arrays, so that one kernel serves avatars of all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdsim.crowd.arrays import Model
from crowdsim.crowd.kernels import layout
from crowdsim.errors import PolicyError, RunError
from crowdsim.motion import ground
from crowdsim.policy.environment import HALFWAY, LEAD
from crowdsim.policy.rewards import ProximityTerm, StrikeTerm, Term, TransitionTerm, supported, term_name

if TYPE_CHECKING:
    from crowdsim.policy.actions import Actions
    from crowdsim.policy.policy import Policy

Array = NDArray[Any]

TOLERANCE = 0.10
"""How far from the surface a strike lands (``rewards.lands``) [m], for a policy whose recipe rewards no strikes."""

SUPPORTED_TERMS: tuple[type[Term], ...] = (StrikeTerm, ProximityTerm, TransitionTerm)
"""Reward terms that control evaluates when it looks ahead. A further one needs a branch in ``rewards.add_terms`` of
``kernels``, or a share in ``_moves`` where what it is worth does not depend on the target."""

SUPPORTED_AXES = ("distance", "bearing", "height")
"""Axes that control measures. A further one needs a row in ``Model.grids``, and its share in ``fade`` and
``locate_ends`` of ``kernels/tables.py`` and in ``kernels/values.py``, which know three."""


def build_model(policies: Sequence[Policy]) -> Model:
    """Return all policies one after another; a single policy's table is not copied.

    Raises:
        RunError: The policies run at different control rates.
        PolicyError: A behaviour has an axis that control does not measure, or looks ahead by a reward term that it does
            not evaluate.
    """
    for policy in policies:
        check_support(policy)
    rates = {policy.database.control_rate for policy in policies}
    if len(rates) > 1:
        names = ", ".join(f"{policy.name} at {policy.database.control_rate:g} Hz" for policy in policies)
        raise RunError(f"policies of one run decide at different rates: {names}; expected one control rate")
    tables = [policy.lookup_tables() for policy in policies]
    actions = [table.actions for table in tables]
    starts = {
        "state": _starts([action.state_count for action in actions]),
        "action": _starts([action.action_count for action in actions]),
        "path": _starts([len(action.paths) for action in actions]),
        "strike": _starts([len(action.strike_times) for action in actions]),
        "frame": _starts([len(policy.database.ground) for policy in policies]),
        "behaviour": _starts([len(table.behaviours) for table in tables]),
        "axis": _starts([len(table.axes) for table in tables]),
        "term": _starts([len(table.terms) for table in tables]),
        "table": _starts([len(table.table) for table in tables]),
    }
    behaviours = []
    for p, table in enumerate(tables):
        rows = np.pad(np.array(table.behaviours, dtype=float).reshape(-1, 11), ((0, 0), (0, 2)))
        rows[:, 0:2] += starts["axis"][p]
        rows[:, 2:4] += starts["term"][p]
        # Places in a table count from the policy's own first action or state; here from the run's.
        first = np.where(rows[:, 4] == 0.0, starts["action"][p], starts["state"][p])
        rows[:, 6] += starts["table"][p] - first * rows[:, 5]
        behaviours.append(rows)
    origins = [
        start + policy.database.stride * (np.asarray(policy.graph.action_first, np.int64) - 1)
        for start, policy in zip(starts["frame"], policies, strict=False)
    ]
    parts = [np.asarray(table.table) for table in tables]
    if len({part.dtype for part in parts}) > 1:
        parts = [policy_values(policy) for policy in policies]
        for rows in behaviours:
            rows[:, 9:11] = 0.0, 1.0
    values = (parts[0] if len(parts) == 1 else np.concatenate(parts)).view(np.ndarray)
    values.flags.writeable = False  # mapped or not, kernels are compiled for one type
    paths = _joined([action.paths for action in actions], np.float64)
    joined = np.concatenate(behaviours)
    terms = _joined([table.terms for table in tables], np.float64)
    ways = np.concatenate([action.displacements for action in actions]).astype(float)
    closing = np.array([[-1, 0, 0, starts["path"][-1], starts["strike"][-1], layout.NO_STRIKE]])
    offsets = _csr([action.offsets for action in actions], starts["action"])
    columns = [
        _moved([action.next for action in actions], starts["state"]),
        _joined([action.lengths for action in actions], np.int32),
        _joined(origins, np.int32),
        _moved([action.path_offsets[:-1] for action in actions], starts["path"]),
        _moved([action.strike_offsets[:-1] for action in actions], starts["strike"]),
        np.concatenate([_before_first_strike(action) for action in actions]),
    ]
    costs = _joined([action.costs for action in actions], np.float64)
    databases = [policy.database for policy in policies]
    _note_prices(joined, terms)
    moves = _moves(ways, costs, actions, joined, terms, starts)
    strikes = _strikes(policies, joined, terms, starts)
    # What cuts cost is known beforehand and stands among ``moves``.
    kept = np.concatenate([[0], np.cumsum(terms[:, 0] != TransitionTerm.code)])
    joined[:, 2:4] = kept[joined[:, 2:4].astype(int)]
    return Model(
        offsets=offsets,
        reaches=np.maximum.reduceat(np.hypot(ways[:, 0], ways[:, 1]), offsets[:-1]),
        actions=np.concatenate([np.column_stack(columns), closing]).astype(np.int32),
        moves=moves,
        paths=_padded([paths[:, 0], paths[:, 1], np.cos(paths[:, 2]), np.sin(paths[:, 2]), _frames(actions)]),
        strikes=strikes,
        behaviours=joined,
        discounts=_discounts(joined[:, layout.DISCOUNT], int(max(action.lengths.max() for action in actions))),
        grids=_grids(joined, _joined([table.axes for table in tables], np.float64)),
        terms=terms[terms[:, 0] != TransitionTerm.code],
        table=values,
        ground=_joined([database.ground for database in databases], np.float64),
        starts=np.concatenate([_action_starts(policy) for policy in policies]),
        bodies=np.concatenate(
            [np.column_stack([database.heads, database.necks, database.pelvises]) for database in databases]
        ).astype(np.float32),
        policies=np.column_stack(
            [
                [*(database.stride for database in databases), 0],
                starts["behaviour"],
                starts["action"],
                starts["state"],
            ]
        ).astype(np.int32),
        sizes=np.array([_sizes(policy) for policy in policies]),
    )


def check_support(policy: Policy) -> None:
    """See to it that control has kernels for all axes of a policy, and for the reward terms that it looks ahead by.

    Raises:
        PolicyError: It has not; the message names policy, behaviour, and axis or term.
    """
    for behaviour in policy.behaviours:
        where = f"policy {policy.name!r}, behaviour {behaviour.name!r}"
        for axis in behaviour.grid.axes:
            if axis.name not in SUPPORTED_AXES:
                raise PolicyError(
                    f"{where}: {axis.name!r} is no axis that control measures, expected one of "
                    f"{', '.join(SUPPORTED_AXES)}"
                )
        for term in behaviour.terms if behaviour.lookup == "v" else ():
            if not isinstance(term, SUPPORTED_TERMS):
                raise PolicyError(
                    f"{where}: {term_name(term)!r} is no reward term that control evaluates with the look-up v, "
                    f"{supported(SUPPORTED_TERMS)}, or the look-up q"
                )


def _action_starts(policy: Policy) -> Array:
    """Return what lies on the avatar's ground transform when each action starts, in the clip's world. Shape (A, 3)."""
    first = policy.database.stride * (np.asarray(policy.graph.action_first, np.int64) - 1)
    return ground.compose(policy.database.ground[first], ground.inverse(policy.actions.shifts))


def policy_values(policy: Policy) -> Array:
    """Return the tables of all behaviours as numbers, float32, one after another."""
    return np.concatenate([behaviour.values() for behaviour in policy.behaviours]).astype(np.float32)


def entry_actions(model: Model) -> Array:
    """Return the cheapest action that ends in each state, the first among equals; -1 for none. Shape (S,), int32."""
    ends = model.actions[:-1, layout.NEXT]
    order = np.lexsort((np.arange(len(ends)), model.moves[:, layout.COST], ends))
    entries = np.full(len(model.offsets) - 1, -1, np.int32)
    states, first = np.unique(ends[order], return_index=True)
    entries[states] = order[first]
    return entries


def _before_first_strike(actions: Actions) -> Array:
    found = np.full(actions.action_count, layout.NO_STRIKE)
    owners = np.repeat(np.arange(actions.action_count), np.diff(actions.strike_offsets))
    np.minimum.at(found, owners, np.ceil(actions.strike_times.astype(np.float32)).astype(int) - 1)
    return found


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
    leads = [lead * float(np.mean(policy.actions.lengths)) for lead in (HALFWAY, LEAD)]
    far = farthest(policy)
    return [body.head_radius, body.torso_radius, *drops, tolerance, furthest + 1e-5, pace + 1e-5, far, *leads]


def farthest(policy: Policy) -> float:
    """Return the distance beyond which no behaviour tells places apart [m]: targets further away are seen there."""
    axes = [axis for behaviour in policy.behaviours for axis in behaviour.grid.axes if axis.name == "distance"]
    return max((axis.maximum + axis.fade for axis in axes), default=math.inf)


def _tolerance(policy: Policy) -> float:
    found = [
        term.tolerance for behaviour in policy.behaviours for term in behaviour.terms if isinstance(term, StrikeTerm)
    ]
    return float(max(found, default=TOLERANCE))


def _strikes(policies: Sequence[Policy], behaviours: Array, terms: Array, starts: dict[str, Array]) -> Array:
    """Return the strikes in actions, and what those that land earn by each strike term of their policy.

    The column of what a term earns is written into its row.
    """
    parts = []
    for p, policy in enumerate(policies):
        actions, database = policy.actions, policy.database
        speeds, hands = database.strike_speeds[actions.strike_ids], database.strike_hands[actions.strike_ids]
        places = np.reshape(actions.strike_places, (-1, 3))
        owners = np.repeat(np.arange(actions.action_count), np.diff(actions.strike_offsets))
        owners -= np.repeat(actions.offsets[:-1], np.diff(actions.offsets))[owners]
        columns = [actions.strike_times, *places.T, speeds, hands, owners]
        for row in behaviours[starts["behaviour"][p] : starts["behaviour"][p + 1]]:
            for term in terms[int(row[2]) : int(row[3])]:
                if term[0] == StrikeTerm.code:
                    term[8] = len(columns)
                    fast = actions.strike_speeds.astype(float) ** term[3]
                    faded = row[layout.DISCOUNT] ** actions.strike_times.astype(float)
                    columns += [faded * fast, faded * term[1] * term[10]]
        parts.append(np.column_stack(columns))
    width = -(-max(part.shape[1] for part in parts) // 8) * 8
    return np.concatenate([np.pad(part, ((0, 0), (0, width - part.shape[1]))) for part in parts]).astype(np.float32)


def _discounts(discounts: Array, longest: int) -> Array:
    """Return powers of each discount: row 0 from 0 on, row T for frames 1 to T of an action, and zeros behind them."""
    times = np.arange(-(-(longest + 1) // layout.LANES) * layout.LANES)
    rows = discounts[:, None, None] ** (times + 1.0) * (times < np.arange(longest + 1)[:, None])
    rows[:, 0] = discounts[:, None] ** times
    return np.asarray(rows)


def _frames(actions: Sequence[Actions]) -> Array:
    """Return the control frame of each row of paths, from 1 on in each action."""
    parts = []
    for one in actions:
        owners = np.repeat(np.arange(one.action_count), np.diff(one.path_offsets))
        parts.append(np.arange(len(one.paths)) - one.path_offsets[owners] + 1)
    return np.concatenate(parts)


def _note_prices(behaviours: Array, terms: Array) -> None:
    """Write what a transition costs each behaviour into its row: for a cost of 1, and for each one."""
    for row in behaviours:
        own = terms[int(row[2]) : int(row[3])]
        row[layout.PRICE], row[layout.EACH] = own[own[:, 0] == TransitionTerm.code, 1:3].sum(axis=0)


def _moves(
    ways: Array, costs: Array, actions: Sequence[Actions], behaviours: Array, terms: Array, starts: dict[str, Array]
) -> Array:
    """Return where actions end, what their transitions cost, and what cuts and effort take from each behaviour."""
    slots = int(np.diff(starts["behaviour"]).max())
    moves = np.zeros((len(ways), -(-(layout.CUT + slots) // 8) * 8), np.float32)
    moves[:, : layout.CUT] = np.column_stack([ways[:, :2], np.cos(ways[:, 2]), np.sin(ways[:, 2]), costs])
    for p, start in enumerate(starts["behaviour"][:-1]):
        own = slice(starts["action"][p], starts["action"][p + 1])
        for slot, row in enumerate(behaviours[start : starts["behaviour"][p + 1]]):
            for term in terms[int(row[2]) : int(row[3])]:
                if term[0] == TransitionTerm.code:
                    moves[own, layout.CUT + slot] += term[1] * costs[own] + term[2] * (costs[own] > 0.0)
                if term[0] == StrikeTerm.code and term[9] > 0.0:
                    faded = row[layout.DISCOUNT] ** actions[p].strike_times.astype(float)
                    sums = np.concatenate([[0.0], np.cumsum(faded)])[actions[p].strike_offsets]
                    moves[own, layout.CUT + slot] += term[1] * term[9] * np.diff(sums)
    return moves


def _grids(behaviours: Array, axes: Array) -> Array:
    """Return each behaviour's axes, those of a kind in one place; one that it does not have is a single point."""
    grids = np.tile([0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], (len(behaviours), 3, 1))
    for grid, (start, end) in zip(grids, behaviours[:, :2].astype(int), strict=True):
        for kind, first, step, points, wraps, stride, fade, minimum, rate in axes[start:end]:
            last = first + (points - 1.0) * step
            greatest = last / (1.0 - rate * last)
            fade = 0.0 if wraps else fade
            grid[int(kind)] = first, 1.0 / step, points, wraps, stride, fade, minimum, greatest, rate
    return grids


def _padded(rows: Sequence[Array]) -> Array:
    """Return rows with room to read beyond their ends, float32."""
    return np.pad(np.stack(rows), ((0, 0), (0, layout.LANES))).astype(np.float32)


def _starts(counts: Sequence[int]) -> Array:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _joined(parts: Sequence[Array], dtype: Any) -> Array:
    return np.concatenate([np.asarray(part) for part in parts]).astype(dtype)


def _moved(parts: Sequence[Array], starts: Array) -> Array:
    moved = [np.asarray(part, np.int64) + start for part, start in zip(parts, starts, strict=False)]
    return np.concatenate(moved).astype(np.int32)


def _csr(parts: Sequence[Array], starts: Array) -> Array:
    inner = [np.asarray(part[:-1], np.int64) + start for part, start in zip(parts, starts, strict=False)]
    return np.concatenate([*inner, starts[-1:]]).astype(np.int32)
