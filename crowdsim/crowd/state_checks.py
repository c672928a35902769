"""What the state of a simulation must be, so that one that was read from a file leads no kernel out of bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from crowdsim.core.threats import DISTANCES
from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Avatars, Model, World
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.choose import BURSTS
from crowdsim.crowd.kernels.shown_motion import THROWN
from crowdsim.crowd.opponents import Index
from crowdsim.crowd.outcome import Outcome
from crowdsim.crowd.progress import Agenda

FAR = 1e9
"""Greatest numbers of an avatar [m, rad, control frames]."""
_SEARCHES = {"direct", "kd_tree", "scipy"}
_CONSTANT = {
    *(f"avatars.{name}" for name in ("number", "policy", "playback.cohort", "playback.scale", "motion.speed")),
    *("avatars.motion.width", "world.arena", "world.crowding", "world.streams", "world.cohorts", "world.rules"),
}
"""What never changes, arrays or all fields of one, but for those that may."""
_MAY_CHANGE = {
    "world.cohorts.temperature", "world.cohorts.hysteresis", "world.cohorts.defence", "world.cohorts.interval",
    "world.cohorts.reaction", "world.rules.attackers",
}  # fmt: skip
_ENDLESS = {"rises", "hurt_frame"}
"""Fields of conditions that are infinite for what never was or will be."""
_TEMPERAMENT = {"tempo", "aggression", "range", "stance"}
"""Fields of conditions that never change."""


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
    for name in sorted(now.keys() - _MAY_CHANGE):
        is_constant = name in _CONSTANT or name.rpartition(".")[0] in _CONSTANT
        if is_constant and not np.array_equal(now[name], state[name]):
            raise ValueError(f"array {name!r} is not that of the run")
    _check_integers(simulation, state)
    _check_numbers(simulation, state)
    _check_conditions(simulation, now, state)
    _check_world(state)
    _check_rest(simulation, state)


def _check_integers(simulation: Changing, state: Mapping[str, Array]) -> None:
    model, count = simulation.model, simulation.crowd.count
    least, most = -1 - len(simulation.crowd.targets), 2**31 - 1
    policy = state["avatars.policy"]
    first, last = model.policies["actions"][policy], model.policies["actions"][policy + 1] - 1
    limits: dict[str, tuple[int | Array, int | Array]] = {
        **dict.fromkeys(("fixed", "opponent", "fight.next_opponent"), (least, count - 1)),
        "skip": (-2, int(simulation.crowd.cast.teams.max(initial=0))),
        "fight.decisions": (0, most),
        "motion.action": (first, last),
        "playback.pending": (-1, layout.NO_STRIKE),
        "fight.burst": (0, BURSTS[1]),
        "fight.hit_by": (-1, count - 1),
        "fight.hit_frame": (layout.NEVER, most),
        "fight.threat": (-1, len(DISTANCES)),
        "fight.thrown": (-1, THROWN),
        "fight.thrown_until": (-1, most),
    }
    for name, (low, high) in limits.items():
        values = state[f"avatars.{name}"]
        _refuse(f"avatars.{name}", values, (values >= low) & (values <= high))
    before = state["avatars.playback.action_before"]
    inside = ((before >= first) & (before <= last)) | ((before >= layout.ENTERED) & (before < 0))
    _refuse("avatars.playback.action_before", before, inside)


_BOUNDED = tuple(
    f"avatars.{name}" for name in ("x", "z", "heading", "motion.", "playback.", "slides.", "free", "fight.")
)
"""What holds lengths, angles and times, which have bounds."""


def _check_numbers(simulation: Changing, state: Mapping[str, Array]) -> None:
    model = simulation.model
    for name, values in state.items():
        if name.startswith(_BOUNDED) and values.dtype.kind == "f":
            _refuse(name, values, np.abs(values) <= FAR)
    action, before = state["avatars.motion.action"], state["avatars.playback.action_before"]
    before = np.where(before >= 0, before, action)
    for name, shown in (("motion.phase", action), ("playback.phase_before", before)):
        values, speed = state[f"avatars.{name}"], state["avatars.motion.speed"]
        most = model.actions["length"][shown] + speed + 1e-4
        _refuse(f"avatars.{name}", values, (values >= 0.0) & (values <= most))


def _check_conditions(simulation: Changing, now: Mapping[str, Array], state: Mapping[str, Array]) -> None:
    """Hold what avatars are told to do, how well they are, and what they are like against what can be."""
    prefix = "avatars.conditions."
    fields = {name.removeprefix(prefix): values for name, values in state.items() if name.startswith(prefix)}
    team = state["avatars.team"]
    own = simulation.crowd.cast.teams[: len(team)].astype(np.int32)
    is_down = np.zeros(len(team), bool)
    for name in sorted(_TEMPERAMENT):
        if not np.array_equal(now[prefix + name], fields[name]):
            raise ValueError(f"array {prefix + name!r} is not that of the run")
    if len(fields["mode"]):
        falls, standing = simulation.model.falls, fields["standing"]
        for name in ("standing", "standing_next"):
            _refuse(prefix + name, fields[name], np.isin(fields[name], np.arange(layout.OUT + 1)))
        for name, last in (("mode", layout.TRAVELS), ("does", layout.NOTICES), ("does_next", layout.NOTICES)):
            _refuse(prefix + name, fields[name], np.isin(fields[name], np.arange(last + 1)))
        _check_travels(simulation, fields)
        is_down = (standing >= layout.DROPS) & ~(standing == layout.UP)
        fall, lying = fields["fall"], (layout.FALLING, layout.LYING, layout.RISING)
        lies = np.isin(standing, lying) | np.isin(fields["standing_next"], lying)
        known = (fall == np.floor(fall)) & (fall >= 0) & (fall < max(len(falls), 1))
        _refuse(prefix + "fall", fall, known & (~lies | (len(falls) > 0)))
        for name, most in (("fell", len(falls)), ("felled", len(team))):
            values = fields[name]
            _refuse(prefix + name, values, (values == np.floor(values)) & (values >= 0) & (values <= most))
        piece = fields["piece"]
        inside = (piece >= 0) & (piece <= len(simulation.model.rests)) & (piece == np.floor(piece))
        _refuse(prefix + "piece", piece, inside)
        for name, values in fields.items():
            inside = (values >= 0.0) & (values <= FAR) if name not in _ENDLESS | _TEMPERAMENT else ~np.isnan(values)
            inside = np.abs(values) <= FAR if name in ("way_x", "way_z") else inside
            _refuse(prefix + name, values, inside)
    _refuse("avatars.team", team, np.where(is_down, team == -2 - own, team == own))


def _check_travels(simulation: Changing, fields: Mapping[str, Array]) -> None:
    """Hold the paths of avatars, and the points of these that they go to, against those that there are."""
    travels, prefix = simulation.crowd.travels, "avatars.conditions."
    points = np.array([0, *(len(one.points) + one.forms_up for one in travels)])
    travel, leg = fields["travel"], fields["leg"]
    is_known = (travel == np.floor(travel)) & (travel >= fields["mode"] // layout.TRAVELS) & (travel <= len(travels))
    _refuse(prefix + "travel", travel, is_known)
    _refuse(
        prefix + "leg", leg, (leg == np.floor(leg)) & (leg >= 0) & (leg < np.maximum(points[travel.astype(int)], 1))
    )


def _check_world(state: Mapping[str, Array]) -> None:
    for name in sorted(state):
        if name.startswith(("world.cohorts.", "world.rules.")) or name in ("world.weights", "world.pauses"):
            _refuse(name, state[name], (state[name] >= 0.0) & (state[name] <= FAR))
    _refuse("world.targets", state["world.targets"], np.abs(state["world.targets"]) <= FAR)


def _check_rest(simulation: Changing, state: Mapping[str, Array]) -> None:
    present, fresh, pending = state["present"], state["fresh"], state["agenda.pending"]
    for name in ("present", "changed"):
        _refuse(name, state[name].view(np.uint8), state[name].view(np.uint8) <= 1)
    for name, numbers, count in (
        ("fresh", fresh, simulation.crowd.count),
        ("agenda.pending", pending, len(simulation.crowd.changes)),
        ("agenda.standing", np.sort(state["agenda.standing"]), len(simulation.crowd.changes)),
    ):
        if numbers.ndim != 1:
            raise ValueError(f"array {name!r} has the shape {numbers.shape}, expected one axis")
        _refuse(name, numbers, (numbers >= 0) & (numbers < count))
        _refuse(name, numbers[1:], np.diff(numbers) > 0)
    _refuse("fresh", fresh, present[fresh])
    waiting, arrivals = state["agenda.waiting"], state["agenda.arrivals"]
    expected = state["agenda.expected"]
    for name, values, width in (
        ("agenda.waiting", waiting, 2),
        ("agenda.expected", expected, 2),
        ("agenda.arrivals", arrivals, 5),
    ):
        if values.ndim != 2 or values.shape[1] != width:
            raise ValueError(f"array {name!r} has the shape {values.shape}, expected (n, {width})")
        numbers, frames = values[:, 0], values[:, 1 : min(width, 3)]
        _refuse(name, numbers, (numbers >= 0) & (numbers < simulation.crowd.count) & (numbers == np.floor(numbers)))
        latest = FAR if name == "agenda.expected" else state["frame"]
        _refuse(name, frames, (frames >= 0) & (frames <= latest) & (frames == np.floor(frames)))
    for name, values in (("agenda.waiting", waiting), ("agenda.expected", expected)):
        _refuse(name, values[:, 0], ~present[values[:, 0]])
        _refuse(name, values[1:, 0], np.diff(values[:, 0]) > 0)
    places = state["agenda.places"]
    if places.ndim != 2 or places.shape[1] != 4:
        raise ValueError(f"array 'agenda.places' has the shape {places.shape}, expected (n, 4)")
    _refuse("agenda.places", places[:, 0], np.isin(places[:, 0], [*waiting[:, 0], *expected[:, 0]]))
    _refuse("agenda.places", places[1:, 0], np.diff(places[:, 0]) > 0)
    _refuse("agenda.places", places[:, 1:], np.abs(places[:, 1:]) <= FAR)
    _refuse("agenda.arrivals", arrivals[:, 3], (arrivals[:, 3] >= 0.0) & (arrivals[:, 3] <= FAR))
    _refuse("agenda.arrivals", arrivals[:, 4], np.isin(arrivals[:, 4], [0.0, 1.0]))
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
