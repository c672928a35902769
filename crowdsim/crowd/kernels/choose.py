"""The choice of the next action: a draw among those whose values are near the best one, unless one is forced."""

import numpy as np

from crowdsim.core.candidates import CandidateRules, draw_candidate
from crowdsim.core.random import uniform
from crowdsim.crowd.kernels.cheering import cheering_action
from crowdsim.crowd.kernels.forced_actions import special_action
from crowdsim.crowd.kernels.intents import is_resting
from crowdsim.crowd.kernels.layout import AHEAD
from crowdsim.crowd.kernels.outcomes import note_seen
from crowdsim.crowd.kernels.prefetch import prefetch, prefetch_avatar
from crowdsim.crowd.kernels.resting import resting_action
from crowdsim.crowd.kernels.vetoes.crossed_legs import crosses_legs
from crowdsim.crowd.kernels.vetoes.same_strike import mirrors_opponent
from crowdsim.crowd.kernels.vetoes.strike_at_air import strikes_air
from crowdsim.jit import kernel

BURSTS = (2, 5)  # least and most strikes of a burst
WEARY = 3.0  # how much longer it takes an exhausted avatar to recover from a strike, over one that is not tired
REDRAWN = 4  # how often an avatar draws again that has drawn an action to which there is a veto


@kernel(inline=True)
def choose(model, avatars, world, now, due, count, observed, scratch, out_chosen):
    """Draw the next action of avatars ``due[:count]`` by its value; return -1, or a slot without numbers."""
    for q in range(count):
        _prefetch_drawing(avatars, due, count, q)
        own = np.int64(due[q])
        action = _forced_action(model, avatars, world, now, own, observed, q)
        if action < 0:
            action = _draw(model, avatars, world, now, own, observed, q, scratch)
            if action < 0:
                return own
            _note_strikes(model, avatars, world, now, own, action)
        out_chosen[q] = action
    return -1


@kernel(inline=True)
def _prefetch_drawing(avatars, due, count, q):
    """Prefetch what avatars soon after the ``q``-th one will read of themselves and of their opponents."""
    if q + 3 * AHEAD < count:
        own = due[q + 3 * AHEAD]
        prefetch_avatar(avatars, own)
        prefetch(avatars.fight, own)
    if q + 2 * AHEAD < count:
        prefetch(avatars.slot_of, max(avatars.fight[due[q + 2 * AHEAD]].next_opponent, 0))
    if q + AHEAD < count:
        j = avatars.slot_of[max(avatars.fight[due[q + AHEAD]].next_opponent, 0)]
        prefetch_avatar(avatars, j)
        prefetch(avatars.fight, j)


@kernel(inline=True)
def _forced_action(model, avatars, world, now, own, observed, q):
    """Return the action of an avatar that falls, is down or rests; -1 where it may choose."""
    if avatars.conditions.shape[0] == 0:
        return -1
    action = special_action(model, avatars, now.frame, own)
    if action >= 0:
        avatars.conditions[avatars.number[own]].piece = 0.0
        return action
    action = cheering_action(model, avatars, world, now, own)
    if action < 0 and model.ways_to_rest.shape[0] > 0:
        action = resting_action(model, avatars, world, now, own)
    return action


@kernel(inline=True)
def _draw(model, avatars, world, now, own, observed, q, scratch):
    """Draw among the actions of an avatar by their values, again while there is a veto; -1 where none is a number."""
    values = scratch.values[q]
    cohort, state = world.cohorts[avatars.playback[own].cohort], model.actions[avatars.motion[own].action].next
    offset, count = model.offsets[state], model.offsets[state + 1] - model.offsets[state]
    number = uniform(world.streams.choice, np.int64(avatars.number[own]), np.int64(avatars.fight[own].decisions))
    rules = CandidateRules(cohort.margin, cohort.most, cohort.temperature)
    picked = draw_candidate(values, count, rules, number, scratch.rows)
    for _ in range(REDRAWN):
        if picked < 0:
            return -1
        cost = _object_to(model, avatars, world, now, own, observed, q, offset + picked)
        if cost == 0.0:
            break
        values[picked] -= cost
        picked = draw_candidate(values, count, rules, number, scratch.rows)
    return offset + picked if picked >= 0 else -1


@kernel(inline=True)
def _object_to(model, avatars, world, now, own, observed, q, action):
    """Return what the first veto to an action costs it; 0 where there is none."""
    cost = mirrors_opponent(model, avatars, world, now, own, observed, q, action)
    if cost == 0.0:
        cost = crosses_legs(model, avatars, world, now, own, observed, q, action)
    if cost == 0.0:
        cost = strikes_air(model, avatars, world, now, own, observed, q, action)
    return cost


@kernel(inline=True)
def _note_strikes(model, avatars, world, now, own, action):
    """Let an avatar note the strikes of the action that it has chosen: what it saw, and how long it has to recover.

    A strike takes the cohort's ``interval`` of frames to recover from, an exhausted avatar ``WEARY`` times as long
    again; the tempo is the avatar's own. One that has recovered draws how many strikes its next burst has.
    """
    fight = avatars.fight
    number = avatars.number[own]
    thrown = model.actions[action + 1].strikes - model.actions[action].strikes
    if thrown > 0:
        note_seen(model, avatars, world.targets, now, own, action)
    interval = world.cohorts[avatars.playback[own].cohort].interval
    if avatars.conditions.shape[0] > 0:
        row = avatars.conditions[number]
        interval *= row.tempo * (1.0 + WEARY * (1.0 - row.stamina))
    if interval <= 0.0:
        return
    if fight[own].burst <= 0 and not is_resting(avatars, world, now.frame, own):
        least, most = BURSTS
        drawn = uniform(world.streams.burst, np.int64(number), np.int64(fight[own].decisions))
        fight[own].burst = least + int(drawn * (most - least + 1))
    fight[own].burst = max(fight[own].burst - thrown, 0)
    fight[own].rested = max(fight[own].rested, np.float64(now.frame)) + interval * thrown
