"""What each action earns in each cell of a grid (``model.Model``)."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import prange

from crowdsim.core.exponentials import exponential
from crowdsim.jit import kernel
from crowdsim.policy.kernels.rewards import (
    ASIDE,
    CODE,
    FACING,
    GREATEST_PROXIMITY,
    GREATEST_STRIKE,
    HEADING,
    LEAST,
    MOST,
    PROXIMITY,
    SIGMA,
    SPEED_WEIGHT,
    STRIKE,
    WEIGHT,
    Target,
    X,
    Z,
    spent_on_strike,
    strike_lands,
    term_reward,
)


class Landed(NamedTuple):
    """Where strikes land; CSR over outcome and action.

    Attributes:
        offsets: Entries ``offsets[o * A + a]:offsets[o * A + a + 1]`` belong to outcome o and action a; or, while they
            are counted, the number of them at ``o * A + a + 1``. Shape (O * A + 1,), int64.
        cells: Cells, ascending. Flat, int32; empty while they are counted.
        rewards: What the strikes earn there. Flat, float32.
    """

    offsets: Any
    cells: Any
    rewards: Any


@kernel(allocates=False)
def _add_proximity(path, xs, zs, velocity, terms, row, log_discount, best, total):
    """Add the proximity term (``proximity_reward``) of one action's path to the total of targets over (xs, zs)."""
    weight, least, shrink = terms[row, WEIGHT], terms[row, LEAST], -1.0 / terms[row, SIGMA]
    greatest, facing = terms[row, GREATEST_PROXIMITY] != 0.0, terms[row, FACING] != 0.0
    most, wide = terms[row, MOST], terms[row, ASIDE]
    for m in range(len(total)):
        best[m] = 0.0
    for t in range(1, len(path) + 1):
        factor = weight * math.exp(t * log_discount)
        sin, cos = math.sin(path[t - 1, HEADING]), math.cos(path[t - 1, HEADING])
        left, ahead_of = path[t - 1, X] - t * velocity[X], path[t - 1, Z] - t * velocity[Z]
        for m in range(len(total)):
            dx, dz = xs[m] - left, zs[m] - ahead_of
            aside = max(abs(dx * cos - dz * sin) - wide, 0.0) if facing else 0.0
            ahead = dx * sin + dz * cos if facing else math.sqrt(dx * dx + dz * dz)
            ahead -= min(max(ahead, least), most)
            value = factor * exponential(math.sqrt(ahead * ahead + aside * aside) * shrink)
            best[m] = max(best[m], value) if greatest else best[m] + value
    for m in range(len(total)):
        total[m] += best[m]


@kernel(allocates=False)
def _spend_on_strikes(actions, action, xs, zs, velocity, terms, row, log_discount, total):
    """Take what the strikes of one action cost from the total of targets over (xs, zs)."""
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        t = actions.strike_times[strike]
        px, pz = actions.strike_places[strike, 0], actions.strike_places[strike, 2]
        factor = terms[row, WEIGHT] * math.exp(t * log_discount)
        for m in range(len(total)):
            x, z = xs[m] + t * velocity[X], zs[m] + t * velocity[Z]
            total[m] -= factor * spent_on_strike(px, pz, x, z, terms, row)


@kernel(allocates=False)
def _fill_near_action(actions, action, xs, zs, velocity, terms, log_discount, best, total):
    """Do what ``fill_near`` does for one action and one way in which the target moves; ``best`` is scratch space."""
    path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]]
    for m in range(len(total)):
        total[m] = 0.0
    for row in range(len(terms)):
        if terms[row, CODE] == PROXIMITY:
            _add_proximity(path, xs, zs, velocity, terms, row, log_discount, best, total)
        elif terms[row, CODE] == STRIKE:
            _spend_on_strikes(actions, action, xs, zs, velocity, terms, row, log_discount, total)
        else:
            for m in range(len(total)):
                target = Target(xs[m], 0.0, zs[m], velocity[X], velocity[Z])
                total[m] += term_reward(actions, action, target, terms, row, log_discount)


@kernel(parallel=True)
def fill_near(actions, xs, zs, velocities, terms, log_discount, out):
    """Write what each action earns for targets over (xs, zs), landed strikes left out.

    ``out`` has the shape (O, A, M), or (O, A, 1) where the reward is the same everywhere.
    """
    count = out.shape[2]
    for action in prange(out.shape[1]):
        best, total = np.empty(count), np.empty(count)
        for outcome in range(out.shape[0]):
            _fill_near_action(actions, np.int64(action), xs, zs, velocities[outcome], terms, log_discount, best, total)
            for m in range(count):
                out[outcome, action, m] = total[m]


@kernel(allocates=False)
def _earned_where(actions, action, head, velocity, terms, log_discount):
    """Return what the strikes of an action earn that land on a target with its head at a point."""
    found = 0.0
    for row in range(len(terms)):
        if terms[row, CODE] != STRIKE:
            continue
        best, total = 0.0, 0.0
        for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
            t = actions.strike_times[strike]
            fists = actions.strike_places
            fist = fists[strike, 0], fists[strike, 1], fists[strike, 2]
            moved = head[0] + t * velocity[X], head[1], head[2] + t * velocity[Z]
            if strike_lands(fist, moved, terms, row):
                earned = math.exp(t * log_discount) * actions.strike_speeds[strike] ** terms[row, SPEED_WEIGHT]
                best = max(best, earned)
                total += earned
        found += terms[row, WEIGHT] * (best if terms[row, GREATEST_STRIKE] != 0.0 else total)
    return found


@kernel(allocates=False)
def _list_landed(actions, action, targets, velocity, terms, log_discount, at, landed):
    """List the cells where strikes of an action land, from entry ``at`` on; return how many they are."""
    held = 0
    if actions.strike_offsets[action] == actions.strike_offsets[action + 1]:
        return held
    for c in range(len(targets)):
        head = targets[c, 0], targets[c, 1], targets[c, 2]
        earned = _earned_where(actions, action, head, velocity, terms, log_discount)
        if earned > 0.0:
            if len(landed.cells) > 0:
                landed.cells[at + held], landed.rewards[at + held] = c, earned
            held += 1
    return held


@kernel(parallel=True)
def fill_landed(actions, targets, velocities, terms, log_discount, landed):
    """Write the cells in which strikes of each action land and what they earn there into ``Landed``.

    Without room for cells they are only counted.
    """
    count, offsets, counting = len(actions.next), landed.offsets, len(landed.cells) == 0
    for i in prange(count):
        action = np.int64(i)
        for outcome in range(len(velocities)):
            at = offsets[outcome * count + action]
            held = _list_landed(actions, action, targets, velocities[outcome], terms, log_discount, at, landed)
            if counting:
                offsets[outcome * count + action + 1] = held
