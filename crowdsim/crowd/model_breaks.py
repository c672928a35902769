"""What a model knows of strikes that can be broken off, and of those that cannot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.kernels.breaking_off import BEFORE
from crowdsim.motion import ground
from crowdsim.motion.kinematics import forward_kinematics

if TYPE_CHECKING:
    from crowdsim.motion.database import MotionDatabase
    from crowdsim.policy.actions import Actions
    from crowdsim.policy.policy import Policy

ALIKE = 0.09
"""How far joints are from those of a state at most, now and a control frame later, for a body 1 m tall [m].

Nine of ten transitions of the embedded boxer lead no further."""
BOUND = 0.75
"""Share of a state's actions that begin with a strike from which on one has to follow the state."""
SOON = BEFORE + 1.0
"""An action begins with a strike that it throws within this time, too soon to break it off [frames]."""


def break_rows(policies: Sequence[Policy], starts: dict[str, Array]) -> dict[str, Array]:
    """Return what ``Model`` holds of strikes that are broken off, by its names.

    An avatar goes on from the state whose pose is most like that in which it leaves its action, if any is ``ALIKE``; of
    states that no strike has to follow.

    Args:
        policies: The policies.
        starts: First state, action and strike of each in the run, and the numbers of all.
    """
    bound = np.full(int(starts["state"][-1]), -1, np.int32)
    breaks, leaves = [], []
    for p, policy in enumerate(policies):
        actions, follows = policy.actions, bound_strikes(policy.actions)
        state = int(starts["state"][p])
        bound[state : state + len(follows)] = np.where(follows < 0, -1, starts["strike"][p] + follows)
        owners = np.repeat(np.arange(actions.action_count), np.diff(actions.strike_offsets))
        ends = np.flatnonzero(follows[actions.next] >= 0)
        before = np.ceil(actions.strike_times).astype(np.int64) - 1 - round(BEFORE)
        after = np.full(actions.action_count, -1)
        after[ends] = actions.lengths[ends] + before[follows[actions.next[ends]]]
        after[after >= actions.lengths] = -1
        every = np.arange(actions.action_count)
        left = _ways_out(policy, follows < 0, np.concatenate([owners, every]), np.concatenate([before, after]))
        left = np.where(left < 0, -1, starts["action"][p] + left).astype(np.int32)
        breaks.append(left[: len(owners)])
        leaves.append(left[len(owners) :])
    return {"breaks": np.concatenate(breaks), "leaves": np.concatenate(leaves), "bound": bound}


def bound_strikes(actions: Actions) -> Array:
    """Return for each state of a policy the strike that has to follow it, or -1. Shape (S,).

    Of the strikes that its actions begin with it is the one that reaches furthest.
    """
    found = np.full(actions.state_count, -1)
    if not len(actions.strike_times):
        return found
    firsts = np.minimum(actions.strike_offsets[:-1], len(actions.strike_times) - 1)
    soon = (np.diff(actions.strike_offsets) > 0) & (actions.strike_times[firsts] <= SOON)
    reaches = np.hypot(actions.strike_positions[:, 0], actions.strike_positions[:, 2])
    for state in range(actions.state_count):
        own = np.arange(actions.offsets[state], actions.offsets[state + 1])
        if len(own) and soon[own].mean() >= BOUND:
            chosen = firsts[own[soon[own]]]
            found[state] = chosen[np.argmax(reaches[chosen])]
    return found


def _ways_out(policy: Policy, free: Array, left: Array, frames: Array) -> Array:
    """Return an action that ends in the state from which one goes on that leaves each action in a frame of it, or -1.

    Args:
        policy: The policy.
        free: Whether no strike has to follow each state. Shape (S,).
        left: The actions. Shape (n,).
        frames: In which of their control frames they are left; those below 1 cannot be. Shape (n,).
    """
    actions, database = policy.actions, policy.database
    found, into = np.full(len(left), -1), np.full(actions.state_count, -1)
    into[actions.next[: actions.choice_count][::-1]] = np.arange(actions.choice_count)[::-1]
    goals = np.flatnonzero((into >= 0) & free)
    may = np.flatnonzero((frames >= 1) & (left < actions.choice_count))
    if not len(may) or not len(goals):
        return found
    rows, which = np.unique(policy.graph.action_first[left[may]] - 1 + frames[may], return_inverse=True)
    poses, entered = _poses(database, rows), _poses(database, policy.graph.state_frames[goals])
    squares = np.square(poses).sum(1)[:, None] + np.square(entered).sum(1) - 2.0 * poses @ entered.T
    alike = squares.min(axis=1) <= (ALIKE * database.body.height) ** 2
    found[may] = np.where(alike, into[goals[squares.argmin(axis=1)]], -1)[which]
    return found


def _poses(database: MotionDatabase, frames: Array) -> Array:
    """Return joints at control frames and one later, such that distances of rows are root mean squares [m]."""
    joints = sorted(set(database.body.roles.values()))
    here = np.asarray(frames, np.int64) * database.stride
    rows = []
    for at in (here, np.minimum(here + database.stride, len(database.ground) - 1)):
        roots, rotations = database.root_positions[at], database.rotations[at]
        positions, _ = forward_kinematics(database.skeleton, roots, rotations, threads=1)
        rows.append(ground.to_local(database.ground[here, None], positions[:, joints].astype(float)))
    return np.concatenate(rows, axis=1).reshape(len(here), -1) / np.sqrt(2.0 * len(joints))
