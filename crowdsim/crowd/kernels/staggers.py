"""Staggers: an avatar that a blow throws off its feet leaves what it is doing at the blow, and catches itself."""

import math

import numpy as np

from crowdsim.crowd.kernels.advance import start_action
from crowdsim.crowd.kernels.confinement import confine
from crowdsim.crowd.kernels.falling import pick_fall
from crowdsim.crowd.kernels.knock_downs import leave_action
from crowdsim.crowd.kernels.layout import BLOCKED, LANDED, STAGGERS, STUMBLES, UP
from crowdsim.crowd.kernels.positions import way_between
from crowdsim.crowd.kernels.travelling import travels
from crowdsim.jit import kernel

THROWS, PUSH, FURTHEST = 1.4, 0.24, 0.7  # strength from which on a hit throws, how far by its square, and at most [m]
SPOILS, SOON = 1.0, 12.0  # strength that throws one about to strike, and how soon that one does [control frames]
AGAIN = 6.0  # for how long a further hit throws no avatar that staggers already [control frames]
SEES, NEIGHBOURS = 3.0, 96  # how far away those are that may be in the way [m], and how many of them count


@kernel(inline=True)
def list_thrown(model, avatars, world, now, strikes, first, last, out):
    """List in ``out`` (``THROWN``) whom strikes ``first`` to ``last`` throw off their feet; return how many they are.

    The hardest hit of a frame counts. An avatar that has thrown a strike itself since the frame before keeps its feet;
    one that is about to throw one is thrown by less, and does not.
    """
    held = 0
    if model.falls.shape[0] == 0:
        return held
    hurts = avatars.conditions.shape[0] > 0
    for k in range(first, last):
        victim = strikes[k].victim
        if victim < 0 or not (strikes[k].outcome == LANDED or strikes[k].outcome == BLOCKED):
            continue
        j = avatars.slot_of[victim]
        if avatars.fight[j].hit_by != strikes[k].attacker or avatars.fight[j].hit_frame != now.frame:
            continue
        push = 0.0
        if hurts and avatars.conditions[victim].standing == STAGGERS:
            avatars.conditions[victim].standing = UP
            push = _push(model, avatars, j, 0.0)
        elif world.crowding.back > 0.0:
            push = _push(model, avatars, j, THROWS)
        # Strikes of one attacker follow one another.
        again = (held > 0 and out[held - 1].slot == j) or _is_thrown(model, avatars, j)
        strikes_back = avatars.motion[j].phase > avatars.playback[j].pending
        if push > 0.0 and not (again or strikes_back or avatars.team[j] < 0 or travels(avatars, j)):
            out[held].slot, out[held].hit, out[held].push = j, strikes[k].frame, push
            held += 1
    return held


@kernel
def stagger(model, avatars, world, now, thrown, observed):
    """Let avatars stagger from the blow on that ``list_thrown`` has listed, where there is a stagger and room for it.

    All choose before any of them moves, so that their order does not matter. ``observed`` runs along with ``thrown``.
    """
    for q in range(thrown.shape[0]):
        own = np.int64(thrown[q].slot)
        action = model.actions[avatars.motion[own].action]
        shown = min(avatars.motion[own].phase, np.float64(action.length)) * model.policies[avatars.policy[own]].stride
        left = np.int64(action.origin + math.floor(shown))
        nothing = world.pauses[:0]
        _keep_near(avatars, own, observed, q)
        thrown[q].row = pick_fall(
            model, avatars, world, now.frame, own, STUMBLES, thrown[q].push, left, nothing, observed, q
        )
    for q in range(thrown.shape[0]):
        own, row = np.int64(thrown[q].slot), np.int64(thrown[q].row)
        if row < 0:
            continue
        left = leave_action(model, avatars, now.frame, own, thrown[q].hit)
        if avatars.conditions.shape[0] > 0:
            condition = avatars.conditions[avatars.number[own]]
            condition.standing_next, condition.piece, condition.does_next = UP, 0.0, condition.does
        start_action(model, avatars, world, now.frame, own, np.int64(model.falls[row].action), left[0])
        avatars.playback[own].pending = model.actions[avatars.motion[own].action].first_strike
        avatars.playback[own].action_before, avatars.playback[own].phase_before = -1, left[0]
        avatars.fight[own].decisions += 1
        if world.places.parts.shape[0] > 0:
            confine(model, avatars, world, now.frame, own)


@kernel(inline=True)
def _keep_near(avatars, own, observed, q):
    """Keep those of an avatar's neighbours that are within ``SEES`` of where it is now; an index lists more."""
    held = 0
    for k in range(observed.counts[q]):
        j = observed.neighbours[q, k]
        dx, dz = way_between(avatars, own, j)
        if dx * dx + dz * dz <= SEES * SEES:
            observed.neighbours[q, held] = j
            held += 1
    observed.counts[q] = held


@kernel(inline=True)
def _push(model, avatars, j, least):
    """Return how far the last hit throws an avatar off its feet [m]; 0 where it is weaker than ``least``."""
    x, z = np.float64(avatars.fight[j].hit_x), np.float64(avatars.fight[j].hit_z)
    square, motion = x * x + z * z, avatars.motion[j]
    left = avatars.playback[j].pending - np.float64(motion.phase)
    if 0.0 <= left < min(SOON * motion.speed, model.actions[motion.action].length):
        least = min(least, SPOILS)
    return 0.0 if square < least * least else min(PUSH * square, FURTHEST)


@kernel(inline=True)
def _is_thrown(model, avatars, j):
    """Return whether an avatar has just begun to stagger."""
    found = False
    if avatars.motion[j].phase < AGAIN:
        for row in range(model.falls.shape[0]):
            found |= model.falls[row].kind == STUMBLES and model.falls[row].action == avatars.motion[j].action
    return found
