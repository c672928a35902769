"""Pruning as its module says it, without a compiled line."""

import numpy as np
from naive_policy import action_values

from crowdsim.policy.policy import Policy
from crowdsim.training.behaviours import train_behaviour
from crowdsim.training.pruning import _coarse
from crowdsim.training.ranges import sample_targets


def value(policy, weighting, state, target):
    return action_values(policy, weighting, state, target[:3], (target[3], 0.0, target[4]))


def transitions_worth_keeping(database, graph, actions, specs, body, most, every=7):
    """Return what ``pruning.judge_transitions`` returns, for every seventh captured state; all else is 0."""
    solved = graph.captured_states(database.captured_frames)
    behaviours = tuple(
        train_behaviour(name, _coarse(spec), database, actions, body, solved=solved)[0] for name, spec in specs.items()
    )
    policy = Policy("naive", database, graph, actions, behaviours, body, np.zeros(0), {}, {}, "", {})
    names = [behaviour.name for behaviour in behaviours]
    weightings = [{name: 1.0} for name in names] + [dict.fromkeys(names, 1.0)]
    targets = sample_targets(database)
    keep, gains = np.zeros(actions.action_count, bool), np.zeros(actions.action_count)
    for state in range(0, solved, every):
        first, end = graph.action_offsets[state : state + 2]
        worth = np.array([value(policy, weighting, state, target) for weighting in weightings for target in targets])
        captured = [k for k in range(end - first) if not graph.action_has_transition[first + k]]
        held = list(captured)
        while len(held) < len(captured) + most:
            best = worth[:, held].max(axis=1) if held else np.full(len(worth), -np.inf)
            left = [k for k in range(end - first) if k not in held]
            adds = [float(np.maximum(worth[:, k] - best, 0.0).mean()) for k in left]
            if not left or max(adds) <= 0.0:
                break
            best_way = left[int(np.argmax(adds))]
            gains[first + best_way] = min(max(adds), 1.0)
            held.append(best_way)
        keep[first + np.array(held)] = True
    return keep, gains
