"""Slow, obvious versions of axes, rewards, values and solvers, and small models to hold the fast ones against."""

import itertools
import math

import numpy as np

from crowdsim.core.bodies import BEYOND
from crowdsim.motion import ground
from crowdsim.policy.actions import Actions
from crowdsim.policy.environment import HALFWAY, LEAD, fade_factor
from crowdsim.policy.rewards import (
    WASTED,
    ProximityTerm,
    StrikeTerm,
    TransitionTerm,
    lands,
)
from crowdsim.policy.rewards import surface_distance as distance_from_body


def surface_distance(point, head, neck, pelvis, head_radius, torso_radius, steps=20_000):
    """Signed distance of a point from a ball and a capsule together: the least of those from the balls they are of."""
    along = np.linspace(0.0, 1.0, steps + 1)[:, None]
    middles = (1.0 - along) * np.asarray(neck, float) + along * np.asarray(pelvis, float)
    to_torso = min(np.linalg.norm(middles - point, axis=1)) - torso_radius
    return min(math.dist(point, head) - head_radius, float(to_torso))


def random_actions(states=12, seed=0, longest=4):
    """Return random actions: some states have one action, some seven; half of the actions strike, some twice."""
    draw = np.random.default_rng(seed)
    n = draw.integers(1, 8, states)
    count = int(n.sum())
    lengths = draw.integers(1, longest + 1, count).astype(np.int32)
    path_offsets = np.concatenate([[0], np.cumsum(lengths)])
    frames = np.arange(path_offsets[-1]) - np.repeat(path_offsets[:-1], lengths) + 1
    steps = draw.normal(0.0, [0.08, 0.08, 0.15], (count, 3))
    strikes = draw.integers(0, 3, count)
    k = int(strikes.sum())
    owner = np.repeat(np.arange(count), strikes)
    bearing, distance = draw.uniform(-1.2, 1.2, k), draw.uniform(0.3, 1.0, k)
    places = np.stack([distance * np.sin(bearing), draw.uniform(1.0, 1.6, k), distance * np.cos(bearing)], -1)
    return Actions(
        offsets=np.concatenate([[0], np.cumsum(n)]).astype(np.int32),
        next=draw.integers(0, states, count).astype(np.int32),
        lengths=lengths,
        shifts=np.zeros((count, 3), np.float32),
        costs=np.where(draw.random(count) < 0.3, 0.0, draw.random(count)).astype(np.float32),
        path_offsets=path_offsets.astype(np.int32),
        paths=(np.repeat(steps, lengths, axis=0) * frames[:, None]).astype(np.float32),
        strike_offsets=np.concatenate([[0], np.cumsum(strikes)]).astype(np.int32),
        strike_times=(draw.uniform(0.05, 1.0, k) * lengths[owner]).astype(np.float32),
        strike_positions=places.astype(np.float32),
        strike_origins=np.where(np.arange(k)[:, None] % 3 == 0, 0.0, places[:, [0, 2]]).astype(np.float32),
        strike_speeds=draw.uniform(0.5, 1.5, k).astype(np.float32),
        strike_ids=np.arange(k, dtype=np.int32),
    )


def measure(name, target):
    """What an axis measures of targets: x, y, z and, where it is known, the heading. Shape (..., 3 or 4)."""
    x, y, z, *heading = np.moveaxis(np.asarray(target, dtype=float), -1, 0)
    return {
        "distance": np.hypot(x, z),
        "bearing": np.arctan2(x, z),
        "height": y,
        "heading": heading[0] if heading else np.zeros_like(x),
    }[name]


def corners(grid, target):
    """Cells around one target and their multilinear weights, which sum to 1. Shapes (2^D,)."""
    parts = []
    for axis, stride in zip(grid.axes, grid.strides, strict=True):
        place = float(axis.places(measure(axis.name, target)))
        if axis.wraps:
            place %= axis.count
            lower = min(int(place), axis.count - 1)
            upper = (lower + 1) % axis.count
        else:
            place = min(max(place, 0.0), axis.count - 1.0)
            lower = max(min(int(place), axis.count - 2), 0)
            upper = min(lower + 1, axis.count - 1)
        share = place - lower
        parts.append(((lower * stride, 1.0 - share), (upper * stride, share)))
    combined = list(itertools.product(*parts))
    cells = np.array([sum(cell for cell, _ in corner) for corner in combined], dtype=np.int64)
    return cells, np.array([math.prod(weight for _, weight in corner) for corner in combined])


def seen_after(displacement, target):
    """A target (3 or 4,) as it is seen from where an action ends."""
    target = np.asarray(target, dtype=float)
    return np.concatenate([ground.to_local(displacement, target[:3]), target[3:] - displacement[2]])


def comes_through(point, origin, head):
    """Whether a kick that comes from over ``origin`` ends behind a body, far beyond its axis."""
    (x, _, z), (from_x, from_z), (axis_x, _, axis_z) = point, origin, head
    far = (x - from_x) ** 2 + (z - from_z) ** 2
    return bool(far > BEYOND * ((axis_x - from_x) ** 2 + (axis_z - from_z) ** 2))


def action_reward(actions, action, target, terms, body, discount, velocity=(0.0, 0.0), lasts=math.inf):
    """r(e, a) for a target (3 or 4,) that moves by ``velocity`` in each of ``lasts`` control frames, along x and z."""
    start, step = np.asarray(target, dtype=float)[:3], np.array([velocity[0], 0.0, velocity[1]])
    total = 0.0
    for term in terms:
        if isinstance(term, StrikeTerm):
            found, spent = [0.0], 0.0
            for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
                t = float(actions.strike_times[strike])
                place = start + min(t, lasts) * step
                fist = actions.strike_positions[strike].astype(float)
                away = fist - place
                spent += discount**t * (term.effort + term.waste * (math.hypot(away[0], away[2]) > WASTED))
                through = comes_through(fist, actions.strike_origins[strike].astype(float), place)
                if lands(distance_from_body(fist, place, body), term.tolerance) and not through:
                    found.append(discount**t * float(actions.strike_speeds[strike]) ** term.speed_weight)
            total += term.weight * ((max(found) if term.form == "max" else sum(found)) - spent)
        elif isinstance(term, ProximityTerm):
            path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]].astype(float)
            values = []
            for t, place in enumerate(path, start=1):
                x, _, z = ground.to_local(place, start + min(t, lasts) * step)
                ahead = z if term.facing else math.hypot(x, z)
                gap = ahead - min(max(ahead, term.between[0]), term.between[1])
                if term.facing:
                    gap = math.hypot(gap, max(abs(x) - term.aside, 0.0))
                values.append(discount**t * math.exp(-abs(gap) / term.sigma))
            total += term.weight * (sum(values) if term.form == "sum" else max(values))
        elif isinstance(term, TransitionTerm):
            cost = float(actions.costs[action])
            total -= term.weight * cost + (term.each if cost > 0.0 else 0.0)
        else:
            raise AssertionError(f"no twin of {term}")
    return total


def action_values(policy, weights, state, target, moving=(0.0, 0.0, 0.0), lasts=math.inf):
    """What each action of a state is worth for a target (3 or 4,) in the avatar's ground frame. Shape (n,).

    Values of behaviours are divided by their scale, multiplied by their weight and by how much they count at the
    target, and added (paper, section 5). What a transition costs is in the values of every behaviour that prices it;
    here it is counted once, at the highest of their prices. The target moves by ``moving`` (3,) in each of ``lasts``
    control frames."""
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


def _action_value(policy, behaviour, state, action, target, moving, lasts):
    """Q(e, a) of one behaviour."""
    target, moving = np.pad(target, (0, 4 - len(target))), np.append(moving, 0.0)
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
    later = seen_after(actions.displacements[action].astype(float), moved)
    cells, shares = corners(grid, later)
    value = float(shares @ behaviour.values(int(actions.next[action]) * grid.cells + cells))
    return reward + math.pow(behaviour.discount, int(actions.lengths[action])) * value


def value_iteration(actions, grid, terms, body, discount, movement, backup, sweeps):
    """Return Q(a, c), shape (A, cells), after many sweeps, in plain Python and float64."""
    observed = grid.observed()
    targets = np.stack([observed.x, observed.y, observed.z, observed.heading], axis=-1)
    count, cells = len(actions.next), grid.cells
    outcomes = []
    for a, c in itertools.product(range(count), range(cells)):
        length = int(actions.lengths[a])
        here = []
        for chance, (vx, vz) in zip(movement.probabilities, movement.velocities, strict=True):
            earned = action_reward(actions, a, targets[c], terms, body, discount, (vx, vz))
            moved = targets[c] + length * np.array([vx, 0.0, vz, 0.0])
            later = seen_after(actions.paths[actions.path_offsets[a + 1] - 1].astype(float), moved)
            here.append((chance, earned, *corners(grid, later)))
        outcomes.append(here)
    q = np.zeros((count, cells))
    for _ in range(sweeps):
        q = _sweep(actions, discount, backup, outcomes, q)
    return q


def _sweep(actions, discount, backup, outcomes, q):
    values = [q[first:end] for first, end in itertools.pairwise(actions.offsets)]
    best = [rows.max(axis=0) for rows in values]
    fresh = np.zeros(q.size)
    for place, here in enumerate(outcomes):
        a = place // q.shape[1]
        after = int(actions.next[a])
        for chance, earned, around, shares in here:
            if backup == "max_of_interpolated":
                behind = float((values[after][:, around] @ shares).max())
            else:
                behind = float(best[after][around] @ shares)
            fresh[place] += chance * (earned + math.pow(discount, int(actions.lengths[a])) * behind)
    return fresh.reshape(q.shape)


def by_action(actions, cells, table):
    """Return a flat Q-table as an array of shape (A, cells)."""
    q = np.empty((len(actions.next), cells))
    for first, end in itertools.pairwise(actions.offsets):
        n = int(end - first)
        for c, k in itertools.product(range(cells), range(n)):
            q[first + k, c] = table[first * cells + c * n + k]
    return q
