"""Slow, obvious versions of the solvers, and small models to hold the fast ones against."""

import itertools
import math

import numpy as np

from crowdsim.motion import ground
from crowdsim.policy.action_rewards import action_reward
from crowdsim.policy.actions import Actions
from crowdsim.policy.environment import corners


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


def value_iteration(actions, grid, terms, body, discount, movement, backup, sweeps):
    """Return Q(a, c), shape (A, cells), after many sweeps, in plain Python and float64."""
    targets = grid.targets()
    count, cells = len(actions.next), grid.cells
    outcomes = []
    for a, c in itertools.product(range(count), range(cells)):
        length = int(actions.lengths[a])
        here = []
        for chance, (vx, vz) in zip(movement.probabilities, movement.velocities, strict=True):
            earned = action_reward(actions, a, targets[c], terms, body, discount, (vx, vz))
            moved = targets[c] + length * np.array([vx, 0.0, vz])
            later = ground.to_local(actions.paths[actions.path_offsets[a + 1] - 1].astype(float), moved)
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
