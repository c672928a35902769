"""What each action earns in each cell of a grid (``model.Model``): loops in single precision over many targets."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.exponentials import faded
from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import UNSEEN_STRIKE, Target
from crowdsim.policy.kernels.rewards import HEADING, X, Z, earned_by_strikes
from crowdsim.policy.terms.registry import ONCE, STRIKE, for_frame_terms
from crowdsim.policy.terms.strike import is_wasted
from crowdsim.policy.terms.term import Seen


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
    """Where M targets are over the ground, how they move, and which way they face.

    Attributes:
        xs: To the left [m]. Shape (M,), float32.
        zs: Ahead.
        vxs: How far each moves in a control frame, to the left [m]. Shape (M,), float32.
        vzs: Ahead.
        facing_sins: Sine of the heading of each. Shape (M,), float32.
        facing_coss: Its cosine.
        impacts: Control frames until its strike reaches furthest. Shape (M,), float32.
        lasts: For how many control frames all of them move; float32.
    """

    xs: Any
    zs: Any
    vxs: Any
    vzs: Any
    facing_sins: Any
    facing_coss: Any
    impacts: Any
    lasts: Any


def _build_frames(name, read, gap):
    """Return a kernel that adds what a term of one kind earns along one action's path to the total of each target."""

    def add(path, places, term, log_discount, best, total):
        wanted, greatest = read(term, np.float32), term.greatest != 0.0
        for m in range(len(total)):
            best[m] = np.float32(0.0)
        for t in range(1, len(path) + 1):
            factor, time = np.float32(term.weight * math.exp(t * log_discount)), np.float32(t)
            sin, cos = np.float32(math.sin(path[t - 1, HEADING])), np.float32(math.cos(path[t - 1, HEADING]))
            x, z, moved = path[t - 1, X], path[t - 1, Z], min(time, places.lasts)
            for i in range(len(total)):
                m = np.uint64(i)
                dx, dz = places.xs[m] + moved * places.vxs[m] - x, places.zs[m] + moved * places.vzs[m] - z
                due = places.impacts[m] - time
                seen = Seen(dx, dz, sin, cos, places.facing_sins[m], places.facing_coss[m], due)
                value = factor * faded(gap(seen, wanted))
                best[m] = max(best[m], value) if greatest else best[m] + value
        for m in range(len(total)):
            total[m] += best[m]

    return kernel(add, name=f"add_{name}")


_add_along_path = for_frame_terms(_build_frames)


@kernel
def _spend_on_strikes(actions, action, places, term, log_discount, total):
    """Take what the strikes of one action cost from the total of each target."""
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        t = actions.strike_times[strike]
        fist, moved = (
            (actions.strike_positions[strike, 0], 0.0, actions.strike_positions[strike, 2]),
            min(t, places.lasts),
        )
        factor = term.weight * math.exp(t * log_discount)
        for m in range(len(total)):
            head = places.xs[m] + moved * places.vxs[m], 0.0, places.zs[m] + moved * places.vzs[m]
            total[m] -= factor * (term.effort + (term.waste if is_wasted(fist, head, term) else 0.0))


@kernel
def write_near(actions, action, places, terms, once, log_discount, best, total):
    """Write what one action earns for each target, landed strikes left out.

    Args:
        actions: ``Actions``.
        action: The action.
        places: ``Places``.
        terms: Records of the reward's terms.
        once: What it earns wherever the target is.
        log_discount: log gamma.
        best: Scratch space. Shape (M,), float32.
        total: Written. Shape (M,), float32.
    """
    path = actions.paths[actions.path_offsets[action] : actions.path_offsets[action + 1]]
    for m in range(len(total)):
        total[m] = np.float32(0.0)
    for row in range(len(terms)):
        term = terms[row]
        if term.kind == STRIKE:
            _spend_on_strikes(actions, action, places, term, log_discount, total)
        elif term.kind != ONCE:
            _add_along_path(term.kind, path, places, term, log_discount, best, total)
    for m in range(len(total)):
        total[m] += once


@kernel(allocates=True)
def fill_near(low, high, actions, places, terms, once, log_discount, out):
    """Write what actions ``low`` to ``high`` earn for targets at ``Places``, landed strikes left out.

    ``once`` is what each earns wherever the target is. ``out`` has the shape (A, M), or (A, 1) where that is all.
    """
    best = np.empty(out.shape[1], np.float32)
    for action in range(low, high):
        write_near(actions, action, places, terms, once[action], log_discount, best, out[action])


@kernel
def earned_where(actions, action, target, terms, log_discount):
    """Return what the strikes of an action earn that land on a target."""
    found = 0.0
    for row in range(len(terms)):
        term = terms[row]
        if term.kind == STRIKE:
            found += term.weight * earned_by_strikes(actions, action, target, term, log_discount)
    return found


@kernel
def _in_reach(actions, action, target, terms):
    """Return whether a strike of an action may land on a target, whatever its height."""
    for row in range(len(terms)):
        term = terms[row]
        if term.kind == STRIKE:
            reach = max(term.head_radius, term.torso_radius) + term.tolerance + 1e-6
            for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
                t = min(actions.strike_times[strike], target.lasts)
                dx = target.x + t * target.vx - actions.strike_positions[strike, 0]
                dz = target.z + t * target.vz - actions.strike_positions[strike, 2]
                if dx * dx + dz * dz <= reach * reach:
                    return True
    return False


@kernel
def _list_landed(actions, action, targets, layers, movement, terms, log_discount, at, landed):
    """List the cells where strikes of an action land, from entry ``at`` on; return how many they are."""
    held = 0
    if actions.strike_offsets[action] == actions.strike_offsets[action + 1]:
        return held
    for first in range(0, len(targets), layers):
        x, z = targets[first, 0], targets[first, 2]
        vx, vz, lasts = movement[0] + targets[first, 3], movement[1] + targets[first, 4], movement[2]
        if not _in_reach(actions, action, Target(x, 0.0, z, vx, vz, 0.0, UNSEEN_STRIKE, lasts), terms):
            continue
        for c in range(first, first + layers):
            target = Target(x, targets[c, 1], z, vx, vz, 0.0, UNSEEN_STRIKE, lasts)
            earned = earned_where(actions, action, target, terms, log_discount)
            if earned > 0.0:
                if len(landed.cells) > 0:
                    landed.cells[at + held], landed.rewards[at + held] = c, earned
                held += 1
    return held


@kernel
def fill_landed(low, high, actions, targets, layers, movements, terms, log_discount, landed):
    """Write the cells in which strikes of actions ``low`` to ``high`` land and what they earn there into ``Landed``.

    Without room for cells they are only counted. ``targets`` are head and motion, as in ``Target``; ``layers`` of them
    after one another are over the same place and move alike. ``movements`` are the velocity that each outcome adds,
    along x and z, and for how many frames targets move. Shape (O, 3).
    """
    count, offsets, counting = len(actions.next), landed.offsets, len(landed.cells) == 0
    for action in range(low, high):
        for outcome in range(len(movements)):
            at = offsets[outcome * count + action]
            held = _list_landed(actions, action, targets, layers, movements[outcome], terms, log_discount, at, landed)
            if counting:
                offsets[outcome * count + action + 1] = held
