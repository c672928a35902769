"""What each action earns in each cell of a grid (``model.Model``)."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel
from crowdsim.policy.kernels.rewards import (
    ASIDE,
    CODE,
    FACING,
    GREATEST_PROXIMITY,
    GREATEST_STRIKE,
    HEAD_RADIUS,
    HEADING,
    LEAST,
    MOST,
    PROXIMITY,
    SIGMA,
    SPEED_WEIGHT,
    STRIKE,
    TOLERANCE,
    TORSO_RADIUS,
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


class Places(NamedTuple):
    """Where M targets are over the ground, and how they move.

    Attributes:
        xs: To the left [m]. Shape (M,), float32.
        zs: Ahead.
        vxs: How far each moves in a control frame, to the left [m]. Shape (M,), float32.
        vzs: Ahead.
    """

    xs: Any
    zs: Any
    vxs: Any
    vzs: Any


@kernel(inline=True)
def _faded(gap):
    """Return exp(-gap) of a number from 0 on, float32, with a relative error of 5e-6; above 32 that of 32.

    exp(v) = exp(v / 32) ^ 32, the polynomial that is best there, and five squarings.
    """
    y = min(gap, np.float32(32.0)) * np.float32(-1.0 / 32.0)
    value = np.float32(0.000849007873) * y + np.float32(0.0076543251)
    value = value * y + np.float32(0.0412233177)
    value = value * y + np.float32(0.166515167)
    value = value * y + np.float32(0.499975091)
    value = value * y + np.float32(0.999998454)
    value = value * y + np.float32(0.999999984)
    value *= value
    value *= value
    value *= value
    value *= value
    return value * value


@kernel(inline=True)
def _gap_ahead(dx, dz, sin, cos, least, most, wide):
    """Return the distance of a place from the strip ahead, from ``least`` to ``most`` and ``wide`` to either side."""
    aside = max(abs(dx * cos - dz * sin) - wide, np.float32(0.0))
    ahead = dx * sin + dz * cos
    ahead -= min(max(ahead, least), most)
    return np.float32(math.sqrt(ahead * ahead + aside * aside))


@kernel(inline=True)
def _gap_around(dx, dz, least, most):
    """Return the distance of a place from the ring between ``least`` and ``most``."""
    far = np.float32(math.sqrt(dx * dx + dz * dz))
    return abs(far - min(max(far, least), most))


@kernel(allocates=False)
def _add_proximity(path, places, terms, row, log_discount, best, total):
    """Add the proximity term (``proximity_reward``) of one action's path to the total of each target."""
    least, most, wide = np.float32(terms[row, LEAST]), np.float32(terms[row, MOST]), np.float32(terms[row, ASIDE])
    greatest, facing = terms[row, GREATEST_PROXIMITY] != 0.0, terms[row, FACING] != 0.0
    shrink = np.float32(1.0 / terms[row, SIGMA])
    for m in range(len(total)):
        best[m] = np.float32(0.0)
    for t in range(1, len(path) + 1):
        factor, time = np.float32(terms[row, WEIGHT] * math.exp(t * log_discount)), np.float32(t)
        sin, cos = np.float32(math.sin(path[t - 1, HEADING])), np.float32(math.cos(path[t - 1, HEADING]))
        x, z = path[t - 1, X], path[t - 1, Z]
        if facing:
            for i in range(len(total)):
                m = np.uint64(i)
                dx, dz = places.xs[m] + time * places.vxs[m] - x, places.zs[m] + time * places.vzs[m] - z
                value = factor * _faded(_gap_ahead(dx, dz, sin, cos, least, most, wide) * shrink)
                best[m] = max(best[m], value) if greatest else best[m] + value
        else:
            for i in range(len(total)):
                m = np.uint64(i)
                dx, dz = places.xs[m] + time * places.vxs[m] - x, places.zs[m] + time * places.vzs[m] - z
                value = factor * _faded(_gap_around(dx, dz, least, most) * shrink)
                best[m] = max(best[m], value) if greatest else best[m] + value
    for m in range(len(total)):
        total[m] += best[m]


@kernel(allocates=False)
def _spend_on_strikes(actions, action, places, terms, row, log_discount, total):
    """Take what the strikes of one action cost from the total of each target."""
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        t = actions.strike_times[strike]
        px, pz = actions.strike_positions[strike, 0], actions.strike_positions[strike, 2]
        factor = terms[row, WEIGHT] * math.exp(t * log_discount)
        for m in range(len(total)):
            x, z = places.xs[m] + t * places.vxs[m], places.zs[m] + t * places.vzs[m]
            total[m] -= factor * spent_on_strike(px, pz, x, z, terms, row)


@kernel(allocates=False)
def write_near(actions, action, places, terms, log_discount, best, total):
    """Write what one action earns for each target, landed strikes left out; ``best`` is scratch space."""
    path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]]
    for m in range(len(total)):
        total[m] = np.float32(0.0)
    for row in range(len(terms)):
        if terms[row, CODE] == PROXIMITY:
            _add_proximity(path, places, terms, row, log_discount, best, total)
        elif terms[row, CODE] == STRIKE:
            _spend_on_strikes(actions, action, places, terms, row, log_discount, total)
        else:
            for m in range(len(total)):
                target = Target(places.xs[m], 0.0, places.zs[m], places.vxs[m], places.vzs[m])
                total[m] += term_reward(actions, action, target, terms, row, log_discount)


@kernel
def fill_near(low, high, actions, places, terms, log_discount, out):
    """Write what actions ``low`` to ``high`` earn for targets at ``Places``, landed strikes left out.

    ``out`` has the shape (A, M), or (A, 1) where the reward is the same everywhere.
    """
    best = np.empty(out.shape[1], np.float32)
    for action in range(low, high):
        write_near(actions, action, places, terms, log_discount, best, out[action])


@kernel(allocates=False)
def earned_where(actions, action, head, velocity, terms, log_discount):
    """Return what the strikes of an action earn that land on a target with its head at a point."""
    found = 0.0
    for row in range(len(terms)):
        if terms[row, CODE] != STRIKE:
            continue
        best, total = 0.0, 0.0
        for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
            t = actions.strike_times[strike]
            fists = actions.strike_positions
            fist = fists[strike, 0], fists[strike, 1], fists[strike, 2]
            origin = actions.strike_origins[strike, 0], actions.strike_origins[strike, 1]
            moved = head[0] + t * velocity[X], head[1], head[2] + t * velocity[Z]
            if strike_lands(fist, origin, moved, terms, row):
                earned = math.exp(t * log_discount) * actions.strike_speeds[strike] ** terms[row, SPEED_WEIGHT]
                best = max(best, earned)
                total += earned
        found += terms[row, WEIGHT] * (best if terms[row, GREATEST_STRIKE] != 0.0 else total)
    return found


@kernel(allocates=False)
def _in_reach(actions, action, x, z, velocity, terms):
    """Return whether a strike of an action may land on a target that starts with its head over (x, z)."""
    for row in range(len(terms)):
        if terms[row, CODE] == STRIKE:
            reach = max(terms[row, HEAD_RADIUS], terms[row, TORSO_RADIUS]) + terms[row, TOLERANCE] + 1e-6
            for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
                t = actions.strike_times[strike]
                dx = x + t * velocity[X] - actions.strike_positions[strike, 0]
                dz = z + t * velocity[Z] - actions.strike_positions[strike, 2]
                if dx * dx + dz * dz <= reach * reach:
                    return True
    return False


@kernel(allocates=False)
def _list_landed(actions, action, targets, layers, velocity, terms, log_discount, at, landed):
    """List the cells where strikes of an action land, from entry ``at`` on; return how many they are."""
    held = 0
    if actions.strike_offsets[action] == actions.strike_offsets[action + 1]:
        return held
    for first in range(0, len(targets), layers):
        if not _in_reach(actions, action, targets[first, 0], targets[first, 2], velocity, terms):
            continue
        for c in range(first, first + layers):
            head = targets[c, 0], targets[c, 1], targets[c, 2]
            earned = earned_where(actions, action, head, velocity, terms, log_discount)
            if earned > 0.0:
                if len(landed.cells) > 0:
                    landed.cells[at + held], landed.rewards[at + held] = c, earned
                held += 1
    return held


@kernel(allocates=False)
def fill_landed(low, high, actions, targets, layers, velocities, terms, log_discount, landed):
    """Write the cells in which strikes of actions ``low`` to ``high`` land and what they earn there into ``Landed``.

    Without room for cells they are only counted. ``layers`` targets after one another are over the same place.
    """
    count, offsets, counting = len(actions.next), landed.offsets, len(landed.cells) == 0
    for action in range(low, high):
        for outcome in range(len(velocities)):
            at = offsets[outcome * count + action]
            held = _list_landed(actions, action, targets, layers, velocities[outcome], terms, log_discount, at, landed)
            if counting:
                offsets[outcome * count + action + 1] = held
