"""Everything in a simulation that changes from frame to frame, as named arrays, so that it can go on from there.

Arrays that are added to ``Avatars`` or ``World`` are saved without further ado; a test finds anything else that changes
and is not in ``STATE``. Avatars are saved in the order of their numbers, since nothing that is
computed depends on the order in which they are stored. All else in a simulation is constant, scratch space, or follows
from these.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import BY_SLOT, Avatars, World
from crowdsim.crowd.crowd import Crowd
from crowdsim.crowd.entering import Arrival
from crowdsim.crowd.outcome import Outcome
from crowdsim.crowd.state_checks import Changing, check_values

STATE = (
    "avatars.",
    "_world.",
    "_agenda.pending",
    "_agenda.waiting",
    "_agenda.arrivals",
    "_agenda.expected",
    "_agenda.places",
    "_agenda.standing",
    "_agenda.progress.",
    "outcome",
    "_fresh",
    "present",
    "frame",
    "_changed_at",
    "searches",
)
"""What changes in a simulation while it runs and decides how it goes on; of avatars and world every array."""


def read_state(simulation: Changing) -> dict[str, Array]:
    """Return copies of all arrays that decide how a simulation goes on, by name.

    Those of avatars have an entry for each avatar number. Fields of records are arrays of their own.
    """
    avatars, agenda = simulation.avatars, simulation._agenda
    state = {}
    for name, values in _arrays(avatars).items():
        # Numpy takes records as a whole, and copies them field by field where they are indexed.
        stored = values.take(avatars.slot_of) if name in BY_SLOT and len(values) else values
        state.update({field: column.copy() for field, column in _columns(f"avatars.{name}", stored).items()})
    present = np.zeros(simulation.crowd.count, bool)
    present[avatars.number[: simulation.present]] = True
    state["present"] = present
    state["fresh"] = np.sort(avatars.number[simulation._fresh])
    for name, values in _shared(simulation._world).items():
        state.update({field: np.array(column) for field, column in _columns(f"world.{name}", values).items()})
    state["agenda.pending"] = np.array(agenda.pending, np.int64)
    state["agenda.waiting"] = np.array(sorted(agenda.waiting.items()), np.int64).reshape(-1, 2)
    state["agenda.arrivals"] = np.array(agenda.arrivals, float).reshape(-1, 5)
    state["agenda.expected"] = np.array(sorted(agenda.expected.items()), np.int64).reshape(-1, 2)
    places = [(number, *place) for number, place in sorted(agenda.places.items())]
    state["agenda.places"] = np.array(places, float).reshape(-1, 4)
    state["agenda.standing"] = np.array(agenda.standing, np.int64)
    state["agenda.landed"], state["agenda.landed_on"] = agenda.progress.landed.copy(), agenda.progress.landed_on.copy()
    ended = simulation.outcome
    state["outcome.frame"] = np.array(-1 if ended is None else ended.frame)
    state["outcome.standing"] = np.zeros(0, np.int64) if ended is None else ended.standing
    state["frame"] = np.array(simulation.frame)
    state["changed"] = np.array(simulation._changed_at == simulation.frame)
    state["searches"] = np.array(simulation.searches, dtype="<U8")
    return state


def write_state(simulation: Changing, state: Mapping[str, Array]) -> None:
    """Put a simulation of the same crowd, policies and script into a state that ``read_state`` returned.

    Raises:
        ValueError: The state is of another crowd, of other arrays, or holds values that are out of range; the message
            names the first that differs.
    """
    now = read_state(simulation)
    grows = {"fresh", "searches", "outcome.standing"}
    grows |= {f"agenda.{name}" for name in ("pending", "waiting", "arrivals", "expected", "places", "standing")}
    for name in sorted(now.keys() | state.keys()):
        if name not in now or name not in state:
            raise ValueError(f"array {name!r} is {'missing' if name in now else 'unknown'}")
        old, new = now[name], state[name]
        if old.dtype.kind != new.dtype.kind or (name not in grows and old.shape != new.shape):
            raise ValueError(f"array {name!r} is {new.dtype}{new.shape}, expected {old.dtype}{old.shape}")
    check_values(simulation, now, state)
    avatars = simulation.avatars
    order = np.argsort(~state["present"], kind="stable").astype(np.int32)
    for name, values in _arrays(avatars).items():
        for field, column in _columns(f"avatars.{name}", values).items():
            column[...] = state[field][order] if name in BY_SLOT and len(values) else state[field]
    avatars.slot_of[order] = np.arange(len(order), dtype=np.int32)
    simulation.present = int(np.count_nonzero(state["present"]))
    simulation._fresh = np.sort(avatars.slot_of[state["fresh"]]).astype(np.int32)
    for name, values in _shared(simulation._world).items():
        for field, column in _columns(f"world.{name}", values).items():
            if isinstance(column, np.ndarray):  # all others are constant
                column[...] = state[field]
    simulation._agenda.pending = state["agenda.pending"].tolist()
    simulation._agenda.waiting = dict(state["agenda.waiting"].tolist())
    simulation._agenda.arrivals = [
        Arrival(int(avatar), int(asked), int(entered), away, bool(is_put))
        for avatar, asked, entered, away, is_put in state["agenda.arrivals"].tolist()
    ]
    simulation._agenda.expected = dict(state["agenda.expected"].tolist())
    simulation._agenda.places = {int(number): (x, z, turn) for number, x, z, turn in state["agenda.places"].tolist()}
    simulation._agenda.standing = state["agenda.standing"].tolist()
    simulation._agenda.progress.landed[...] = state["agenda.landed"]
    simulation._agenda.progress.landed_on[...] = state["agenda.landed_on"]
    simulation.outcome = read_outcome(state, simulation.crowd)
    simulation.frame = int(state["frame"])
    simulation._changed_at = simulation.frame if state["changed"] else -1
    simulation.searches = [str(search) for search in state["searches"]]
    simulation._index.reset()


def read_outcome(state: Mapping[str, Array], crowd: Crowd) -> Outcome | None:
    """Return how a run of a crowd has ended by a state that ``read_state`` returned; None where it has not.

    Raises:
        ValueError: The state does not say so, or names avatars that the crowd does not have.
    """
    if crowd.until is None:
        return None
    try:
        frame, standing = int(state["outcome.frame"]), state["outcome.standing"]
        is_sound = (
            standing.dtype.kind == "i" and standing.ndim == 1 and set(standing.tolist()) <= set(range(crowd.count))
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"the outcome cannot be read: {error}") from None
    if not is_sound:
        raise ValueError("the outcome names avatars that are not there")
    return None if frame < 0 else Outcome(crowd.until.kind, frame, standing)


def _arrays(avatars: Avatars) -> dict[str, Array]:
    """Return the arrays of avatars, without the order in which they are stored."""
    return {name: values for name, values in avatars._asdict().items() if name != "slot_of"}


def _shared(world: World) -> dict[str, Any]:
    """Return what avatars share by name, but for obstacles: these follow from the scenario."""
    return {name: values for name, values in world._asdict().items() if name != "places"}


def _columns(name: str, values: Any) -> dict[str, Any]:
    """Return the fields of records or of a named tuple by name, as views; of anything else itself."""
    if isinstance(values, tuple):
        return {f"{name}.{field}": value for field, value in values._asdict().items()}  # type: ignore[attr-defined]
    if values.dtype.names is None:
        return {name: values}
    return {f"{name}.{field}": values[field] for field in values.dtype.names}
