"""Avatars that events add: they enter where they are placed, or near it where there is room, or wait for it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import crowdsim, scene, write_scene
from synthetic_policy import policy
from test_simulation import bytes_of, crowd
from test_state import through_a_file

from crowdsim.crowd.crowd import Crowd, build_avatars
from crowdsim.crowd.entering import AGAIN, REACH, Arrival, describe_arrivals, find_entries
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.records import RULE
from crowdsim.crowd.model import build_model
from crowdsim.crowd.script import Change
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.triggers import AtFrame

POLICIES = [policy(0, "v", name="one"), policy(1, "q", frames=50, stride=2, name="two")]


def packed(seed: int, spread: float, late: int = 8, **fields: Any) -> Crowd:
    """Return a crowd in a square, of whom some have still to enter."""
    groups = np.arange(30, dtype=np.int32) % 3
    one = crowd(
        30,
        seed,
        policies=2,
        group=groups,
        present=np.arange(30) >= late,
        conditioned=True,
        rules=np.zeros((1, len(RULE))),
        **fields,
    )
    x, z = np.random.default_rng(seed).uniform(-spread, spread, (2, 30))
    return replace(one, x=x, z=z, policies=POLICIES, arena=np.array([1.0, 0.0, 0.0, spread, spread]))


def naive_entries(one: Crowd, down: np.ndarray, numbers: list[int]) -> np.ndarray:
    """Where avatars enter, one after the other and with all others in turn."""
    rooms = 0.25 * one.cast.scales * one.cast.girths
    there = [(one.x[n], one.z[n], 0.75 if down[n] else rooms[n]) for n in np.flatnonzero(one.present)]

    def is_free(x: float, z: float, room: float) -> bool:
        return all(np.hypot(x - a, z - b) >= room + other for a, b, other in there)

    found: dict[int, tuple[float, float]] = {}
    for number in numbers:
        rest = [n for n in found if one.group[n] != one.group[number]]
        apart = [np.hypot(one.x[number] - one.x[n], one.z[number] - one.z[n]) >= rooms[number] + rooms[n] for n in rest]
        if all(apart) and is_free(one.x[number], one.z[number], rooms[number]):
            found[number] = one.x[number], one.z[number]
    there += [(*place, rooms[number]) for number, place in found.items()]
    for number in numbers:
        for ring in (0.25, 0.5, 0.75, 1.0) if number not in found else ():
            for way in np.arange(12) * np.pi / 6:
                x, z = one.x[number] + ring * np.sin(way), one.z[number] + ring * np.cos(way)
                if number not in found and np.hypot(x, z) <= one.arena[3] and is_free(x, z, rooms[number]):
                    found[number] = x, z
                    there.append((x, z, rooms[number]))
    return np.array([found.get(number, (np.nan, np.nan)) for number in numbers])


@pytest.mark.parametrize("spread", [0.6, 1.2, 2.0, 4.0])
@pytest.mark.parametrize("seed", range(4))
def test_entries_are_those_of_the_naive_search(seed: int, spread: float) -> None:
    one = packed(seed, spread)
    down = np.random.default_rng(seed).random(30) < 0.2
    numbers = np.arange(8)
    results = []
    for order in (None, np.random.default_rng(seed).permutation(30)):
        avatars = build_avatars(one, build_model(POLICIES), order)
        avatars.conditions["standing"] = np.where(down, layout.LYING, layout.UP)
        results.append(find_entries(one, avatars, 22, numbers))
    np.testing.assert_array_equal(*results)
    np.testing.assert_allclose(results[0], naive_entries(one, down, numbers.tolist()), atol=1e-12)
    away = np.linalg.norm(results[0] - np.column_stack([one.x[:8], one.z[:8]]), axis=1)
    assert np.nanmax(away, initial=0.0) <= REACH + 1e-12


def test_avatars_of_two_groups_that_are_placed_at_one_position_both_enter() -> None:
    one = packed(1, 8.0)
    x, z = one.x.copy(), one.z.copy()
    x[:4], z[:4] = 0.0, [0.0, 0.0, 0.0, 0.1]
    one = replace(one, x=x, z=z)
    entries = find_entries(one, build_avatars(one, build_model(POLICIES)), 22, np.arange(4))
    # The last one is of the group of the first, and is placed that near to it.
    assert entries[[0, 3]].tolist() == [[0.0, 0.0], [0.0, 0.1]]
    gaps = np.linalg.norm(entries[:, None] - entries, axis=-1)[np.triu_indices(4, 1)]
    assert sorted(gaps.round(6))[0] == 0.1
    assert sorted(gaps)[1] > 0.4


def test_tight_crowds_have_room_for_few_and_wide_ones_for_all() -> None:
    counts = []
    for spread in (0.6, 2.0, 8.0):
        one = packed(3, spread)
        entries = find_entries(one, build_avatars(one, build_model(POLICIES)), 22, np.arange(8))
        counts.append(int(np.isfinite(entries[:, 0]).sum()))
    assert counts[0] == 0 < counts[1] <= counts[2] == 8


def waiting_crowd() -> Crowd:
    """Return a crowd whose first avatar is added in the midst of the others, half of whom leave later."""
    one = crowd(30, 1, spacing=0.4, policies=2, present=np.arange(30) > 0)
    x, z = one.x.copy(), one.z.copy()
    x[0], z[0] = x[14], z[14]
    gone = np.arange(30) > 1
    changes = (
        Change(AtFrame(7), who=np.arange(30) == 0, present=True),
        Change(AtFrame(22), who=gone, present=False),
    )
    return replace(one, x=x, z=z, policies=POLICIES, changes=changes)


@pytest.mark.parametrize("search", ["auto", "kd_tree"])
def test_an_avatar_waits_until_there_is_room_and_says_so(search: str) -> None:
    one = waiting_crowd()
    whole = Simulation(one, 1, search)
    chunk = whole.run(40)
    (entered,) = np.flatnonzero(np.diff((chunk.action[:, 0] >= 0).astype(int)) == 1) + 1
    assert entered % AGAIN == 0
    assert 7 < entered <= 25
    assert (chunk.action[:entered, 0] == -1).all()
    (arrival,) = whole._agenda.arrivals
    assert (arrival.avatar, arrival.asked, arrival.entered) == (0, 7, entered)
    place = np.array([chunk.x[entered, 0], chunk.z[entered, 0]]) - [one.x[0], one.z[0]]
    assert np.linalg.norm(place) == pytest.approx(arrival.distance, abs=1e-5)
    assert whole.arrivals_text().startswith("avatar 0 was added where another avatar stood: ")
    assert f"it waited for room for {(entered - 7) / one.rate:.1f} s" in whole.arrivals_text()
    steps = Simulation(one, 1, search)
    assert bytes_of([steps.run(count) for count in (3, 5, 9, 1, 22)]) == bytes_of([chunk])
    for stop in (8, 11, 30):
        first, second = Simulation(one, 1, search), Simulation(one, 1, search)
        before = first.run(stop)
        second.restore(through_a_file(first.state()))
        assert bytes_of([before, second.run(40 - stop)]) == bytes_of([chunk])
        assert second._agenda.arrivals == [arrival]


def test_an_avatar_that_is_taken_out_while_it_waits_does_not_enter() -> None:
    one = waiting_crowd()
    changes = (one.changes[0], Change(AtFrame(9), who=np.arange(30) == 0, present=False), one.changes[1])
    assert (Simulation(replace(one, changes=changes)).run(40).action[:, 0] == -1).all()


def test_states_with_arrivals_that_cannot_be_are_refused() -> None:
    one = waiting_crowd()
    simulation = Simulation(one)
    simulation.run(9)
    state = simulation.state()
    assert state["agenda.waiting"].tolist() == [[0, 7]]
    for name, values in (
        ("agenda.waiting", [[30, 7]]), ("agenda.waiting", [[0, 10]]), ("agenda.waiting", [[1, 7]]),
        ("agenda.waiting", [[0, 7], [0, 7]]), ("agenda.arrivals", [[0.5, 1, 1, 0, 0]]),
        ("agenda.arrivals", [[1, 1, 1, -1, 0]]), ("agenda.arrivals", [[1, 1, 1, np.nan, 0]]),
        ("agenda.arrivals", [[1, 1, 1, 0, 2]]),
    ):  # fmt: skip
        wrong = {**state, name: np.array(values, state[name].dtype)}
        with pytest.raises(ValueError, match=f"array '{name}' holds .*, which is out of range"):
            Simulation(one).restore(wrong)
    with pytest.raises(ValueError, match=r"array 'agenda.waiting' has the shape"):
        Simulation(one).restore({**state, "agenda.waiting": np.zeros((1, 3), np.int64)})


def test_what_became_of_those_who_were_added_is_said_in_a_sentence() -> None:
    names = np.array(["a_0", "a_1", "a_2", "a_3"])
    assert describe_arrivals([], {}, {}, 60, 15.0, names) == ""
    assert describe_arrivals([Arrival(1, 20, 20, 0.5)], {}, {}, 60, 15.0, names) == (
        "avatar a_1 was added where another avatar stood: it entered 0.50 m from its placement"
    )
    text = describe_arrivals([Arrival(3, 20, 20, 0.25), Arrival(1, 20, 35, 0.75)], {2: 30}, {}, 60, 15.0, names)
    assert text == (
        "3 avatars, a_1 the first of them, were added where another avatar stood: 2 entered up to 0.75 m from its "
        "placement, 1 waited for room for 1.0 s, 1 found no room in 2.0 s and never entered"
    )
    put = Arrival(0, 20, 50, 0.25, is_put=True)
    assert describe_arrivals([put], {2: 30, 3: 45}, {3}, 60, 15.0, names) == (
        "avatar a_2 was added where another avatar stood: it found no room in 2.0 s and never entered; 2 avatars, a_0 "
        "the first of them, were put where it had no room: 1 was put 0.25 m from that point, 1 waited for room for "
        "2.0 s, 1 found no room in 1.0 s and is absent"
    )


def test_a_run_says_that_an_avatar_entered_beside_its_placement(workplace: Path, capsys) -> None:
    late = {"name": "late", "team": "blue", "type": "boxer", "count": 1, "waits": True,
            "placement": {"kind": "grid", "centre": [-1.0, 0.7]}}  # fmt: skip
    events = [{"kind": "add", "group": "late", "when": {"kind": "frame", "frame": 0}}]
    write_scene(workplace / "four.yaml", groups=[*scene()["groups"], late], events=events)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    what = "avatar late_0 was added where another avatar stood: it entered 0.50 m from its placement"
    assert what in capsys.readouterr().err
    late["placement"] = {"kind": "points", "points": [[0, 5], [0, 5.05]]}
    late["count"] = 2
    write_scene(workplace / "four.yaml", groups=[*scene()["groups"], late], events=events)
    assert crowdsim("validate", "four.yaml") == 2
    assert "avatar late_1 would be 0.05 m from late_0, expected 0.1 m or more" in capsys.readouterr().err
