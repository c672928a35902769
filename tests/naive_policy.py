"""Slow, obvious versions of axes, rewards, values and solvers, and small models to hold the fast ones against."""

import itertools
import math

import naive_ground as ground
import numpy as np

from crowdsim.core.bodies import BEYOND
from crowdsim.policy.actions import Actions
from crowdsim.policy.axes.axis import UNSEEN_STRIKE
from crowdsim.policy.axes.velocity import KEPT, LASTS
from crowdsim.policy.environment import HALFWAY, LEAD
from crowdsim.policy.rewards import (
    WASTED,
    HitTerm,
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
    to_torso = np.linalg.norm(middles - point, axis=1).min() - torso_radius
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


NOTHING_ELSE = (0.0, UNSEEN_STRIKE)
"""Heading of a target, and frames until its strike reaches furthest, where they are not given."""


def complete(target):
    """Targets as x, y, z, heading and frames until a strike reaches furthest. Shape (..., 5)."""
    target = np.asarray(target, dtype=float)
    rest = np.array(NOTHING_ELSE[target.shape[-1] - 3 :])
    return np.concatenate([target, np.broadcast_to(rest, (*target.shape[:-1], len(rest)))], axis=-1)


def measure(name, target, moving=(0.0, 0.0, 0.0)):
    """What an axis measures of targets (..., 3 to 5) that move by ``moving`` (..., 3) in a control frame."""
    if name in ("heading", "impact"):
        return complete(target)[..., 3 if name == "heading" else 4]
    x, y, z = (np.asarray(target, dtype=float)[..., k] for k in range(3))
    if name == "velocity":
        vx, vz = (np.asarray(moving, dtype=float)[..., k] for k in (0, 2))
        return vx * np.sin(np.arctan2(x, z)) + vz * np.cos(np.arctan2(x, z))
    return {"distance": np.hypot, "bearing": np.arctan2, "height": lambda *_: y}[name](x, z)


def measured_after(name, before, later, moving, displacement, length):
    """What an axis measures behind an action of a target that was seen ``before``, and is at ``later`` then."""
    value = measure(name, before, moving)
    if name == "heading":
        return value - displacement[2]
    if name == "velocity":
        return value * math.pow(KEPT, length)
    if name == "impact":
        return value - length if value > length else UNSEEN_STRIKE
    return measure(name, later)


def corners(grid, target, moving=(0.0, 0.0, 0.0)):
    """Cells around one target and their multilinear weights, which sum to 1. Shapes (2^D,)."""
    return corners_around(grid, [measure(axis.name, target, moving) for axis in grid.axes])


def corners_after(grid, before, later, moving, displacement, length):
    """The same of one that was seen ``before`` an action, and is at ``later`` behind it."""
    facts = before, later, moving, displacement, length
    return corners_around(grid, [measured_after(axis.name, *facts) for axis in grid.axes])


def corners_around(grid, values):
    """The same of what the axes measure."""
    parts = []
    for axis, stride, value in zip(grid.axes, grid.strides, values, strict=True):
        place = float(axis.places(value))
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


def fade_at(grid, target, moving):
    """How much a behaviour counts for a target."""
    factor = 1.0
    for axis in grid.axes:
        if axis.fade > 0.0 and not axis.wraps:
            value = float(measure(axis.name, target, moving))
            factor *= max(0.0, 1.0 - max(axis.minimum - value, value - axis.maximum, 0.0) / axis.fade)
    return factor


def comes_through(point, origin, head):
    """Whether a kick that comes from over ``origin`` ends behind a body, far beyond its axis."""
    (x, _, z), (from_x, from_z), (axis_x, _, axis_z) = point, origin, head
    far = (x - from_x) ** 2 + (z - from_z) ** 2
    return bool(far > BEYOND * ((axis_x - from_x) ** 2 + (axis_z - from_z) ** 2))


def action_reward(actions, action, target, terms, body, discount, velocity=(0.0, 0.0), lasts=math.inf):
    """r(e, a) for a target (3 to 5,) that moves by ``velocity`` in each of ``lasts`` control frames, along x and z."""
    start, step = np.asarray(target, dtype=float)[:3], np.array([velocity[0], 0.0, velocity[1]])
    impact = complete(target)[4]
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
        elif isinstance(term, HitTerm):
            t = math.ceil(impact - 0.5)
            if 1 <= t <= actions.lengths[action]:
                place = actions.paths[actions.path_offsets[action] + t - 1].astype(float)
                x, _, z = ground.to_local(place, start + min(t, lasts) * step)
                near, far = term.distance
                gap = max(near - math.hypot(x, z), math.hypot(x, z) - far, 0.0)
                total -= term.weight * discount**t * math.exp(-gap / term.sigma)
        elif isinstance(term, TransitionTerm):
            cost = float(actions.costs[action])
            total -= term.weight * cost + (term.each if cost > 0.0 else 0.0)
        else:
            raise AssertionError(f"no twin of {term}")
    return total


def action_values(policy, weights, state, target, moving=(0.0, 0.0, 0.0), lasts=math.inf):
    """What each action of a state is worth for a target (3 to 5,) in the avatar's ground frame. Shape (n,).

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
        factor = weight * fade_at(behaviour.grid, target, moving) / behaviour.scale
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
    target, here = complete(target), moving
    moving = np.append(moving, [0.0, 0.0])
    actions, grid = policy.actions, behaviour.grid
    first, n = int(actions.offsets[state]), int(actions.offsets[state + 1] - actions.offsets[state])
    if behaviour.lookup == "q":
        # The table holds targets at rest only: it is read at the position of the target half an action later.
        # One that sees how the target moves holds that of moving ones.
        lead = 0.0 if sees_motion(grid) else HALFWAY * actions.mean_length
        cells, shares = corners(grid, target + min(lead, lasts) * moving, here)
        return float(shares @ behaviour.values(first * grid.cells + cells * n + (action - first)))
    velocity = moving[[0, 2]], lasts
    reward = action_reward(actions, action, target, behaviour.terms, policy.body, behaviour.discount, *velocity)
    # Values are those of a target at rest; an avatar that pursues a moving one must look ahead.
    length, move = int(actions.lengths[action]), move_of(actions, action)
    lead = 0.0 if sees_motion(grid) else LEAD * actions.mean_length
    moved = target + min(length + lead, lasts) * moving
    cells, shares = corners_after(grid, target, ground.to_local(move, moved[:3]), here, move, length)
    value = float(shares @ behaviour.values(int(actions.next[action]) * grid.cells + cells))
    return reward + math.pow(behaviour.discount, int(actions.lengths[action])) * value


def move_of(actions, action):
    """Ground transform at the end of an action. Shape (3,)."""
    return actions.paths[actions.path_offsets[action + 1] - 1].astype(float)


def sees_motion(grid):
    """Whether a grid says how the target moves."""
    return any(axis.name == "velocity" for axis in grid.axes)


def value_iteration(actions, grid, terms, body, discount, movement, backup, sweeps):
    """Return Q(a, c), shape (A, cells), after many sweeps, in plain Python and float64."""
    observed = grid.observed()
    targets = np.stack([observed.x, observed.y, observed.z, observed.heading, observed.impact], axis=-1)
    count, cells = len(actions.next), grid.cells
    earned, found = np.zeros((count, cells, len(movement.velocities))), {}
    for a, c in itertools.product(range(count), range(cells)):
        length = int(actions.lengths[a])
        own, lasts = np.array([observed.vx[c], 0.0, observed.vz[c]]), LASTS if sees_motion(grid) else math.inf
        for k, drawn in enumerate(movement.velocities):
            vx, vz = drawn + own[[0, 2]]
            earned[a, c, k] = action_reward(actions, a, targets[c], terms, body, discount, (vx, vz), lasts)
            end = move_of(actions, a)
            later = ground.to_local(end, targets[c, :3] + min(length, lasts) * np.array([vx, 0.0, vz]))
            found[a, c, k] = corners_after(grid, targets[c], later, own, end, length)
    around, shares = (np.reshape([one[part] for one in found.values()], (*earned.shape, -1)) for part in (0, 1))
    q = np.zeros((count, cells))
    for _ in range(sweeps):
        values = [q[first:end] for first, end in itertools.pairwise(actions.offsets)]
        q = np.empty_like(q)
        for a, after in enumerate(actions.next):
            if backup == "max_of_interpolated":
                behind = (values[after][:, around[a]] * shares[a]).sum(axis=-1).max(axis=0)
            else:
                behind = (values[after].max(axis=0)[around[a]] * shares[a]).sum(axis=-1)
            q[a] = (earned[a] + math.pow(discount, int(actions.lengths[a])) * behind) @ movement.probabilities
    return q


def by_action(actions, cells, table):
    """Return a flat Q-table as an array of shape (A, cells)."""
    q = np.empty((len(actions.next), cells))
    for first, end in itertools.pairwise(actions.offsets):
        n = int(end - first)
        for c, k in itertools.product(range(cells), range(n)):
            q[first + k, c] = table[first * cells + c * n + k]
    return q
