"""The state of a simulation: all that decides how it goes on, so that another one can go on from there."""

import io
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from synthetic_policy import policy
from test_simulation import bytes_of, crowd

from crowdsim.crowd.kernels.records import RULE
from crowdsim.crowd.script import Change, CirclePath
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.state import STATE
from crowdsim.crowd.triggers import AtFrame, Landed, Near

POLICIES = [policy(0, "v", name="one"), policy(1, "q", frames=50, stride=2, name="two")]
GROUPS = np.arange(12) // 6
FRAMES = 60
SCRATCH = ("_scratch", "_stages._due", "_stages._rooms", "_stages._avatars.", "_stages._index", "_index")
"""Arrays that change too, but hold nothing from one frame to the next that results depend on."""


def scripted(**fields: Any) -> tuple[Any, dict[str, Any]]:
    """Return a crowd with a scripted target, some who come late, some who leave, and other changes on conditions."""
    late = np.arange(12) >= 9
    one = crowd(present=~late, interval=20.0, group=GROUPS, team=GROUPS, **fields)
    changes = (
        Change(Landed(3), weights=np.full(one.weights.shape, 0.5)),
        Change(AtFrame(17), who=late, present=True),
        Change(AtFrame(17), temperatures=np.full(len(one.temperatures), 0.3)),
        Change(Near(0, 1, 0.8), who=GROUPS == 1, skip=np.full(12, -2), fixed=np.full(12, -2)),
        Change(AtFrame(44), who=np.arange(12) < 2, present=False),
    )
    return one, dict(targets=(CirclePath(2.0, 1.0, (1.0, 1.0), 1.5),), changes=changes)


CROWDS = {
    "free for all": lambda: (crowd(), {}),
    "bursts": lambda: (crowd(interval=20.0), {}),
    "two teams": lambda: (crowd(team=np.arange(12) % 2), {}),
    "events": scripted,
}


@pytest.mark.parametrize("search", ["auto", "kd_tree"])
@pytest.mark.parametrize("name", CROWDS)
@pytest.mark.parametrize("stop", [1, 16, 17, 18, 45])
def test_a_simulation_goes_on_from_a_state_as_the_undisturbed_one_does(name: str, stop: int, search: str) -> None:
    one, script = CROWDS[name]()
    whole, first, second = (Simulation(replace(one, policies=POLICIES, **script), 1, search) for _ in range(3))
    expected = [whole.run(stop), whole.run(FRAMES - stop)]
    first.run(stop)
    second.restore(through_a_file(first.state()))
    assert bytes_of([second.run(FRAMES - stop)]) == bytes_of(expected[1:])
    result, wanted = second.state(), whole.state()
    assert {key: (values.shape, values.tobytes()) for key, values in result.items()} == {
        key: (values.shape, values.tobytes()) for key, values in wanted.items()
    }


def through_a_file(state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **state)
    file.seek(0)
    with np.load(file, allow_pickle=False) as arrays:
        return dict(arrays)


@pytest.mark.parametrize("search", ["auto", "kd_tree"])
def test_everything_that_changes_is_in_the_state(search: str) -> None:
    one, script = scripted()
    simulation = Simulation(replace(one, policies=POLICIES, **script), 1, search)
    simulation.run(1)
    before = {path: repr(value) for path, value in parts(simulation)}
    simulation.run(FRAMES)
    changed = {path for path, value in parts(simulation) if before.get(path) != repr(value)}
    assert {"avatars.motion", "avatars.fight", "avatars.x", "frame", "_agenda.progress.landed"} <= changed
    forgotten = {path for path in changed if not path.startswith((*STATE, *SCRATCH))}
    assert not forgotten, "saved neither in crowd/state.py nor known as scratch space"


def parts(thing: Any, path: str = "", above: tuple[int, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Yield all that an object of this program holds, numbers and arrays of several levels, with its path."""
    if id(thing) in above or callable(thing):
        return
    above = (*above, id(thing))
    if isinstance(thing, np.ndarray):
        yield path, thing.tobytes()
    elif hasattr(thing, "_asdict"):
        for name, value in thing._asdict().items():
            yield from parts(value, f"{path}.{name}".strip("."), above)
    elif isinstance(thing, (list, tuple)):
        yield path, len(thing)
        for number, value in enumerate(thing):
            yield from parts(value, f"{path}.{number}", above)
    elif type(thing).__module__.startswith("crowdsim") and hasattr(thing, "__dict__"):
        for name, value in vars(thing).items():
            yield from parts(value, f"{path}.{name}".strip("."), above)
    elif isinstance(thing, (int, float, str, type(None))):
        yield path, thing


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"present": np.ones(11, bool)}, "array 'present' is bool(11,), expected bool(12,)"),
        ({"frame": None}, "array 'frame' is missing"),
        ({"mood": np.zeros(3)}, "array 'mood' is unknown"),
    ],
)
def test_a_state_of_another_crowd_is_refused(change: dict[str, Any], message: str) -> None:
    simulation = Simulation(replace(crowd(), policies=POLICIES))
    state = {name: value for name, value in {**simulation.state(), **change}.items() if value is not None}
    with pytest.raises(ValueError, match=message.replace("(", r"\(").replace(")", r"\)")):
        simulation.restore(state)


@pytest.mark.parametrize("name", ["heading", "motion.halt_x", "playback.base_turn", "slides.x", "motion.end_z"])
@pytest.mark.parametrize("value", [np.nan, 1e300])
def test_a_state_with_numbers_that_cannot_be_is_refused(name: str, value: float) -> None:
    # Where avatars may fall there is room for how far they slide.
    simulation = Simulation(replace(crowd(), policies=POLICIES, conditioned=True, rules=np.zeros((1, len(RULE.names)))))
    state = simulation.state()
    state[f"avatars.{name}"][3] = value
    with pytest.raises(ValueError, match=name):
        simulation.restore(state)
