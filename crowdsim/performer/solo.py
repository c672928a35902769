"""Single moves of the embedded boxer, out of the guard and back, for tests and pictures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.free_footwork import quick_turn
from crowdsim.performer.moves import DEFENCES, PUNCHES
from crowdsim.performer.score import Score
from crowdsim.performer.travel import JOG, WALK, Stride, shuffle, travel

_Move = Callable[[Choreographer, float], float]


def _step(ahead: float, left: float) -> _Move:
    return lambda plan, start: plan.move(start, ahead, left)


def _shuffle(ahead: float, left: float) -> _Move:
    return lambda plan, start: shuffle(plan, start, ahead, left, 6)


def _travel(*strides: Stride) -> _Move:
    return lambda plan, start: travel(plan, start, strides)


def _turn(plan: Choreographer, start: float) -> float:
    for _ in range(4):
        start = plan.pivot(start, np.pi / 4)
    return start


_WALK, _JOG = (Stride(WALK),), (Stride(JOG),)
_OFF, _UP = (Stride(WALK, 0.85),), (Stride(JOG, 0.8),)

FOOTWORK: dict[str, _Move] = {
    "forward": _step(0.3, 0.0),
    "back": _step(-0.3, 0.0),
    "left": _step(0.0, 0.28),
    "right": _step(0.0, -0.28),
    "diagonal": _step(0.2, 0.2),
    "turn": _turn,
    "quick_turn": lambda plan, start: quick_turn(plan, start, np.pi),
    "shuffle_forward": _shuffle(0.42, 0.0),
    "shuffle_back": _shuffle(-0.42, 0.0),
    "shuffle_left": _shuffle(0.0, 0.40),
    "shuffle_right": _shuffle(0.0, -0.40),
    "shuffle_forward_left": _shuffle(0.30, 0.28),
    "shuffle_forward_right": _shuffle(0.30, -0.28),
    "shuffle_back_left": _shuffle(-0.30, 0.28),
    "shuffle_back_right": _shuffle(-0.30, -0.28),
    "walk": _travel(*_OFF, *_WALK * 6),
    "walk_curve": _travel(*_OFF, *(Stride(WALK, 0.95, 0.3),) * 6),
    "walk_about_turn": _travel(*_OFF, *_WALK * 2, Stride(WALK, 0.6), *(Stride(WALK, 0.4, 0.8),) * 4, *_WALK * 3),
    "turn_and_walk": _travel(*(Stride(WALK, 0.5, 0.8),) * 4, *_WALK * 3),
    "jog": _travel(*_UP, *_JOG * 8, Stride(WALK)),
    "jog_curve": _travel(*_UP, *(Stride(JOG, 0.95, 0.2),) * 8, Stride(WALK)),
    "walk_to_jog_to_walk": _travel(*_OFF, *_WALK * 2, *_JOG * 4, *_WALK * 3),
}
"""Footwork by name; each writes its steps from a time on [s] and returns when the last foot is down [s]."""


def write_solo(plan: Choreographer, move: str) -> Score:
    """Plan a short clip of one move alone: a punch, a defence, or a word of ``FOOTWORK``."""
    start = 0.5
    if move in plan.punches:
        recipe = plan.punches[move]
        height = 1.45 if plan.punches is PUNCHES else 0.5 * sum(recipe.head)
        end = plan.punch(move, start, False, 0.0, 0.5 * sum(recipe.distance), recipe.speed[0], height).end
    elif move in DEFENCES:
        end = plan.defend(move, start, depth=1.0)
    else:
        end = FOOTWORK[move](plan, start)
    return plan.finish(end + 0.5)
