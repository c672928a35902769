"""Episodes: one avatar after another does its best to a target (``evaluation.run_episodes``)."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.jit import kernel
from crowdsim.policy.axes.axis import UNSEEN_STRIKE, Target
from crowdsim.policy.kernels.axes import Corners
from crowdsim.policy.kernels.rewards import X, Z, action_reward, find_landed
from crowdsim.policy.kernels.values import after_action, evaluate_actions, moved
from crowdsim.policy.terms.registry import STRIKE
from crowdsim.policy.terms.strike import read_surface
from crowdsim.training.kernels.draws import draw_number
from crowdsim.training.kernels.search import NODE, best_by_search

# How actions are chosen.
BY_TABLE, AT_RANDOM, BY_SEARCH = range(3)

EPISODE = np.dtype(
    [
        *((name, np.float64) for name in ("gained", "earned", "nearest", "arrived", "first_landed")),
        *((name, np.int64) for name in ("landed", "transitions", "frames", "decisions")),
    ]
)
"""What came of an episode: discounted return, and without the price of transitions; least distance over the ground
within the horizon [m]; frames in which the target was first ``within``, and in which a strike first landed, or -1;
strikes landed, transitions, frames and decisions."""

DRAWS = 100003  # more than twice the decisions of an episode


class Rules(NamedTuple):
    """How episodes are played.

    Attributes:
        tables: ``LookupTables`` of the behaviours that choose.
        weights: Their weights. Shape (B,).
        judge: ``LookupTables`` over the same actions; its first behaviour says what is rewarded, and is the one whose
            values continue the leaves of a search.
        choice: ``BY_TABLE``, ``AT_RANDOM`` or ``BY_SEARCH``.
        width: Of the beam.
        depth: Of the beam.
        velocity: Speed of the target [m a frame], in a direction drawn for every action; 0 is still.
        horizon: Control frames that count.
        within: Distance over the ground at which an avatar has arrived [m].
        seed: Of the draws.
    """

    tables: Any
    weights: Any
    judge: Any
    choice: int
    width: int
    depth: int
    velocity: float
    horizon: int
    within: float
    seed: int


class Room(NamedTuple):
    """Scratch space of decisions.

    Attributes:
        corners: ``Corners``.
        values: Values of a state's actions.
        nodes: Nodes of a search.
    """

    corners: Any
    values: Any
    nodes: Any


@kernel(allocates=True)
def run_episodes(rules, states, targets, numbers, out, used):
    """Play episodes; write what came of them.

    Args:
        rules: ``Rules``.
        states: State in which each starts. Shape (N,).
        targets: Target in the avatar's ground frame at the start [m]. Shape (N, 3).
        numbers: Number of each episode, on which its draws depend. Shape (N,).
        out: Written: what came of each, zeros before. Shape (N,), ``EPISODE``.
        used: Written: 1 for every action that was done. Shape (A,).
    """
    offsets = rules.judge.actions.offsets
    most = 0
    for s in range(len(offsets) - 1):
        most = max(most, offsets[s + 1] - offsets[s])
    nodes = np.empty((2, max(1, rules.width) * most if rules.choice == BY_SEARCH else 1), NODE)
    room = Room(Corners(np.empty(64, np.int64), np.empty(64)), np.empty(most), nodes)
    for i in range(len(states)):
        _run_episode(rules, np.int64(states[i]), targets[i], numbers[i], room, out[i], used)


@kernel(allocates=True)
def _run_episode(rules, state, start, number, room, out, used):
    """Play one episode."""
    actions = rules.judge.actions
    x, y, z, heading = start[0], start[1], start[2], 0.0
    out.nearest, out.first_landed, out.arrived = math.sqrt(x * x + z * z), -1.0, -1.0
    frame = 0
    while frame < rules.horizon:
        decision = DRAWS * number + 2 * out.decisions
        a = _choose(rules, state, Target(x, y, z, 0.0, 0.0, heading, UNSEEN_STRIKE, math.inf), decision, room)
        used[a] = 1
        angle = 2.0 * math.pi * draw_number(rules.seed, decision + 1, 0)
        vx, vz = rules.velocity * math.sin(angle), rules.velocity * math.cos(angle)
        target = Target(x, y, z, vx, vz, heading, UNSEEN_STRIKE, math.inf)
        _note_rewards(rules, a, target, frame, out)
        _note_distances(rules, a, target, frame, out)
        _note_strikes(rules, a, target, frame, out)
        length = actions.lengths[a]
        seen = after_action(actions, a, moved(target, length))
        x, z, heading = seen.x, seen.z, seen.heading
        state = np.int64(actions.next[a])
        frame += length
        out.transitions += 1 if rules.tables.actions.costs[a] > 0.0 else 0
        out.decisions += 1
    out.frames = frame


@kernel(allocates=True)
def _choose(rules, state, target, decision, room):
    """Return the action that is done next."""
    offsets = rules.judge.actions.offsets
    first = np.int64(offsets[state])
    n = offsets[state + 1] - first
    if rules.choice == BY_TABLE:
        evaluate_actions(rules.tables, rules.weights, state, target, room.corners, room.values)
        best = 0
        for k in range(1, n):
            best = k if room.values[k] > room.values[best] else best
        return first + best
    if rules.choice == AT_RANDOM:
        return first + min(int(draw_number(rules.seed, decision, 0) * n), n - 1)
    return best_by_search(rules.judge, 0, state, target, rules.width, rules.depth, room.nodes)


@kernel
def _note_rewards(rules, action, target, frame, out):
    """Add the discounted reward of an action, with the price of transitions and without it."""
    behaviour, cost = rules.judge.behaviours[0], rules.judge.actions.costs[action]
    earned = action_reward(rules.judge, 0, action, target)
    price = behaviour.price * cost + behaviour.each if cost > 0.0 else 0.0
    faded = math.exp(frame * math.log(behaviour.discount))
    out.gained += faded * earned
    out.earned += faded * (earned + price)


@kernel
def _note_distances(rules, action, target, frame, out):
    """Note how near the avatar comes to the target, and when it has arrived."""
    actions = rules.judge.actions
    for t in range(1, actions.lengths[action] + 1):
        if frame + t <= rules.horizon:
            row = actions.path_offsets[action] + t - 1
            dx = target.x + t * target.vx - actions.paths[row, X]
            dz = target.z + t * target.vz - actions.paths[row, Z]
            distance = math.sqrt(dx * dx + dz * dz)
            out.nearest = min(out.nearest, distance)
            if distance <= rules.within and out.arrived < 0.0:
                out.arrived = frame + t


@kernel
def _note_strikes(rules, action, target, frame, out):
    """Count the strikes that land, and note when the first one does."""
    actions, terms, behaviour = rules.judge.actions, rules.judge.terms, rules.judge.behaviours[0]
    for strike in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
        t = actions.strike_times[strike]
        for row in range(behaviour.first_term, behaviour.end_term):
            if terms[row].kind != STRIKE or frame + t > rules.horizon:
                continue
            if find_landed(actions, strike, target, read_surface(terms[row]))[0]:
                out.landed += 1
                if out.first_landed < 0.0:
                    out.first_landed = frame + t
                break
