"""Avatars that follow a target which flees straight away from them (``pursuit.distances_behind``)."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.core.candidates import draw_candidate
from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import UNSEEN_STRIKE, Target
from crowdsim.policy.kernels.axes import Corners
from crowdsim.policy.kernels.rewards import X, Z
from crowdsim.policy.kernels.values import after_action, evaluate_actions, moved
from crowdsim.training.kernels.draws import draw_number


class Chase(NamedTuple):
    """What avatars are watched at.

    Attributes:
        height: Height of the target [m].
        lead: How far away it is at the start [m].
        velocity: Its speed [m a frame].
        begun: Control frame after which distances count.
        done: Control frame after which all is over.
        candidates: ``CandidateRules`` of the draw.
    """

    height: float
    lead: float
    velocity: float
    begun: int
    done: int
    candidates: Any


@kernel(allocates=True)
def pursue(tables, weights, chase, states, bearings, out):
    """Let one avatar after another follow a target that flees straight away from it; write how far behind it is.

    Args:
        tables: ``LookupTables``.
        weights: Weight of each behaviour. Shape (B,).
        chase: ``Chase``.
        states: State in which each starts. Shape (N,).
        bearings: Where the target is at the start, and where it flees to [rad]. Shape (N,).
        out: Written: distance over the ground in the mean [m]. Shape (N,).
    """
    actions = tables.actions
    widest = 0
    for s in range(len(actions.offsets) - 1):
        widest = max(widest, actions.offsets[s + 1] - actions.offsets[s])
    corners = Corners(np.empty(64, np.int64), np.empty(64))
    values, chances = np.empty(widest), np.empty(widest)
    for i in range(len(states)):
        state, frame, decision = np.int64(states[i]), 0, 0
        sin, cos = math.sin(bearings[i]), math.cos(bearings[i])
        seen = Target(
            chase.lead * sin, chase.height, chase.lead * cos, chase.velocity * sin, chase.velocity * cos, bearings[i],
            UNSEEN_STRIKE, math.inf,
        )  # fmt: skip
        out[i] = 0.0
        while frame < chase.done:
            n = evaluate_actions(tables, weights, state, seen, corners, values)
            k = draw_candidate(values, n, chase.candidates, draw_number(i, decision, 0), chances)
            a = np.int64(actions.offsets[state] + k)
            out[i] = _add_distances(actions, a, seen, frame, chase, out[i])
            seen = after_action(actions, a, moved(seen, actions.lengths[a]))
            state, frame, decision = np.int64(actions.next[a]), frame + actions.lengths[a], decision + 1


@kernel
def _add_distances(actions, action, seen, frame, chase, total):
    """Return a mean distance with the share of the frames of an action added."""
    for t in range(1, actions.lengths[action] + 1):
        if chase.begun < frame + t <= chase.done:
            row = actions.path_offsets[action] + t - 1
            dx, dz = seen.x + t * seen.vx - actions.paths[row, X], seen.z + t * seen.vz - actions.paths[row, Z]
            total += math.sqrt(dx * dx + dz * dz) / (chase.done - chase.begun)
    return total
