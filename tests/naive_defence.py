"""Defence, slow and plain: what an avatar of ``naive_crowd`` sees coming, and what its actions cost in hits."""

import math

import naive_ground as ground
import numpy as np
from naive_strikes import gap_to, trunk

from crowdsim.core.threats import DISTANCES
from crowdsim.crowd.kernels.terms.defence import HIT, MARGIN, NEAR
from crowdsim.crowd.model import TOLERANCE


def costs(one, opponent, avatars, near, crowd):
    """What each action of an avatar's state costs."""
    policy, weight = one.policy, crowd.defences[one.cohort]
    state = int(policy.actions.next[one.action])
    choices = range(policy.actions.offsets[state], policy.actions.offsets[state + 1])
    strike, far = sees(one, opponent, avatars, near, crowd.reactions[one.cohort])
    if strike is None:
        cell = sum(far >= limit for limit in DISTANCES)
        table = np.zeros((len(policy.actions.next), cell + 1)) if policy.defence is None else policy.defence
        return np.array([HIT * weight * float(table[action, cell]) for action in choices])
    return np.array([HIT * weight * endured(one, action, *strike) for action in choices])


def sees(one, opponent, avatars, near, reaction):
    """Frames until the next strike that is seen and where it ends, or None; and how far the nearest attacker is."""
    mine, found, far = one.stands(), [], math.inf
    for j in [opponent] * (opponent >= 0) + [j for j in near if avatars[j].opponent == one.number]:
        other = avatars[j]
        hidden = math.ceil(other.phase / other.speed) - 1 < reaction
        place = other.start if hidden else other.stands()
        far = min(far, math.hypot(place[0] - mine[0], place[1] - mine[1]) / one.scale)
        actions = other.policy.actions
        for k in range(actions.strike_offsets[other.action], actions.strike_offsets[other.action + 1]):
            frames = (float(actions.strike_times[k]) - other.phase) / other.speed
            point = ground.to_world(other.start, actions.strike_positions[k] * other.scale)
            aside = math.hypot(point[0] - mine[0], point[2] - mine[1])
            if not hidden and frames > 0 and aside <= NEAR * one.scale:
                found.append((frames, tuple(point)))
    return (min(found) if found else None), far


def endured(one, action, frames, point):
    """How surely a strike would land in an action, or in the best one behind it."""
    actions, own, mine = one.policy.actions, frames * one.speed, one.stands()
    length = float(actions.lengths[action])
    if own <= length:
        return landing(one, action, own, mine, point)
    behind = ground.compose(mine, one.displacement(action, length))
    state = int(actions.next[action])
    after = range(actions.offsets[state], actions.offsets[state + 1])
    return min(landing(one, a, min(own - length, float(actions.lengths[a])), behind, point) for a in after)


def landing(one, action, phase, start, point):
    """How surely a strike lands on a body that has done some frames of an action."""
    gap, _ = gap_to(np.array(point), *trunk(one, action, phase, start))
    terms = [term for behaviour in one.policy.behaviours for term in behaviour.terms if hasattr(term, "tolerance")]
    tolerance = max([term.tolerance for term in terms] or [TOLERANCE]) * one.scale
    return min(max((tolerance + MARGIN - gap) / MARGIN, 0.0), 1.0)
