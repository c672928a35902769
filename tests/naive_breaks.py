"""Strikes that are broken off, slow and plain: when avatars of ``naive_crowd`` leave their actions, and for which."""

import math
from functools import lru_cache

import numpy as np

from crowdsim.crowd import model_breaks
from crowdsim.crowd.kernels.breaking_off import BEFORE, OUT
from crowdsim.crowd.model_breaks import BOUND, SOON
from crowdsim.motion import ground
from crowdsim.motion.kinematics import forward_kinematics


def breaks_off(one, avatars):
    """Action in whose end an avatar is that breaks off its next strike in this frame; None where it does not."""
    time, fist = next_strike(one)
    left = math.ceil(time) - 1 - one.phase - BEFORE if fist is not None else math.inf
    if one.opponent < 0 or one.phase >= one.length or not -0.5 * one.speed < left <= 0.5 * one.speed:
        return None
    action = way_out(one, one.action, math.ceil(time) - 1 - round(BEFORE))
    end = avatars[one.opponent].end()
    point = ground.to_world(one.start, fist * one.scale)
    return action if math.hypot(point[0] - end[0], point[2] - end[1]) > OUT else None


def next_strike(one):
    """When the next strike of an action is, or of the state behind it, and where it ends, seen from its start."""
    actions = one.policy.actions
    for k in range(actions.strike_offsets[one.action], actions.strike_offsets[one.action + 1]):
        if actions.strike_times[k] > one.phase:
            return float(actions.strike_times[k]), actions.strike_positions[k].astype(float)
    strike = bound_strike(one, actions.next[one.action])
    if strike is None:
        return math.inf, None
    return one.length + float(actions.strike_times[strike]), strike_after(one, one.action)


def strike_after(one, action):
    """Where the strike ends that has to follow an action, seen from its start; None where none has to."""
    actions = one.policy.actions
    strike = bound_strike(one, actions.next[action])
    if strike is None:
        return None
    return ground.to_world(actions.displacements[action].astype(float), actions.strike_positions[strike].astype(float))


@lru_cache(maxsize=10000)
def bound_strike(one, state):
    """Of the strikes that most actions of a state begin with the one that reaches furthest."""
    actions = one.policy.actions
    own = range(actions.offsets[state], actions.offsets[state + 1])
    firsts = [actions.strike_offsets[a] for a in own if actions.strike_offsets[a] < actions.strike_offsets[a + 1]]
    soon = [k for k in firsts if actions.strike_times[k] <= SOON]
    if not soon or len(soon) < BOUND * len(own):
        return None
    return max(soon, key=lambda k: math.hypot(*actions.strike_positions[k, [0, 2]]))


@lru_cache(maxsize=10000)
def way_out(one, action, frame):
    """Action that ends in the state whose pose is most like that in a frame of another action, if any is alike."""
    actions, graph = one.policy.actions, one.policy.graph
    if not 1 <= frame < actions.lengths[action]:
        return None
    pose = joints(one, int(graph.action_first[action]) - 1 + frame)
    gaps = {
        s: math.sqrt(np.square(joints(one, int(graph.state_frames[s])) - pose).sum(-1).mean())
        for s in range(actions.state_count)
        if s in actions.next and bound_strike(one, s) is None
    }
    if not gaps or min(gaps.values()) > model_breaks.ALIKE * one.policy.database.body.height:
        return None
    return next(a for a in range(actions.action_count) if actions.next[a] == min(gaps, key=gaps.get))


@lru_cache(maxsize=10000)
def joints(one, frame):
    """Joints in a control frame and one later, seen from the first [m]. Shape (joints, 3)."""
    database = one.policy.database
    here = frame * database.stride
    later = min(here + database.stride, len(database.ground) - 1)
    positions, _ = forward_kinematics(
        database.skeleton, database.root_positions[[here, later]], database.rotations[[here, later]]
    )
    named = sorted(set(database.body.roles.values()))
    return ground.to_local(database.ground[here], positions[:, named].astype(float)).reshape(-1, 3)
