"""What the state of a simulation must be, so that one that was read from a file leads no kernel out of bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, Model, World
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.shown_motion import NONE
from crowdsim.crowd.opponents import Index
from crowdsim.crowd.outcome import Outcome
from crowdsim.crowd.progress import Agenda

FAR = 1e9
"""Greatest numbers of an avatar [m, rad, control frames]."""
_SEARCHES = {"direct", "kd_tree", "scipy"}
_CONSTANT = {
    "avatars.whole": (layout.NUMBER, layout.POLICY, layout.COHORT),
    "avatars.real": (layout.SCALE, layout.SPEED, layout.WIDTH),
}
_MAY_CHANGE = {"cohorts": (layout.TEMPERATURE, layout.HYSTERESIS), "rules": (layout.ATTACKERS,)}
_ENDLESS = (layout.RISES, layout.HURT_FRAME)
"""Columns of conditions that are infinite for what never was or will be."""
_TEMPERAMENT = (layout.TEMPO, layout.AGGRESSION, layout.RANGE, layout.STANCE)
"""Columns of conditions that never change."""
_NAMES = {
    layout.SKIP: "skip", layout.FIXED: "fixed", layout.OPPONENT: "opponent", layout.OPPONENT_BEFORE: "opponent before",
    layout.DECISIONS: "decisions", layout.ACTION: "action", layout.ACTION_BEFORE: "action before",
    layout.PENDING: "pending", layout.BURST: "burst", layout.NEXT_OPPONENT: "next opponent", layout.HIT_BY: "hit by",
    layout.THROWN: "thrown", layout.THROWN_UNTIL: "thrown until",
}  # fmt: skip


class Changing(Protocol):
    """The parts of a simulation that change, see ``simulation.Simulation``."""

    crowd: Crowd
    model: Model
    avatars: Avatars
    present: int
    frame: int
    _changed_at: int
    searches: list[str]
    outcome: Outcome | None
    _fresh: Array
    _world: World
    _agenda: Agenda
    _index: Index


def check_values(simulation: Changing, now: Mapping[str, Array], state: Mapping[str, Array]) -> None:
    """Hold the values of a state, whose arrays have the right shapes, against what a simulation can have.

    Args:
        simulation: The simulation that it is for.
        now: State of that simulation at its beginning.
        state: The state.

    Raises:
        ValueError: A value is out of range, or what never changes is another.
    """
    for name, rows in _CONSTANT.items():
        if not np.array_equal(now[name][list(rows)], state[name][list(rows)]):
            raise ValueError(f"array {name!r} holds other avatars than those of the run")
    for name in ("world.arena", "world.crowding", "world.stream"):
        if not np.array_equal(now[name], state[name]):
            raise ValueError(f"array {name!r} is not that of the run")
    _check_whole(simulation, state)
    _check_real(simulation, state)
    _check_conditions(simulation, now, state)
    _check_world(now, state)
    _check_rest(simulation, state)


def _check_whole(simulation: Changing, state: Mapping[str, Array]) -> None:
    whole, model, count = state["avatars.whole"], simulation.model, simulation.crowd.count
    least, most = -1 - len(simulation.crowd.targets), 2**31 - 1
    policy = whole[layout.POLICY]
    first, last = model.policies[policy, layout.ACTIONS], model.policies[policy + 1, layout.ACTIONS] - 1
    others = dict.fromkeys(
        (layout.FIXED, layout.OPPONENT, layout.OPPONENT_BEFORE, layout.NEXT_OPPONENT), (least, count - 1)
    )
    limits: dict[int, tuple[int | Array, int | Array]] = {
        **others,
        layout.SKIP: (-2, int(simulation.crowd.cast.teams.max(initial=0))),
        layout.DECISIONS: (0, most),
        layout.ACTION: (first, last),
        layout.PENDING: (-1, layout.NO_STRIKE),
        layout.BURST: (0, most),
        layout.HIT_BY: (-1, count - 1),
        layout.THROWN: (-1, len(model.twins) - 1),
        layout.THROWN_UNTIL: (-1, most),
    }
    for row, (low, high) in limits.items():
        _refuse(f"avatars.whole, {_NAMES[row]}", whole[row], (whole[row] >= low) & (whole[row] <= high))
    before = whole[layout.ACTION_BEFORE]
    inside = ((before >= first) & (before <= last)) | ((before >= layout.ENTERED) & (before < 0))
    _refuse(f"avatars.whole, {_NAMES[layout.ACTION_BEFORE]}", before, inside)


def _check_real(simulation: Changing, state: Mapping[str, Array]) -> None:
    whole, real, model = state["avatars.whole"], state["avatars.real"], simulation.model
    never = np.zeros(real.shape, bool)
    never[layout.HIT_FRAME] = np.isneginf(real[layout.HIT_FRAME])
    _refuse("avatars.real", real, (np.abs(real) <= FAR) | never)
    before = np.where(whole[layout.ACTION_BEFORE] >= 0, whole[layout.ACTION_BEFORE], whole[layout.ACTION])
    for row, action in ((layout.PHASE, whole[layout.ACTION]), (layout.PHASE_BEFORE, before)):
        most = model.actions[action, layout.LENGTH] + real[layout.SPEED] + 1e-6
        _refuse("avatars.real, phase", real[row], (real[row] >= 0.0) & (real[row] <= most))
    shown = state["avatars.shown"]
    _refuse("avatars.shown", shown, (shown < len(model.twins)) | (shown == NONE))
    seen = state["avatars.seen"]
    _refuse("avatars.seen", seen, np.abs(seen) <= FAR)
    frames = seen.reshape(-1, 2, 4)[..., layout.SEEN_FRAME]
    _refuse("avatars.seen, frame", frames, ((frames >= 0.0) & (frames <= len(model.bodies) - 1)) | (frames == -1.0))


def _check_conditions(simulation: Changing, now: Mapping[str, Array], state: Mapping[str, Array]) -> None:
    """Hold what avatars are told to do, how well they are, and what they are like against what can be."""
    rows, whole = state["avatars.conditions"], state["avatars.whole"]
    team = whole[layout.TEAM]
    own = simulation.crowd.cast.teams[: len(team)].astype(np.int32)
    is_down = np.zeros(len(team), bool)
    if not np.array_equal(now["avatars.conditions"][:, _TEMPERAMENT], rows[:, _TEMPERAMENT]):
        raise ValueError("array 'avatars.conditions' holds other temperaments or stances than those of the run")
    if len(rows):
        falls = simulation.model.falls
        standing = rows[:, (layout.STANDING, layout.STANDING_NEXT)]
        _refuse("avatars.conditions, standing", standing, np.isin(standing, np.arange(layout.OUT + 1)))
        for column in (layout.MODE, layout.DOES, layout.DOES_NEXT):
            _refuse("avatars.conditions, mode", rows[:, column], np.isin(rows[:, column], (0.0, 1.0, 2.0, 3.0)))
        is_down = (standing[:, 0] >= layout.DROPS) & ~(standing[:, 0] == layout.UP)
        fall = rows[:, layout.FALL]
        lies = np.isin(standing, (layout.FALLING, layout.LYING, layout.RISING)).any(axis=1)
        known = (fall == np.floor(fall)) & (fall >= 0) & (fall < max(len(falls), 1))
        _refuse("avatars.conditions, fall", fall, known & (~lies | (len(falls) > 0)))
        piece = rows[:, layout.PIECE]
        inside = (piece >= 0) & (piece <= len(simulation.model.rests)) & (piece == np.floor(piece))
        _refuse("avatars.conditions, piece", piece, inside)
        numbers = rows[:, [column for column in range(rows.shape[1]) if column not in (*_ENDLESS, *_TEMPERAMENT)]]
        _refuse("avatars.conditions", numbers, (numbers >= 0.0) & (numbers <= FAR))
        _refuse("avatars.conditions", rows, ~np.isnan(rows))
    _refuse("avatars.whole, team", team, np.where(is_down, team == -2 - own, team == own))


def _check_world(now: Mapping[str, Array], state: Mapping[str, Array]) -> None:
    for name, changing in _MAY_CHANGE.items():
        found, before = state[f"world.{name}"], now[f"world.{name}"]
        same = [column for column in range(found.shape[1]) if column not in changing]
        if not np.array_equal(found[:, same], before[:, same]):
            raise ValueError(f"array 'world.{name}' is not that of the run")
    for name in ("world.cohorts", "world.rules", "world.weights", "world.pauses"):
        _refuse(name, state[name], (state[name] >= 0.0) & (state[name] <= FAR))
    _refuse("world.targets", state["world.targets"], np.abs(state["world.targets"]) <= FAR)


def _check_rest(simulation: Changing, state: Mapping[str, Array]) -> None:
    present, fresh, pending = state["present"], state["fresh"], state["agenda.pending"]
    for name in ("present", "changed"):
        _refuse(name, state[name].view(np.uint8), state[name].view(np.uint8) <= 1)
    for name, numbers, count in (
        ("fresh", fresh, simulation.crowd.count),
        ("agenda.pending", pending, len(simulation.crowd.changes)),
    ):
        if numbers.ndim != 1:
            raise ValueError(f"array {name!r} has the shape {numbers.shape}, expected one axis")
        _refuse(name, numbers, (numbers >= 0) & (numbers < count))
        _refuse(name, numbers[1:], np.diff(numbers) > 0)
    _refuse("fresh", fresh, present[fresh])
    for name in ("agenda.landed", "agenda.landed_on"):
        _refuse(name, state[name], state[name] >= 0)
    _refuse(
        "outcome.frame",
        state["outcome.frame"],
        (state["outcome.frame"] >= -1) & (state["outcome.frame"] <= state["frame"]),
    )
    standing = state["outcome.standing"]
    _refuse("outcome.standing", standing, (standing >= 0) & (standing < simulation.crowd.count))
    _refuse("frame", state["frame"], (state["frame"] >= 0) & (state["frame"] < 2**40))
    searches = state["searches"]
    if searches.ndim != 1 or not set(map(str, searches)) <= _SEARCHES:
        raise ValueError(f"array 'searches' is none of {', '.join(sorted(_SEARCHES))}")


def _refuse(name: str, values: Array, holds: Array) -> None:
    if not np.all(holds):
        at = int(np.argmin(np.asarray(holds).reshape(-1)))
        raise ValueError(f"array {name!r} holds {np.asarray(values).reshape(-1)[at]}, which is out of range")
