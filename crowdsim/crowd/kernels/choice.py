"""The choice of the next action: a draw among those whose values are near the best one."""

import math

import numpy as np

from crowdsim.core.angles import cos_sin
from crowdsim.core.candidates import CandidateRules, draw_candidate
from crowdsim.core.random import uniform
from crowdsim.crowd.kernels.aim import aim
from crowdsim.crowd.kernels.collision_avoidance import avoid
from crowdsim.crowd.kernels.defence import defend
from crowdsim.crowd.kernels.forced_actions import special_action
from crowdsim.crowd.kernels.intents import is_resting
from crowdsim.crowd.kernels.layout import (
    ACTION,
    AGGRESSION,
    AHEAD,
    AT_AIR,
    BURST,
    BURST_STREAM,
    CHOICE_STREAM,
    COHORT,
    COST,
    DECISIONS,
    DOES,
    DOES_NEXT,
    END_X,
    END_Z,
    FIGHTS,
    FLEES,
    HEADING,
    INTERVAL,
    MARGIN,
    MOST,
    NEXT,
    NEXT_OPPONENT,
    NUMBER,
    PHASE,
    PIECE,
    RESTED,
    STAMINA,
    STANCE,
    STRIKES,
    TARGET_X,
    TARGET_Z,
    TEMPERATURE,
    TEMPO,
    THROWN,
    THROWN_UNTIL,
    UNSEEN,
    X,
    Z,
)
from crowdsim.crowd.kernels.legs import CROSSED, crosses_legs
from crowdsim.crowd.kernels.outcomes import note_seen, strikes_air
from crowdsim.crowd.kernels.prefetch import ask_for, ask_for_rows
from crowdsim.crowd.kernels.resting import favour_rest, resting_action
from crowdsim.crowd.kernels.values import value_actions
from crowdsim.crowd.kernels.variety import TWICE, charge_repetition, throws_too
from crowdsim.jit import kernel

BURSTS = (2, 5)  # least and most strikes of a burst
REST = 4.0  # what a strike costs an avatar that rests, in normalised values
CALM = 0.6  # what an action is worth in which the body is still to an avatar that rests, in normalised values
FACING, BESIDE = 0.6, 1.2  # where its opponent is then: cosine of its bearing, distance [m]
BOLDNESS = 0.2  # how much more a strike is worth to an avatar for each doubling of its aggression
ASTRAY = 1.0  # what it costs an avatar to be an action further from its stance, in normalised values
WEARY = 3.0  # how much longer it takes an exhausted avatar to recover from a strike, over one that is not tired
AWAY, NEAR = -0.3, 2.0  # where an avatar does not see another: cosine of the bearing; and how near that one is [m]
REDRAWN = 4  # how often an avatar thinks again that has drawn a strike which its opponent throws, or legs that cross
SORTED = 256  # from this many deciding avatars on, actions are evaluated in the order of states


@kernel(inline=True)
def choose(model, avatars, world, now, due, count, observed, scratch, out_chosen):
    """Choose an opponent and the next action for avatars ``due[:count]``, at most as many as ``scratch`` has room for.

    Observations run along with ``due``, as the chosen actions do. Situations are written in the order of storage, in
    which neighbours lie together; where there are many, actions are evaluated in the order of states. Returns -1, or
    the slot of an avatar whose values are not numbers.
    """
    aim(model, avatars, world, now, due, count, observed, scratch)
    if count >= SORTED:
        order_by_state(scratch.states, count, scratch.starts, scratch.order)
    else:
        for q in range(count):
            scratch.order[q] = q
    value_actions(model, world.weights, scratch, 0, count)
    _keep_running(model, avatars, due, count, scratch)
    avoid(model, avatars, world, now.frame, due, count, observed, scratch)
    charge_repetition(model, avatars, world, now, due, count, scratch)
    defend(model, avatars, world, now, due, count, observed, scratch)
    return _draw_actions(model, avatars, world, now, due, count, observed, scratch, out_chosen)


@kernel(allocates=False)
def order_by_state(states, count, starts, out_order):
    """List the places of ``states[:count]`` by state; ``starts`` (S + 2,) is scratch.

    Avatars that choose among the same actions come one after another, so that these are read from memory once.
    """
    for state in range(starts.shape[0]):
        starts[state] = 0
    for q in range(count):
        starts[states[q] + 2] += 1
    for state in range(1, starts.shape[0]):
        starts[state] += starts[state - 1]
    for q in range(count):
        place = states[q] + 1
        out_order[starts[place]] = q
        starts[place] += 1


@kernel(inline=True)
def _keep_running(model, avatars, due, count, scratch):
    """Where there is no opponent, let captured motion continue: the cheapest transition is worth most."""
    for q in range(count):
        if scratch.states[q] < 0:
            state = model.actions[avatars.whole[ACTION, due[q]], NEXT]
            for k in range(model.offsets[state + 1] - model.offsets[state]):
                scratch.values[q, k] = -model.moves[model.offsets[state] + k, COST]


@kernel(inline=True)
def _without_choice(model, avatars, world, now, own, observed, q, values):
    """Return the action of an avatar that falls, is down or rests; -1 where it may choose.

    Where it is to rest, but may choose, that is added to the values of its actions.
    """
    special = special_action(model, avatars, world, now.frame, own, observed, q)
    if special >= 0:
        avatars.conditions[avatars.whole[NUMBER, own], PIECE] = 0.0
    elif model.ways_to_rest.shape[0] > 0:
        special = resting_action(model, avatars, world, now, own)
        if special < 0:
            favour_rest(model, avatars, own, values)
    return special


@kernel(inline=True)
def _draw_actions(model, avatars, world, now, due, count, observed, scratch, out_chosen):
    """Draw the next action of avatars ``due[:count]`` by its value; return -1, or a slot without numbers.

    Strikes come in bursts. A strike takes ``INTERVAL`` frames to recover from; after a burst an avatar rests until it
    has recovered from all of them, and strikes cost it dear meanwhile, as they do while it watches or flees; and
    something where its opponent looks away. Stillness is worth something while it rests. An exhausted avatar takes
    ``WEARY`` times as long again; tempo and aggression are the avatar's own. An avatar with a stance prefers actions
    that end in it, or nearer to it.
    """
    whole, real, offsets, actions, cohorts = avatars.whole, avatars.real, model.offsets, model.actions, world.cohorts
    frame = now.frame
    values, stream = scratch.values, world.stream
    for q in range(count):
        _ask_for_drawing(avatars, due, count, q)
        own = due[q]
        rests, slowness, bonus, stance = False, 1.0, 0.0, 0
        if avatars.conditions.shape[0] > 0:
            special = _without_choice(model, avatars, world, now, own, observed, q, values[q])
            if special >= 0:
                out_chosen[q] = special
                continue
            row = avatars.conditions[whole[NUMBER, own]]
            rests, bonus = row[DOES_NEXT] != FIGHTS, BOLDNESS * row[AGGRESSION]
            slowness = row[TEMPO] * (1.0 + WEARY * (1.0 - row[STAMINA]))
            stance = int(row[STANCE])
        state, cohort = actions[whole[ACTION, own], NEXT], whole[COHORT, own]
        interval = cohorts[cohort, INTERVAL] * slowness
        fights, recovers = not rests, is_resting(avatars, world, frame, own)
        if recovers:
            rests = True
        elif interval > 0.0 and whole[BURST, own] <= 0:
            least, most = BURSTS
            drawn = uniform(stream[BURST_STREAM], np.int64(whole[NUMBER, own]), np.int64(whole[DECISIONS, own]))
            whole[BURST, own] = least + int(drawn * (most - least + 1))
        worth = -REST if rests else bonus - world.crowding[UNSEEN] * _is_unseen(avatars, now, own)
        if worth != 0.0:
            for k in range(offsets[state + 1] - offsets[state]):
                action = offsets[state] + k
                values[q, k] += worth * (actions[action + 1, STRIKES] - actions[action, STRIKES])
        if fights and recovers and whole[NEXT_OPPONENT, own] >= 0:
            _favour_stillness(model, scratch, q, offsets[state], offsets[state + 1])
        if stance > 0:
            for k in range(offsets[state + 1] - offsets[state]):
                values[q, k] -= ASTRAY * model.stances[actions[offsets[state] + k, NEXT], stance - 1]
        picked = _draw_one(model, avatars, world, now, own, observed, q, scratch)
        if picked < 0:
            return own
        action = offsets[state] + picked
        out_chosen[q] = action
        thrown = actions[action + 1, STRIKES] - actions[action, STRIKES]
        if thrown > 0:
            note_seen(model, avatars, world, now, own)
        if interval > 0.0:
            whole[BURST, own] = max(whole[BURST, own] - thrown, 0)
            real[RESTED, own] = max(real[RESTED, own], np.float64(frame)) + interval * thrown
    return -1


@kernel(inline=True)
def _ask_for_drawing(avatars, due, count, q):
    """Ask memory for what avatars soon after the ``q``-th one will read of themselves and of their opponents."""
    whole, real = avatars.whole, avatars.real
    if q + 3 * AHEAD < count:
        own = due[q + 3 * AHEAD]
        ask_for_rows(whole, (NUMBER, COHORT, DECISIONS, BURST, NEXT_OPPONENT), own)
        ask_for_rows(real, (RESTED,), own)
    if q + 2 * AHEAD < count:
        ask_for(avatars.slot_of, max(whole[NEXT_OPPONENT, due[q + 2 * AHEAD]], 0))
    if q + AHEAD < count:
        j = avatars.slot_of[max(whole[NEXT_OPPONENT, due[q + AHEAD]], 0)]
        ask_for_rows(whole, (ACTION, THROWN, THROWN_UNTIL), j)
        ask_for_rows(real, (X, Z, HEADING, PHASE, END_X, END_Z), j)


@kernel(inline=True)
def _favour_stillness(model, scratch, q, first, last):
    """Raise the values of actions in which the body is still, if the opponent is near and ahead."""
    x, z = scratch.situations[q, TARGET_X], scratch.situations[q, TARGET_Z]
    far = math.sqrt(x * x + z * z)
    if z >= FACING * far and far <= BESIDE:
        for k in range(last - first):
            scratch.values[q, k] += CALM * model.calm[first + k]


@kernel(inline=True)
def _draw_one(model, avatars, world, now, own, observed, q, scratch):
    """Draw among the actions of an avatar by their values; return which of them it is, or -1 where none is a number.

    It draws again where its opponent throws the same strike, legs would cross, or a strike would be thrown at air.
    """
    whole, cohorts, values = avatars.whole, world.cohorts, scratch.values[q]
    cohort, state = whole[COHORT, own], model.actions[whole[ACTION, own], NEXT]
    offset, count = model.offsets[state], model.offsets[state + 1] - model.offsets[state]
    number = uniform(world.stream[CHOICE_STREAM], np.int64(whole[NUMBER, own]), np.int64(whole[DECISIONS, own]))
    rules = CandidateRules(cohorts[cohort, MARGIN], cohorts[cohort, MOST], cohorts[cohort, TEMPERATURE])
    picked = draw_candidate(values, count, rules, number, scratch.rows)
    for _ in range(REDRAWN):
        if picked < 0:
            break
        if throws_too(model, avatars, world, now.frame, own, offset + picked):
            values[picked] -= TWICE
        elif crosses_legs(model, avatars, world.crowding, own, offset + picked, observed, q):
            values[picked] -= CROSSED
        elif world.crowding[AT_AIR] > 0.0 and strikes_air(model, avatars, now, own, offset + picked):
            values[picked] -= world.crowding[AT_AIR]
        else:
            break
        picked = draw_candidate(values, count, rules, number, scratch.rows)
    return picked


@kernel(inline=True)
def _is_unseen(avatars, now, own):
    """Return whether an avatar is close behind its opponent, unless that one flees."""
    whole, real = avatars.whole, avatars.real
    opponent = whole[NEXT_OPPONENT, own]
    if opponent < 0:
        return False
    j = avatars.slot_of[opponent]
    if j >= now.present or (avatars.conditions.shape[0] > 0 and avatars.conditions[opponent, DOES] == FLEES):
        return False
    dx, dz = real[X, own] - real[X, j], real[Z, own] - real[Z, j]
    far = math.sqrt(dx * dx + dz * dz)
    cos, sin = cos_sin(real[HEADING, j])
    return far < NEAR and dx * sin + dz * cos < AWAY * far
