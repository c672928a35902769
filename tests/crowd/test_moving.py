"""Avatars that events put elsewhere, and whose health they restore."""

from dataclasses import replace

import numpy as np
import pytest
from test_damage import POLICIES, fighters, with_falls
from test_simulation import bytes_of
from test_state import through_a_file

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.script import Change, Travel
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.triggers import AtFrame

ONLY = np.arange(12) == 4


def people(*changes, **other):
    return replace(fighters(**{"arena": np.zeros(5), **other}), policies=POLICIES, changes=changes)


@pytest.mark.parametrize("search", ["auto", "kd_tree"])
def test_an_avatar_is_put_at_a_point_in_the_frame_after_and_a_state_amid_that_goes_on(search) -> None:
    one = people(Change(AtFrame(20), who=ONLY, point=(9.0, -7.0)), rules=np.zeros((1, 12)))
    chunk = Simulation(one, 1, search).run(40)
    assert (chunk.action[:, 4] < 0).nonzero()[0].tolist() == [20]
    assert (chunk.action[:, ~ONLY] >= 0).all()
    assert np.hypot(chunk.x[21, 4] - 9.0, chunk.z[21, 4] + 7.0) < 0.1
    before = chunk.heading[19, 4]
    assert abs(np.angle(np.exp(1j * (chunk.heading[21, 4] - before)))) < 0.5
    for stop in (20, 21, 22):
        first, second = Simulation(one, 1, search), Simulation(one, 1, search)
        half = first.run(stop)
        state = through_a_file(first.state())
        assert len(state["agenda.places"]) == (stop == 21)
        second.restore(state)
        assert bytes_of([half, second.run(40 - stop)]) == bytes_of([chunk])


def test_it_is_put_beside_others_and_keeps_its_health() -> None:
    plain = Simulation(people())
    plain.run(20)
    conditions, taken = plain.avatars.conditions, plain.avatars.slot_of[7]
    at = float(plain.avatars.x[taken]), float(plain.avatars.z[taken])
    conditions["health"][4], conditions["stamina"][4] = 17.0, 0.25
    plain.change(Change(AtFrame(20), who=ONLY, point=at))
    plain.run(1)
    chunk = plain.run(1)
    assert 0.3 < np.hypot(chunk.x[0, 4] - at[0], chunk.z[0, 4] - at[1]) < 1.1
    assert conditions["health"][4] == 17.0
    assert conditions["stamina"][4] <= 0.25


def test_a_state_with_places_that_cannot_be_is_refused() -> None:
    one = people(Change(AtFrame(20), who=ONLY, point=(9.0, -7.0)))
    first = Simulation(one)
    first.run(21)
    state = first.state()
    for rows in ([[5, 0, 0, 0]], [[4, np.nan, 0, 0]], [[4, 0, 0, 0], [4, 0, 0, 0]]):
        with pytest.raises(ValueError, match=r"array 'agenda.places' holds .*, which is out of range"):
            Simulation(one).restore({**state, "agenda.places": np.array(rows, float)})
    with pytest.raises(ValueError, match=r"array 'agenda.places' has the shape"):
        Simulation(one).restore({**state, "agenda.places": np.zeros((1, 3))})


def test_those_who_are_down_for_good_get_up_when_their_health_is_restored() -> None:
    simulation = Simulation(people(), model=with_falls())
    rows = simulation.avatars.conditions
    while np.count_nonzero((rows["standing"] == layout.LYING) & np.isinf(rows["rises"])) < 2:
        simulation.run(1)
    lying = np.flatnonzero((rows["standing"] == layout.LYING) & np.isinf(rows["rises"]))
    healed = np.arange(12) == lying[0]
    simulation.change(Change(AtFrame(simulation.next_change), who=healed, heals=True))
    assert simulation._agenda.progress.out[lying].all()
    simulation.run(1)
    assert simulation._agenda.progress.out[lying].tolist() == [False, *[True] * (len(lying) - 1)]
    assert rows["health"][lying[0]] == 60.0
    for _ in range(60):
        simulation.run(1)
        if rows["standing"][lying[0]] == layout.UP:
            break
    assert rows["standing"][lying[0]] == layout.UP
    assert simulation.avatars.team[simulation.avatars.slot_of[lying[0]]] >= 0
    assert (rows["standing"][lying[1:]] == layout.LYING).all()


def test_an_avatar_that_lies_is_not_put_elsewhere() -> None:
    simulation = Simulation(people(), model=with_falls())
    rows = simulation.avatars.conditions
    while not (rows["standing"] == layout.LYING).any():
        simulation.run(1)
    lies = rows["standing"] == layout.LYING
    simulation.change(Change(AtFrame(simulation.next_change), who=lies, point=(30.0, 0.0)))
    chunk = simulation.run(2)
    assert (chunk.action[:, lies] >= 0).all()
    assert (np.abs(chunk.x[1, lies]) < 20).all()


def travelling(*changes: Change) -> Simulation:
    """People of whom one may go away along a path."""
    path = Travel(np.array([(30.0, 0.0), (40.0, 0.0)]), 0.1, ends_attacked=False, leaves=True)
    return Simulation(replace(people(*changes), travels=(path,)))


def test_an_avatar_that_is_put_elsewhere_goes_on_with_its_journey() -> None:
    put = Change(AtFrame(30), who=ONLY, point=(9.0, -7.0))
    one = travelling(Change(AtFrame(20), who=ONLY, travel=0), put)
    one.run(30)
    before = one.avatars.conditions[4].copy()
    assert before["mode"] == layout.TRAVELS
    one.run(2)
    after = one.avatars.conditions[4]
    for name in ("mode", "travel", "leg", "pace", "way_x", "way_z"):
        assert after[name] == before[name]


def test_an_avatar_that_is_put_elsewhere_and_leaves_in_one_frame_sets_out_where_it_is_put() -> None:
    changes = (Change(AtFrame(20), who=ONLY, point=(9.0, -7.0)), Change(AtFrame(20), who=ONLY, travel=0))
    one = travelling(*changes)
    chunk = one.run(60)
    assert (chunk.action[:, 4] < 0).nonzero()[0].tolist() == [20]
    row = one.avatars.conditions[4]
    assert (row["mode"], row["way_x"], row["way_z"]) == (layout.TRAVELS, 30.0, 0.0)
    assert (chunk.opponent[25:, 4] == -1).all()
    steps = travelling(*changes)
    assert bytes_of([steps.run(count) for count in (20, 1, 39)]) == bytes_of([chunk])


def test_a_run_says_that_an_avatar_was_put_beside_its_point_or_late() -> None:
    plain = Simulation(people())
    plain.run(20)
    taken = plain.avatars.slot_of[7]
    at = float(plain.avatars.x[taken]), float(plain.avatars.z[taken])
    plain.change(Change(AtFrame(20), who=ONLY, point=at))
    plain.run(2)
    (arrival,) = plain._agenda.arrivals
    assert (arrival.avatar, arrival.asked, arrival.entered, arrival.is_put) == (4, 21, 21, True)
    said = f"avatar 4 was put where it had no room: it was put {arrival.distance:.2f} m from that point"
    assert plain.arrivals_text() == said
    other = Simulation(people())
    other.restore(through_a_file(plain.state()))
    assert other.arrivals_text() == said
